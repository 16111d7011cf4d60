//! Time integration against the closed form of each scheme: order and error constant, the point at
//! which a load acts, and the recurrence of a linear vibration.

use structure_solver::dynamics::{Dynamics, LoadPath};
use structure_solver::elements::cable::TwoWay;
use structure_solver::materials::StVenantKirchhoff;
use structure_solver::scheme::Scheme;

use crate::common::*;
use crate::shapes::*;

/// $`\alpha_m, \alpha_f, \gamma, \beta`$ of generalized-alpha (Chung and Hulbert 1993, equations 17,
/// 18, 20, 25), and of the trapezoidal rule.
fn textbook(rho: Option<f64>) -> [f64; 4] {
    let Some(rho) = rho else { return [0.0, 0.0, 0.5, 0.25] };
    let (m, f) = ((2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0));
    [m, f, 0.5 - m + f, 0.25 * (1.0 - m + f) * (1.0 - m + f)]
}

fn scheme(rho: Option<f64>) -> Scheme {
    rho.map_or_else(Scheme::newmark, Scheme::generalized_alpha)
}

/// Displacement and velocity after 1 s, in `steps` steps, of a free sheet of 1 kg/m2 under a pressure
/// that grows by 1 Pa/s, less the exact 1/6 m and 1/2 m/s. The sheet moves as a whole: no strain,
/// so that nothing but the scheme's own error is left.
fn ramp_errors(rho: Option<f64>, steps: u64) -> [f64; 2] {
    let mut m = sheet(2, 1.0);
    m.fixed.clear();
    let mut d = Dynamics::new(membrane(&m, StVenantKirchhoff::isotropic(1e6, 0.3)), sharp(scheme(rho)));
    let faces = d.system.model.n_faces;
    let (none, full) = (vec![0.0; faces], vec![1.0; faces]);
    let load = LoadPath { pressure: [&none, &full], traction: [&[]; 2] };
    d.window(1.0, steps, load, [0.0; 3], false).expect("a solvable window");
    d.accept();
    [d.accepted.u[2] - 1.0 / 6.0, d.accepted.v[2] - 0.5]
}

/// Under a load $`ct`$ the accelerations of generalized-alpha are
/// $`a_n = c(t_n + \delta) - c\delta r^n`$, $`\delta = (\alpha_m-\alpha_f)h`$,
/// $`r = -\alpha_m/(1-\alpha_m)`$. Summed by Newmark's formulas:
/// $`v_N - v = k_v c h^2`$ with $`k_v = (\alpha_f-\alpha_m)(1-\gamma+\gamma r)/(1-r)`$ (the part of
/// $`r^N`$ is gone), and $`u_N - u = c t h^2 (k_v + \tfrac12(\alpha_m-\alpha_f) + \beta - \tfrac16)`$
/// up to $`h/t`$. A load taken elsewhere in the step gives $`v`$ an error of first order; $`\beta`$ off by
/// one per cent changes the constant of $`u`$ by three.
#[test]
fn a_growing_load_acts_where_the_scheme_says() {
    let mut wrong = Vec::new();
    for rho in [None, Some(1.0), Some(0.9), Some(0.5), Some(0.0)] {
        let [m, f, gamma, beta] = textbook(rho);
        let r = -m / (1.0 - m);
        let lag = if r.abs() < 1.0 { (f - m) * (1.0 - gamma + gamma * r) / (1.0 - r) } else { 0.0 };
        let exact = [lag + 0.5 * (m - f) + beta - 1.0 / 6.0, lag];
        let steps = [200u64, 400, 800];
        let found = steps.map(|n| ramp_errors(rho, n).map(|e| e * (n * n) as f64));
        println!(
            "growing load, rho {rho:?}: u {:.6} and v {:.6} h2 beside {exact:.6?}",
            found[2][0], found[2][1]
        );
        for (n, [u, v]) in steps.into_iter().zip(found) {
            // The next term of u is of the relative size h; in units of h2, rounding and the solver leave
            // 1e-12 of 1/2 m/s in v.
            let u_is_right = (u / exact[0] - 1.0).abs() < 3.0 / n as f64 + 1e-4;
            if !(u_is_right && (v - exact[1]).abs() < 1e-4 * exact[1].abs() + 1e-5) {
                wrong.push(format!("rho {rho:?}, {n} steps: u {u:.6}, v {v:.6} h2 beside {exact:.6?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// The middle node of a taut line swings by a millionth of its length: a linear oscillator.
fn displacements(rho: Option<f64>, phase: f64, steps: usize) -> Vec<f64> {
    let (l, rest, y, area, density) = (2.0, 1.9, 1e7, 1e-5, 1100.0);
    let m = chain(2, l, rest);
    let mut d = Dynamics::new(lines(&m, TwoWay { youngs_modulus: y }, area, density), sharp(scheme(rho)));
    // Two halves pull with N each: k = 2 N / (l / 2) = 4 A S / rest; consistent mass 2/3 of a half's.
    let strain = 0.5 * ((l / rest) * (l / rest) - 1.0);
    let omega = (4.0 * area * y * strain / rest / (density * area * rest / 3.0)).sqrt();
    d.accepted.u[3 + 2] = 1e-6;
    balance(&mut d, 0.0, [0.0; 3]);
    let mut all = vec![1.0];
    for _ in 0..steps {
        window(&mut d, phase / omega, 1, 0.0, [0.0; 3]);
        all.push(d.accepted.u[3 + 2] * 1e6);
    }
    all
}

/// Newmark's method with $`\gamma = \tfrac12`$: $`u_n = \cos n\theta`$ with
/// $`\cos\theta = 1 - \tfrac12\Omega^2/(1+\beta\Omega^2)`$, $`\Omega`$ the phase of a step. Its error constant
/// $`(\beta - \tfrac1{12})/2`$ follows; $`\beta`$ off by one per cent moves $`u_{40}`$ by 6e-3.
#[test]
fn newmark_has_the_frequency_of_its_closed_form() {
    let omega = 0.5;
    let theta = f64::acos(1.0 - 0.5 * omega * omega / (1.0 + 0.25 * omega * omega));
    let u = displacements(None, omega, 40);
    let worst = u.iter().enumerate().map(|(n, u)| (u - (n as f64 * theta).cos()).abs()).fold(0.0, f64::max);
    println!("Newmark's closed form over 40 steps: within {worst:.1e}");
    assert!(worst < 1e-8, "{worst}");
    // Phase error over one radian in steps of 1/8, 1/16, 1/32.
    let errors = [8usize, 16, 32].map(|n| displacements(None, 1.0 / n as f64, n)[n].acos() - 1.0);
    let orders = orders(&errors);
    assert!(orders.iter().all(|o| (1.98..2.02).contains(o)), "{orders:?}");
    // Series of 2 arctan(x / 2) / x - 1 = -x2 / 12 + x4 / 80.
    let constant = errors[2] * 32.0 * 32.0;
    assert!((constant + 1.0 / 12.0).abs() < 2e-5, "{constant}");
}

/// $`u_n \propto z^n`$ where $`(\alpha_m+(1-\alpha_m)z)(z-1)^2 + \Omega^2(\alpha_f+(1-\alpha_f)z)
/// [1-\gamma+\gamma z + (\tfrac12-\beta+\beta z)(z-1)] = 0`$: each four displacements in turn obey this
/// cubic. One per cent in any coefficient breaks it by 1e-3.
#[test]
fn a_linear_vibration_obeys_the_recurrence_of_the_scheme() {
    let omega2: f64 = 0.8 * 0.8;
    for rho in [None, Some(1.0), Some(0.9), Some(0.5), Some(0.0)] {
        let [m, f, gamma, beta] = textbook(rho);
        // Coefficients of z^0 .. z^3.
        let inertia = [m, 1.0 - 3.0 * m, -2.0 + 3.0 * m, 1.0 - m];
        let newmark = [0.5 - gamma + beta, 0.5 + gamma - 2.0 * beta, beta];
        let mut c = inertia;
        for (k, n) in newmark.into_iter().enumerate() {
            c[k] += omega2 * f * n;
            c[k + 1] += omega2 * (1.0 - f) * n;
        }
        let u = displacements(rho, 0.8, 24);
        let off = |u: &[f64]| (0..4).map(|k| c[k] * u[k]).sum::<f64>().abs();
        let worst = u.windows(4).map(off).fold(0.0, f64::max);
        println!("recurrence of rho {rho:?}: within {worst:.1e}");
        assert!(worst < 1e-9, "{rho:?}: {worst}");
    }
}

/// A load without a number fails in the first step after all halvings, 0.1 s / 2^8: its end is when it failed.
#[test]
fn a_failure_has_the_time_of_its_step() {
    let m = sheet(2, 1.0);
    let mut d =
        Dynamics::new(membrane(&m, StVenantKirchhoff::isotropic(1e6, 0.3)), params(Scheme::newmark(), 0.0));
    let p = vec![f64::NAN; m.faces.len()];
    let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
    let failure = d.window(0.3, 3, load, [0.0; 3], false).expect_err("no number");
    let exact = 0.1 / 256.0;
    assert_eq!(failure.cuts, 8);
    assert!(
        (failure.time / exact - 1.0).abs() < 1e-12 && (failure.dt / exact - 1.0).abs() < 1e-12,
        "{failure}"
    );
}
