//! A tension field with a closed form: a strip in bending.

use structure_solver::dynamics::Dynamics;
use structure_solver::loops::{Configuration, FaceLoad};
use structure_solver::materials::TensionField;
use structure_solver::scheme::Scheme;

use crate::common::*;
use crate::shapes::*;

/// Stein and Hedgepeth's moment 2M/(Ph) and band of wrinkles b/h for a curvature kappa*.
///
/// A section carries tension that grows linearly from the border of the wrinkles at height b:
/// $`P=\tfrac12 Et\kappa(h-b)^2`$, acting at $`h-(h-b)/3`$, so $`M/(Ph)=\tfrac16+b/(3h)`$. With
/// $`\kappa^*=Et h^2\kappa/(2P)`$: $`b/h=1-1/\sqrt{\kappa^*}`$ and $`2M/(Ph)=1-\tfrac23/\sqrt{\kappa^*}`$;
/// without wrinkles, $`\kappa^*\le1`$, $`2M/(Ph)=\kappa^*/3`$.
pub fn stein_hedgepeth(kappa_star: f64) -> [f64; 2] {
    if kappa_star > 1.0 {
        let share = 1.0 / kappa_star.sqrt();
        [1.0 - 2.0 / 3.0 * share, 1.0 - share]
    } else {
        [kappa_star / 3.0, 0.0]
    }
}

/// A square strip of `n` x `n` faces whose ends are turned as plane sections; their stretch
/// is such that kappa* becomes `kappa_star`. Returns kappa*, 2M/(Ph) and b/h as found from
/// the forces on an end and from the elements of the middle half that carry nothing.
/// Strains of 1e-4 keep the shape.
pub fn bend(element: Element, n: usize, kappa_star: f64) -> [f64; 3] {
    let (h, young, nu) = (1.0, 1e9, 0.3);
    let mut m = grid([n, n], true, |s, t| [h * s, h * t, 0.0]);
    fix(&mut m, |x| [x[0] == 0.0 || x[0] == h, x[0] == 0.0 && x[1] == 0.5 * h, true]);
    let mut d = Dynamics::new(
        fabric(&m, TensionField::new(young, nu), element, None),
        params(Scheme::newmark(), 0.0),
    );
    // Strain at height y is kappa (y - zero): zero is b, or lies below the strip.
    let zero = if kappa_star > 1.0 {
        h * stein_hedgepeth(kappa_star)[1]
    } else {
        0.5 * h * (1.0 - 1.0 / kappa_star)
    };
    let kappa = 1e-4 / (h - zero);
    for (i, x) in m.coords.iter().enumerate() {
        d.accepted.u[3 * i] = x[0] * kappa * (x[1] - zero);
    }
    let pressure = vec![0.0; m.faces.len()];
    let load = FaceLoad { pressure: &pressure, traction: &[] };
    // Without a load residuals are measured against a hundredth of the inner forces:
    // 1e-6 of these. Slack fabric in its plane has nothing to find a sharper balance by.
    rest(&mut d, load, [0.0; 3], 1e-4);
    let x = positions(&d);
    let mut f = vec![0.0; x.len()];
    d.system.forces(Configuration::only(&x), load, &mut f);
    let (mut tension, mut moment) = (0.0, 0.0);
    for (i, p) in m.coords.iter().enumerate().filter(|(_, p)| p[0] == h) {
        tension += f[3 * i];
        moment += f[3 * i] * (p[1] - 0.5 * h);
    }
    let slack = d.system.model.triangles.iter().zip(d.system.loops()[0].stresses(&x)).filter(|(t, s)| {
        let middle = t.nodes.iter().map(|&n| m.coords[n as usize][0]).sum::<f64>() / 3.0;
        (middle / h - 0.5).abs() < 0.25 && s.0[0] < 1e-3 * young * 1e-4
    });
    let band = slack.count() as f64 / (n * n) as f64;
    [young * SHEET[0] * h * h * kappa / (2.0 * tension), 2.0 * moment / (tension * h), band]
}

/// Pure bending of a strip of height h under a tension P (Stein and Hedgepeth, NASA
/// TN D-813, 1961). The error is that of constant strains in bending, 1/n^2 for n elements over the
/// height, which also step over the border of the wrinkles.
#[test]
fn a_strip_in_bending_wrinkles_as_stein_and_hedgepeth_say() {
    for (element, n, kappa_star) in [
        (Element::Triangle, 24, 0.5),
        (Element::Triangle, 24, 1.0),
        (Element::Triangle, 24, 2.0),
        (Element::Triangle, 24, 4.0),
        (Element::Triangle, 24, 9.0),
        (Element::Quad, 12, 4.0),
    ] {
        let [found, moment, band] = bend(element, n, kappa_star);
        let [exact, border] = stein_hedgepeth(kappa_star);
        println!(
            "strip, {element:?}, kappa* {kappa_star}: {found:.4}; 2M/Ph {moment:.4} beside {exact:.4}; band {band:.3} beside {border:.3}"
        );
        assert!(
            (found / kappa_star - 1.0).abs() < 0.01 && (moment - exact).abs() < 0.005,
            "{found} {moment}"
        );
        // To one row of elements.
        assert!((band - border).abs() < 1.0 / n as f64, "{band}");
    }
}
