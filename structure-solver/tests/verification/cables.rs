//! Cables under their weight.

use structure_solver::dynamics::Dynamics;
use structure_solver::elements::cable::{TensionOnly, TwoWay};
use structure_solver::loops::FaceLoad;
use structure_solver::scheme::Scheme;

use crate::common::*;
use crate::shapes::*;

const NOTHING: FaceLoad<'static> = FaceLoad { pressure: &[], traction: &[] };

/// A stiff cable under its weight hangs in a catenary: 2 c sinh(span / 2c) = length.
#[test]
fn cable_hangs_in_a_catenary() {
    let (span, length) = (1.0, 1.3);
    let m = chain(32, span, length);
    let law = TensionOnly { youngs_modulus: 1e9 };
    let mut d = Dynamics::new(lines(&m, law, 1e-6, 1000.0), params(Scheme::newmark(), 0.0));
    // A slight bow breaks the symmetry of the straight slack start.
    for (i, x) in m.coords.iter().enumerate() {
        d.accepted.u[3 * i + 2] = -1e-3 * (std::f64::consts::PI * x[0]).sin();
    }
    rest(&mut d, NOTHING, [0.0, 0.0, -9.81], 1e-8);
    let mut c = 0.3;
    for _ in 0..60 {
        let g = 2.0 * c * (0.5f64 * span / c).sinh() - length;
        let slope = 2.0 * (0.5 * span / c).sinh() - span / c * (0.5f64 * span / c).cosh();
        c -= g / slope;
    }
    let sag = c * ((0.5 * span / c).cosh() - 1.0);
    // A polygon of 32 links on the curve: its length misses by (1/32)^2 times a curvature of order one.
    let found = -d.accepted.u[3 * 16 + 2];
    assert!((found / sag - 1.0).abs() < 2e-3, "{found} beside {sag}");
}

/// Half span and sag of an elastic cable of rest length 2 `l` between level supports, for a horizontal
/// tension `h` (N), weight `w` per rest length (N/m) and axial stiffness `ya` (N).
///
/// At rest length $`s`$ from the middle the tension is $`N=\sqrt{H^2+(ws)^2}`$; along
/// the line $`dx/ds=\lambda H/N`$, $`dz/ds=\lambda ws/N`$, where the stretch obeys
/// $`N=YA\,\lambda(\lambda^2-1)/2`$ (St. Venant-Kirchhoff). Simpson's rule.
fn elastic_catenary(h: f64, w: f64, l: f64, ya: f64) -> [f64; 2] {
    let slope = |s: f64| {
        let n = h.hypot(w * s);
        let mut stretch = 1.0 + n / ya;
        for _ in 0..50 {
            stretch -= (0.5 * ya * stretch * (stretch * stretch - 1.0) - n)
                / (0.5 * ya * (3.0 * stretch * stretch - 1.0));
        }
        [stretch * h / n, stretch * w * s / n]
    };
    let n = 400;
    let mut sums = [0.0; 2];
    for i in 0..=n {
        let weight = if i == 0 || i == n {
            1.0
        } else if i % 2 == 1 {
            4.0
        } else {
            2.0
        };
        let f = slope(l * i as f64 / n as f64);
        (0..2).for_each(|c| sums[c] += weight * f[c] * l / (3 * n) as f64);
    }
    sums
}

/// Irvine's closed form of the same for Hooke's law and small strains:
/// $`x=Hl/YA+(H/w)\,\mathrm{asinh}(wl/H)`$, $`z=wl^2/(2YA)+(H/w)(\sqrt{1+(wl/H)^2}-1)`$.
fn irvine(h: f64, w: f64, l: f64, ya: f64) -> [f64; 2] {
    let t = w * l / h;
    [h * l / ya + h / w * t.asinh(), 0.5 * w * l * l / ya + h / w * (t.hypot(1.0) - 1.0)]
}

/// Tension that makes the half span `x`, by bisection.
fn horizontal_tension(x: f64, w: f64, l: f64, ya: f64) -> f64 {
    let (mut low, mut high) = (1e-6 * w * l, 10.0 * ya);
    for _ in 0..200 {
        let h = f64::sqrt(low * high);
        if elastic_catenary(h, w, l, ya)[0] < x { low = h } else { high = h }
    }
    low
}

/// The elastic catenary: a soft cable as long as its span, stretched by about a
/// tenth by its weight; sag and end tension against the exact quadrature, which itself is checked against
/// Irvine's closed form where strains are small. Second order in the mesh.
#[test]
fn a_soft_cable_hangs_in_an_elastic_catenary() {
    let (span, area, density, g) = (2.0, 1e-4, 1000.0, 9.81);
    let w = area * density * g;
    let stiff = elastic_catenary(2.0, w, 1.0, 5e4);
    let hooke = irvine(2.0, w, 1.0, 5e4);
    assert!((0..2).all(|i| (stiff[i] / hooke[i] - 1.0).abs() < 1e-8), "{stiff:?} {hooke:?}");

    let young = 1e5;
    let h = horizontal_tension(0.5 * span, w, 0.5 * span, young * area);
    let [_, sag] = elastic_catenary(h, w, 0.5 * span, young * area);
    let found = [8, 16, 32].map(|n| {
        let m = chain(n, span, span);
        let law = TwoWay { youngs_modulus: young };
        let mut d = Dynamics::new(lines(&m, law, area, density), params(Scheme::newmark(), 0.0));
        for (i, x) in m.coords.iter().enumerate() {
            d.accepted.u[3 * i + 2] = -0.1 * (std::f64::consts::PI * x[0] / span).sin();
        }
        rest(&mut d, NOTHING, [0.0, 0.0, -g], 1e-8);
        let tension = d.system.loops()[0].tensions(&positions(&d))[n / 2];
        [-d.accepted.u[3 * (n / 2) + 2], tension]
    });
    let errors = found.map(|f| (f[0] / sag - 1.0).abs());
    let tension_errors = found.map(|f| (f[1] / h - 1.0).abs());
    println!(
        "elastic catenary: H {h:.4} N, sag {sag:.6} m; errors {} and {}",
        sci(&errors),
        sci(&tension_errors)
    );
    assert!(errors[2] < 1e-3 && tension_errors[2] < 1e-3, "{errors:?} {tension_errors:?}");
    assert!(orders(&errors).iter().all(|p| (p - 2.0).abs() < 0.2), "{errors:?}");
}
