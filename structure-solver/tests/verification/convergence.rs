//! Orders of accuracy: Newton's method, space, time.

use std::f64::consts::PI;

use structure_solver::dynamics::Dynamics;
use structure_solver::loops::FaceLoad;
use structure_solver::materials::StVenantKirchhoff;
use structure_solver::scheme::Scheme;

use crate::common::*;
use crate::shapes::*;

/// Newton's residuals on a taut sheet fall quadratically: the exponent of the last
/// drop before rounding is near 2.
#[test]
fn newton_converges_quadratically_where_the_problem_is_smooth() {
    let m = sheet(8, 1.0);
    let system = membrane(&m, StVenantKirchhoff::isotropic(1e6, 0.3));
    let mut p = params(Scheme::newmark(), 0.0);
    p.linear_tolerance = 1e-13;
    p.newton.tolerance = 1e-11;
    let mut d = Dynamics::new(system, p);
    stretch(&mut d, 1.05);
    window(&mut d, 2e-3, 1, 2000.0, [0.0; 3]);
    let r = &d.newton.history;
    let smooth: Vec<f64> = r.iter().copied().filter(|r| *r > 1e-11).collect();
    let k = smooth.len();
    assert!(k >= 3, "{r:?}");
    let order = (smooth[k - 1] / smooth[k - 2]).ln() / (smooth[k - 2] / smooth[k - 3]).ln();
    println!("Newton: residuals {}, order {order:.2}", sci(r));
    assert!(order > 1.7, "order {order}: {r:?}");
}

/// A term `a sin(p X) sin(q Y)` of one displacement component.
struct Wave {
    a: f64,
    p: f64,
    q: f64,
}

impl Wave {
    /// Value, first derivatives by X and Y, second by XX, XY, YY.
    fn at(&self, x: f64, y: f64) -> (f64, [f64; 2], [f64; 3]) {
        let Wave { a, p, q } = *self;
        let ((sx, cx), (sy, cy)) = ((p * x).sin_cos(), (q * y).sin_cos());
        (
            a * sx * sy,
            [a * p * cx * sy, a * q * sx * cy],
            [-a * p * p * sx * sy, a * p * q * cx * cy, -a * q * q * sx * sy],
        )
    }
}

/// Pre-stretch of the manufactured solution, and its waves in x, y, z.
const STRETCH: f64 = 1.1;
const WAVES: [Wave; 3] = [
    Wave { a: 0.02, p: PI, q: 2.0 * PI },
    Wave { a: 0.03, p: 2.0 * PI, q: PI },
    Wave { a: 0.1, p: PI, q: PI },
];
const MATERIAL: [f64; 2] = [1e6, 0.3];

/// Manufactured position, and the traction on the deformed area that holds it.
///
/// Balance on the reference plane: $`b = -h\,\partial_\alpha(f_\beta S_{\alpha\beta})`$ with
/// the tangents $`f_\alpha=\partial_\alpha x`$, $`S=C:E`$ and
/// $`\partial_\gamma E_{\alpha\beta}=\tfrac12(f_{\alpha,\gamma}\cdot f_\beta+f_\alpha\cdot f_{\beta,\gamma})`$;
/// the traction is $`b/|f_1\times f_2|`$.
fn manufactured(x: f64, y: f64) -> ([f64; 3], [f64; 3]) {
    let mut place = [STRETCH * x, STRETCH * y, 0.0];
    // f[a][i], df[c][a][i]: derivative by c of the tangent a.
    let mut f = [[STRETCH, 0.0, 0.0], [0.0, STRETCH, 0.0]];
    let mut df = [[[0.0; 3]; 2]; 2];
    for i in 0..3 {
        let (u, d, dd) = WAVES[i].at(x, y);
        place[i] += u;
        (0..2).for_each(|a| f[a][i] += d[a]);
        for c in 0..2 {
            (0..2).for_each(|a| df[c][a][i] = dd[a + c]);
        }
    }
    let dot = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|i| a[i] * b[i]).sum::<f64>();
    let [young, nu] = MATERIAL;
    let k = young / (1.0 - nu * nu);
    let law = |e: [f64; 3]| [k * (e[0] + nu * e[1]), k * (e[1] + nu * e[0]), k * (1.0 - nu) * e[2]];
    let s = law([0.5 * (dot(&f[0], &f[0]) - 1.0), 0.5 * (dot(&f[1], &f[1]) - 1.0), 0.5 * dot(&f[0], &f[1])]);
    let ds: [[f64; 3]; 2] = std::array::from_fn(|c| {
        let g = &df[c];
        law([dot(&g[0], &f[0]), dot(&g[1], &f[1]), 0.5 * (dot(&g[0], &f[1]) + dot(&f[0], &g[1]))])
    });
    // S as a matrix from its values 11, 22, 12.
    let full = |s: &[f64; 3], a: usize, b: usize| if a == b { s[a] } else { s[2] };
    let n = [
        f[0][1] * f[1][2] - f[0][2] * f[1][1],
        f[0][2] * f[1][0] - f[0][0] * f[1][2],
        f[0][0] * f[1][1] - f[0][1] * f[1][0],
    ];
    let area = dot(&n, &n).sqrt();
    let mut t = [0.0; 3];
    for i in 0..3 {
        for a in 0..2 {
            for b in 0..2 {
                t[i] -= SHEET[0] / area * (df[a][b][i] * full(&s, a, b) + f[b][i] * full(&ds[a], a, b));
            }
        }
    }
    (place, t)
}

/// Spatial order 2 in displacement: a pre-stretched sheet in a strongly curved,
/// sheared shape (strains from 0.07 to 0.3), held by the traction that the strong form asks for.
/// Tractions are taken at the middle of each face, itself an error of second order.
#[test]
fn displacements_converge_with_order_two() {
    for element in [Element::Triangle, Element::Quad] {
        let errors = [8, 16, 32].map(|n| manufactured_error(n, element));
        let found = orders(&errors);
        println!("space, {element:?}: errors {}, orders {found:.3?}", sci(&errors));
        assert!(found.iter().all(|p| (p - 2.0).abs() < 0.15), "{found:?} {errors:?}");
        assert!(errors[2] < 2e-3 * WAVES[2].a, "{errors:?}");
    }
}

fn manufactured_error(n: usize, element: Element) -> f64 {
    let m = sheet(n, 1.0);
    let law = StVenantKirchhoff::isotropic(MATERIAL[0], MATERIAL[1]);
    let system = fabric(&m, law, element, None);
    let mut d = Dynamics::new(system, params(Scheme::newmark(), 0.0));
    stretch(&mut d, STRETCH);
    let middle = |q: &[u32; 4]| [0, 1].map(|c| q.iter().map(|&i| m.coords[i as usize][c]).sum::<f64>() / 4.0);
    let traction: Vec<f64> = m.faces.iter().map(middle).flat_map(|[x, y]| manufactured(x, y).1).collect();
    let load = FaceLoad { pressure: &vec![0.0; m.faces.len()], traction: &traction };
    rest(&mut d, load, [0.0; 3], 1e-8);
    let exact: Vec<f64> = m.coords.iter().flat_map(|x| manufactured(x[0], x[1]).0).collect();
    let e: Vec<f64> = positions(&d).iter().zip(&exact).map(|(a, b)| a - b).collect();
    // Mean over the area.
    norm(&e) / n as f64
}

/// Temporal order 2 on a smooth motion of large amplitude: a taut sheet with lines,
/// thrown out of its plane and along it, for half a period; the highest
/// frequency is resolved from the first step length on. The order is that of differences
/// between successive step lengths.
#[test]
fn motions_converge_with_order_two_in_time() {
    for scheme in [
        Scheme::newmark(),
        Scheme::generalized_alpha(1.0),
        Scheme::generalized_alpha(0.6),
        Scheme::generalized_alpha(0.0),
    ] {
        let end = |steps: u64| {
            let mut d = crate::energy::thrown(scheme, 1.05, 4.0);
            window(&mut d, 0.06, steps, 0.0, [0.0; 3]);
            positions(&d)
        };
        let ends = [200, 400, 800, 1600].map(end);
        let differences: Vec<f64> = ends
            .windows(2)
            .map(|e| norm(&e[0].iter().zip(&e[1]).map(|(a, b)| a - b).collect::<Vec<_>>()))
            .collect();
        let found = orders(&differences);
        println!("time, alpha_f {}: orders {found:.3?}", scheme.alpha_f);
        assert!((found[1] - 2.0).abs() < 0.1, "{scheme:?}: {found:?} {differences:?}");
    }
}
