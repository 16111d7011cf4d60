//! Frequencies of taut strings and drums, and a pendulum.

use std::f64::consts::PI;

use structure_solver::dynamics::Dynamics;
use structure_solver::elements::cable::TwoWay;
use structure_solver::materials::StVenantKirchhoff;
use structure_solver::scheme::Scheme;

use crate::common::*;
use crate::shapes::*;

/// Time of `count` half periods of component `i`, by its zero crossings.
pub fn half_periods(d: &mut Dynamics, i: usize, dt: f64, count: usize, body: [f64; 3]) -> f64 {
    let mut crossings = Vec::new();
    let mut before = d.accepted.u[i];
    for step in 0..20_000 {
        window(d, dt, 1, 0.0, body);
        let now = d.accepted.u[i];
        if before * now < 0.0 {
            crossings.push(dt * (step as f64 + before / (before - now)));
            if crossings.len() > count {
                return crossings[count] - crossings[0];
            }
        }
        before = now;
    }
    panic!("no vibration");
}

/// Taut string: f_n = (n / 2 L) sqrt(T/mu), n = 1 to 3. Linear elements of a 40th are too fast by
/// (n pi / 40)^2 / 24, 300 trapezoidal steps a period too slow by (2 pi / 300)^2 / 12 = 4e-5; amplitude
/// L/1000 matters as its square.
#[test]
fn taut_string_has_its_frequencies() {
    let (l, rest, y, area, density) = (2.0, 1.9, 1e7, 1e-5, 1100.0);
    let e = 0.5 * ((l / rest) * (l / rest) - 1.0);
    let tension = area * y * e * l / rest;
    let mu = density * area * rest / l;
    for n in 1..=3 {
        let m = chain(40, l, rest);
        let mut d = Dynamics::new(
            lines(&m, TwoWay { youngs_modulus: y }, area, density),
            params(Scheme::newmark(), 0.0),
        );
        let mode = f64::from(n);
        for (i, x) in m.coords.iter().enumerate() {
            d.accepted.u[3 * i + 2] = 1e-3 * l / mode * (mode * PI * x[0] / l).sin();
        }
        balance(&mut d, 0.0, [0.0; 3]);
        let frequency = mode * (tension / mu).sqrt() / (2.0 * l);
        let dt = 1.0 / (300.0 * frequency);
        // Near the first maximum.
        let node = (20.0 / mode).round() as usize;
        let found = 2.0 / half_periods(&mut d, 3 * node + 2, dt, 4, [0.0; 3]);
        let mesh = (mode * PI / 40.0).powi(2) / 24.0;
        let error = found / frequency - 1.0;
        println!("string f{n}: {found:.4} beside {frequency:.4} Hz ({error:.1e}; mesh {mesh:.1e})");
        assert!((error - mesh + 4e-5).abs() < 1e-4 + 0.1 * mesh, "{found} beside {frequency}");
    }
}

/// Tension per length (N/m) and mass per area (kg/m2) of a sheet stretched by `lambda`:
/// S11 = S22 = Y E / (1 - nu); force per deformed length is S h.
fn drum(y: f64, nu: f64, lambda: f64) -> [f64; 2] {
    let s = y / (1.0 - nu) * 0.5 * (lambda * lambda - 1.0);
    [s * SHEET[0], SHEET[0] * SHEET[1] / (lambda * lambda)]
}

/// Square drum: f11 = sqrt(2 T / sigma) / (2 a). Energy stays: the trapezoidal rule on a nearly linear vibration.
#[test]
fn square_drum_has_its_frequency_and_keeps_its_energy() {
    let (a0, n, lambda, y, nu) = (1.0, 12, 1.02, 1e6, 0.3);
    let m = sheet(n, a0);
    let mut d =
        Dynamics::new(membrane(&m, StVenantKirchhoff::isotropic(y, nu)), params(Scheme::newmark(), 0.0));
    stretch(&mut d, lambda);
    let [tension, mass] = drum(y, nu, lambda);
    let frequency = (2.0 * tension / mass).sqrt() / (2.0 * lambda * a0);
    let taut = energies(&d)[1];
    for (i, x) in m.coords.iter().enumerate() {
        d.accepted.u[3 * i + 2] = 1e-4 * (PI * x[0]).sin() * (PI * x[1]).sin();
    }
    balance(&mut d, 0.0, [0.0; 3]);
    let vibration = |d: &Dynamics| energies(d).iter().sum::<f64>() - taut;
    let start = vibration(&d);
    let dt = 1.0 / (100.0 * frequency);
    let found = 2.0 / half_periods(&mut d, 3 * (n / 2 + (n + 1) * (n / 2)) + 2, dt, 4, [0.0; 3]);
    // Linear triangles of size a/12 raise the frequency by (pi/12)^2 / 24 times a
    // factor of about two; the trapezoidal rule lowers it by (2 pi / 100)^2 / 12.
    assert!((found / frequency - 1.0).abs() < 8e-3, "{found} beside {frequency}");
    for _ in 0..1500 {
        window(&mut d, dt, 1, 0.0, [0.0; 3]);
    }
    let drift = vibration(&d) / start - 1.0;
    assert!(drift.abs() < 1e-3, "energy drifts by {drift}");
}

/// Bessel's J0 by its series; at most 6, so 40 terms are exact.
fn bessel_j0(x: f64) -> f64 {
    let (mut term, mut sum) = (1.0, 1.0);
    for k in 1..40 {
        term *= -0.25 * x * x / f64::from(k * k);
        sum += term;
    }
    sum
}

/// Circular drum, first two axisymmetric modes: f = j sqrt(T / sigma) / (2 pi a) with the zeros
/// j = 2.404826 and 5.520078 of J0. Mesh errors are of second order (three meshes),
/// mostly of linear triangles, (j h)^2 / 24 times a factor of about two.
#[test]
fn circular_drum_has_its_frequencies() {
    let (a, lambda, y, nu) = (1.0, 1.02, 1e6, 0.3);
    let [tension, mass] = drum(y, nu, lambda);
    for zero in [2.404825557695773, 5.520078110286311] {
        let frequency = zero * (tension / mass).sqrt() / (2.0 * PI * lambda * a);
        let errors = [6, 12, 24].map(|n| {
            let m = quarter_disc(n, a);
            let mut d = Dynamics::new(
                membrane(&m, StVenantKirchhoff::isotropic(y, nu)),
                params(Scheme::newmark(), 0.0),
            );
            stretch(&mut d, lambda);
            for (i, x) in m.coords.iter().enumerate() {
                d.accepted.u[3 * i + 2] = 1e-4 * bessel_j0(zero * x[0].hypot(x[1]) / a);
            }
            m.fixed.iter().filter(|f| f.1[2]).for_each(|f| d.accepted.u[3 * f.0 as usize + 2] = 0.0);
            balance(&mut d, 0.0, [0.0; 3]);
            let dt = 1.0 / (200.0 * frequency);
            2.0 / half_periods(&mut d, 2, dt, 4, [0.0; 3]) / frequency - 1.0
        });
        // Trapezoidal rule: too slow by (2 pi / 200)^2 / 12.
        let mesh = errors.map(|e| e + (2.0 * PI / 200.0).powi(2) / 12.0);
        println!("circular drum, zero {zero:.4}: errors {}, orders {:.2?}", sci(&errors), orders(&mesh));
        assert!(errors[2].abs() < 2.0 * (zero / 24.0).powi(2) / 24.0 + 1e-4, "{errors:?}");
    }
}

/// A weight on a stiff weightless link, let go from the horizontal: the pendulum of any
/// amplitude. Its period is 2 pi sqrt(L/g) / agm(1, cos(theta/2)), theta the amplitude (Gauss); its
/// energy stays.
#[test]
fn a_pendulum_has_its_period_and_keeps_its_energy() {
    let (l, g, mass) = (1.0, 9.81, 2.0);
    let m = {
        let mut m = chain(1, l, l);
        m.fixed.pop();
        m.point_masses.push((1, mass));
        m
    };
    // The link stretches by m g / (Y A) = 2e-6 at rest.
    let law = TwoWay { youngs_modulus: 1e12 };
    let mut d = Dynamics::new(lines(&m, law, 1e-5, 1e-6), sharp(Scheme::generalized_alpha(1.0)));
    let body = [0.0, 0.0, -g];
    balance(&mut d, 0.0, body);
    let (mut a, mut b) = (1.0f64, std::f64::consts::FRAC_PI_4.cos());
    for _ in 0..8 {
        (a, b) = (0.5 * (a + b), (a * b).sqrt());
    }
    let period = 2.0 * PI * (l / g).sqrt() / a;
    let dt = period / 400.0;
    let energy = |d: &Dynamics| energies(d).iter().sum::<f64>() + mass * g * d.accepted.u[5];
    let mut worst = 0.0f64;
    let mut turns = Vec::new();
    let mut before = 0.0;
    for step in 0..4000 {
        window(&mut d, dt, 1, 0.0, body);
        worst = worst.max(energy(&d).abs() / (mass * g * l));
        // Below the support once each half period.
        let x = l + d.accepted.u[3];
        if step > 0 && before * x < 0.0 {
            turns.push(dt * (step as f64 + before / (before - x)));
        }
        before = x;
    }
    let found = 2.0 * (turns[turns.len() - 1] - turns[0]) / (turns.len() - 1) as f64;
    println!("pendulum: energy {worst:.1e}, period {:.1e}", found / period - 1.0);
    assert!(worst < 1e-8, "{worst}");
    // 400 steps: an error of (2 pi / 400)^2 / 12 = 2e-5, times a factor of about two for the amplitude.
    assert!((found / period - 1.0).abs() < 1e-4, "{found} beside {period}");
}
