//! Membranes blown up by pressure: Hencky's disc, cylinder, sphere.

use structure_solver::dynamics::Dynamics;
use structure_solver::materials::{Material, StVenantKirchhoff};
use structure_solver::model::Warp;
use structure_solver::scheme::Scheme;

use crate::common::*;
use crate::shapes::*;

const TERMS: usize = 60;

/// Hencky's solution for a clamped disc (Z. Math. Phys. 63, 1915), by its series.
///
/// Balance: $`N_r w' = -qr/2`$ across, $`N_\theta=(rN_r)'`$ in the plane; compatibility:
/// $`r(N_r+N_\theta)' = -\tfrac12 Eh\,w'^2`$. With $`\rho=r/a`$ and
/// $`N_r=\tfrac14(Ehq^2a^2)^{1/3}B(\rho)`$ these give $`B^2(B''+3B'/\rho)=-8`$, solved by
/// $`B=\sum b_{2n}\rho^{2n}`$: order by order, $`\sum_j C_j D_{m-j} = -8\,\delta_{m0}`$ for the
/// coefficients $`C`$ of $`B^2`$ and $`D_m=(2m+2)(2m+4)b_{2m+2}`$. So $`b_2=-1/b_0^2`$; $`b_0`$
/// follows from $`u_r(a)=0`$: $`(1-\nu)B(1)+B'(1)=0`$. Last,
/// $`w=2a(qa/Eh)^{1/3}\int_\rho^1 s/B\,ds`$.
struct Hencky {
    b: [f64; TERMS],
}

impl Hencky {
    fn series(b0: f64) -> [f64; TERMS] {
        let (mut b, mut c, mut d) = ([0.0; TERMS], [0.0; TERMS], [0.0; TERMS]);
        b[0] = b0;
        for m in 0..TERMS - 1 {
            c[m] = (0..=m).map(|j| b[j] * b[m - j]).sum();
            let known: f64 = (1..=m).map(|j| c[j] * d[m - j]).sum();
            d[m] = (if m == 0 { -8.0 } else { 0.0 } - known) / c[0];
            b[m + 1] = d[m] / ((2 * m + 2) * (2 * m + 4)) as f64;
        }
        b
    }

    fn new(nu: f64) -> Self {
        let clamped = |b0: f64| {
            let b = Self::series(b0);
            (0..TERMS).map(|n| (1.0 - nu + 2.0 * n as f64) * b[n]).sum::<f64>()
        };
        let (mut low, mut high) = (1.2, 3.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if clamped(middle) < 0.0 { low = middle } else { high = middle }
        }
        Self { b: Self::series(low) }
    }

    /// B and its radial derivative.
    fn at(&self, rho: f64) -> [f64; 2] {
        let mut sums = [0.0; 2];
        for (n, b) in self.b.iter().enumerate() {
            sums[0] += b * rho.powi(2 * n as i32);
            sums[1] += 2.0 * n as f64 * b * rho.powi(2 * n as i32 - 1);
        }
        sums
    }

    /// Deflection over a (qa/Eh)^(1/3), by Simpson's rule.
    fn deflection(&self, rho: f64) -> f64 {
        let n = 200;
        let f = |s: f64| s / self.at(s)[0];
        let sum: f64 = (0..=n)
            .map(|i| {
                let weight = if i == 0 || i == n {
                    1.0
                } else if i % 2 == 1 {
                    4.0
                } else {
                    2.0
                };
                weight * f(rho + (1.0 - rho) * i as f64 / n as f64)
            })
            .sum();
        2.0 * sum * (1.0 - rho) / (3 * n) as f64
    }
}

#[test]
fn henckys_series_has_its_known_constants() {
    let h = Hencky::new(0.3);
    // Fichter, NASA TP-3658 (1997), table 1: b0 = 1.7244; deflection 0.653.
    assert!((h.b[0] - 1.7244).abs() < 1e-4, "{}", h.b[0]);
    assert!((h.b[2] + 2.0 / (3.0 * h.b[0].powi(5))).abs() < 1e-14);
    assert!((h.deflection(0.0) - 0.653).abs() < 5e-4, "{}", h.deflection(0.0));
    // The last terms no longer count.
    assert!(h.b[TERMS - 1].abs() < 1e-12, "{}", h.b[TERMS - 1]);
}

/// Hencky's circular membrane, nu = 0.3, deflection and stress, on three meshes. His theory is for small
/// slopes: q a / (E h) = 1e-6 makes slopes of 0.01 to 0.02, an error of their square, 3e-4.
#[test]
fn circular_membrane_rises_as_hencky_says() {
    let (a, young, nu) = (1.0, 1e9, 0.3);
    let h = SHEET[0];
    let q = 1e-6 * young * h / a;
    let exact = Hencky::new(nu);
    let rise = a * (q * a / (young * h)).cbrt();
    let stress = 0.25 * (young * h * q * q * a * a).cbrt() / h;
    for element in [Element::Triangle, Element::Quad] {
        let found = [8, 16, 32].map(|n| {
            let m = quarter_disc(n, a);
            let mut d = Dynamics::new(
                fabric(&m, StVenantKirchhoff::isotropic(young, nu), element, None),
                params(Scheme::newmark(), 0.0),
            );
            rest_under(&mut d, q);
            let x = positions(&d);
            let mut shape = 0.0f64;
            for (i, p) in m.coords.iter().enumerate() {
                let w = rise * exact.deflection(p[0].hypot(p[1]) / a);
                shape = shape.max((x[3 * i + 2] - w).abs() / rise);
            }
            // Mean square error of the principal stresses over the elements, by their reference areas.
            let (mut error, mut area) = (0.0, 0.0);
            let fabric = d.system.loops()[0].stresses(&x);
            for (t, (s, _)) in d.system.model.triangles.iter().zip(fabric) {
                let p = t.nodes.map(|n| m.coords[n as usize]);
                let rho = [0, 1].map(|c| (p[0][c] + p[1][c] + p[2][c]) / 3.0);
                let rho = rho[0].hypot(rho[1]) / a;
                let [b, slope] = exact.at(rho);
                let [radial, hoop] = [b, b + rho * slope].map(|b| stress * b);
                let size = t.reference.area;
                error += size * ((s[0] - radial).powi(2) + (s[1] - hoop).powi(2));
                area += size;
            }
            let centre = d.system.loops()[0].stresses(&x)[0].0;
            [
                x[2] / (rise * exact.deflection(0.0)) - 1.0,
                shape,
                (error / area).sqrt() / (stress * exact.b[0]),
                0.5 * (centre[0] + centre[1]) / (stress * exact.b[0]) - 1.0,
            ]
        });
        found.iter().for_each(|f| {
            println!("Hencky, {element:?}: centre, shape, stress (mean square), central stress: {}", sci(f))
        });
        let finest = found[2];
        assert!(
            finest[0].abs() < 2e-3 && finest[1] < 2e-3 && finest[2] < 2e-2 && finest[3].abs() < 1e-2,
            "{found:?}"
        );
    }
}

/// Cylinder under pressure, large strain, axis held. Hoop stretch l: S = C (l^2 - 1) / 2 with
/// C = E1 / (1 - nu12 nu21); tension per deformed length h S l = p l R, so
/// l^2 = 1 + 2 p R / (C h). A cylinder of n flat facets to a quarter, each of angle a = pi / 2n, balances
/// its corners by 2 T sin(a/2) = p l c cos(a/2) with the chord c = 2 R sin(a/2): in all
/// formulas R becomes R cos(a/2), which bilinear elements meet exactly. Triangles share the load of a
/// facet unevenly among its nodes; they come to it, and to the circle, with order 2.
fn cylinder(law: impl Material + Copy, c: f64, element: Element) {
    let r = 0.5;
    let p = 0.4 * c * SHEET[0] / r;
    let stretch = |r_eff: f64| (1.0 + 2.0 * p * r_eff / (c * SHEET[0])).sqrt();
    let found = [8, 16, 32].map(|n| {
        let m = quarter_cylinder(n, r);
        let mut d =
            Dynamics::new(fabric(&m, law, element, Some(Warp::FirstEdge)), params(Scheme::newmark(), 0.0));
        rest_under(&mut d, p);
        let x = positions(&d);
        let mean =
            x.as_chunks::<3>().0.iter().map(|x| x[0].hypot(x[1]) / r).sum::<f64>() / m.coords.len() as f64;
        let s = d.system.loops()[0].stresses(&x);
        let hoop = s.iter().map(|s| s.0[0]).sum::<f64>() / s.len() as f64;
        let apothem = r * (std::f64::consts::PI / (4 * n) as f64).cos();
        [mean / stretch(r) - 1.0, hoop / (p * r / SHEET[0]) - 1.0, mean / stretch(apothem) - 1.0]
    });
    found
        .iter()
        .for_each(|f| println!("cylinder, {element:?}: stretch, hoop stress, stretch of facets {}", sci(f)));
    let [radius, hoop, facets] = [0, 1, 2].map(|i| found.map(|f| f[i].abs()));
    assert!(radius[2] < 1e-3 && hoop[2] < 1e-3, "{found:?}");
    assert!(orders(&radius).iter().chain(&orders(&hoop)).all(|p| (p - 2.0).abs() < 0.2), "{found:?}");
    if element == Element::Quad {
        // Solved to 1e-8 of the load.
        assert!(facets.iter().all(|e| *e < 1e-7), "{found:?}");
    }
}

#[test]
fn cylinders_swell_as_they_must() {
    let (young, nu) = (1e6, 0.3);
    cylinder(StVenantKirchhoff::isotropic(young, nu), young / (1.0 - nu * nu), Element::Triangle);
    cylinder(StVenantKirchhoff::isotropic(young, nu), young / (1.0 - nu * nu), Element::Quad);
    // Warp around, three times as stiff as the weft.
    let weft = young / 3.0;
    let c = young / (1.0 - nu * nu * weft / young);
    cylinder(StVenantKirchhoff::orthotropic(young, weft, nu, 2e5), c, Element::Triangle);
    cylinder(StVenantKirchhoff::orthotropic(young, weft, nu, 2e5), c, Element::Quad);
}

/// Sphere under pressure, large strain. Stretch l in all directions: S = E (l^2 - 1) / (2 (1 - nu)); tension
/// per deformed length h S = p l R / 2, so l^2 - 1 = q l with q = p R (1 - nu) / (E h).
#[test]
fn sphere_swells_as_it_must() {
    let (r, young, nu) = (0.5, 1e6, 0.3);
    let q = 0.7;
    let p = q * young * SHEET[0] / (r * (1.0 - nu));
    let exact = 0.5 * (q + (q * q + 4.0f64).sqrt());
    let stress = 0.5 * p * exact * r / SHEET[0];
    let found = [8, 16, 32].map(|n| {
        let m = octant(n, r);
        let mut d = Dynamics::new(
            membrane(&m, StVenantKirchhoff::isotropic(young, nu)),
            params(Scheme::newmark(), 0.0),
        );
        rest_under(&mut d, p);
        let x = positions(&d);
        let stretch = x.as_chunks::<3>().0.iter().map(|x| norm(x) / r).sum::<f64>() / m.coords.len() as f64;
        let s = d.system.loops()[0].stresses(&x);
        let mean = s.iter().map(|s| 0.5 * (s.0[0] + s.0[1])).sum::<f64>() / s.len() as f64;
        [stretch / exact - 1.0, mean / stress - 1.0]
    });
    found.iter().for_each(|f| println!("sphere, stretch {exact:.4}: stretch, stress {}", sci(f)));
    let [stretch, tension] = [0, 1].map(|i| found.map(|f| f[i].abs()));
    assert!(stretch[2] < 2e-3 && tension[2] < 2e-3, "{found:?}");
    assert!(orders(&stretch).iter().chain(&orders(&tension)).all(|p| (p - 2.0).abs() < 0.2), "{found:?}");
}
