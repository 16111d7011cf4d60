//! A crude inflation for tests: explicit dynamics of the fabric as a tension
//! field under uniform pressure, heavily damped. Only the shape matters.

use crate::StructureMesh;
use crate::geometry::{Point, Vec3};

/// Stiffness and mass as in the paper's Table 2.
const YOUNG: f64 = 9.5648e6;
const POISSON: f64 = 0.3;
const THICKNESS: f64 = 3.048e-5;
const DENSITY: f64 = 1223.5;
const CABLE_EA: f64 = 5.342e8 * 3.11e-6;

struct Element {
    nodes: [usize; 3],
    /// Inverse of the edge matrix in the plane of the unstressed triangle.
    inverse: [[f64; 2]; 2],
    area: f64,
}

/// Second Piola-Kirchhoff stress of a tension field from Green's strain.
fn stress(e: [f64; 3]) -> [f64; 3] {
    let [xx, yy, xy] = e;
    let (mean, radius) = (0.5 * (xx + yy), (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt());
    let (e1, e2) = (mean + radius, mean - radius);
    let (s1, s2) = if e1 <= 0.0 {
        (0.0, 0.0)
    } else if e2 + POISSON * e1 <= 0.0 {
        (YOUNG * e1, 0.0)
    } else {
        let k = YOUNG / (1.0 - POISSON * POISSON);
        (k * (e1 + POISSON * e2), k * (e2 + POISSON * e1))
    };
    let (c, s) = if radius > 0.0 {
        let angle = 0.5 * xy.atan2(0.5 * (xx - yy));
        (angle.cos(), angle.sin())
    } else {
        (1.0, 0.0)
    };
    [s1 * c * c + s2 * s * s, s1 * s * s + s2 * c * c, (s1 - s2) * c * s]
}

impl Element {
    fn new(t: [u32; 3], x0: &[Vec3]) -> Self {
        let nodes = t.map(|n| n as usize);
        let [a, b, c] = nodes.map(|n| x0[n]);
        let (u, v) = (b - a, c - a);
        let ex = u * (1.0 / u.norm());
        let area = 0.5 * u.cross(&v).norm();
        let (m00, m01, m11) = (u.norm(), v.dot(&ex), 2.0 * area / u.norm());
        Element { nodes, inverse: [[1.0 / m00, -m01 / (m00 * m11)], [0.0, 1.0 / m11]], area }
    }

    /// Adds the forces of the stress and of the pressure jump `p` (Pa).
    fn add_force(&self, x: &[Vec3], p: f64, f: &mut [Vec3]) {
        let [a, b, c] = self.nodes.map(|n| x[n]);
        let (u, w) = (b - a, c - a);
        let m = self.inverse;
        let f1 = u * m[0][0];
        let f2 = u * m[0][1] + w * m[1][1];
        let s = stress([0.5 * (f1.dot(&f1) - 1.0), 0.5 * (f2.dot(&f2) - 1.0), 0.5 * f1.dot(&f2)]);
        let h = self.area * THICKNESS;
        // First Piola stress columns, then nodal forces.
        let p1 = (f1 * s[0] + f2 * s[2]) * h;
        let p2 = (f1 * s[2] + f2 * s[1]) * h;
        let fb = p1 * m[0][0] + p2 * m[0][1];
        let fc = p2 * m[1][1];
        let push = u.cross(&w) * (p / 6.0);
        for (n, force) in [(0, fb + fc), (1, -fb), (2, -fc)] {
            f[self.nodes[n]] += force + push;
        }
    }
}

/// Positions of the canopy nodes after `steps` steps of `dt` (s) under `pressure` (Pa).
pub fn inflate(mesh: &StructureMesh, pressure: f64, dt: f64, steps: usize) -> Vec<Point> {
    let x0: Vec<Vec3> = mesh.coords.iter().map(|&x| x.into()).collect();
    let elements: Vec<Element> = mesh.triangles.iter().map(|t| Element::new(*t, &x0)).collect();
    let mut mass = vec![1e-3; x0.len()];
    for e in &elements {
        e.nodes.iter().for_each(|&n| mass[n] += e.area * THICKNESS * DENSITY / 3.0);
    }
    for c in &mesh.cables {
        c.nodes.iter().for_each(|&n| mass[n as usize] += 0.02);
    }
    let mut x = x0;
    let mut v = vec![Vec3::zeros(); x.len()];
    let mut f = vec![Vec3::zeros(); x.len()];
    for step in 0..steps {
        f.fill(Vec3::zeros());
        let p = pressure * (1.0f64).min(step as f64 / (0.1 * steps as f64));
        elements.iter().for_each(|e| e.add_force(&x, p, &mut f));
        for c in &mesh.cables {
            let [a, b] = c.nodes.map(|n| n as usize);
            let d = x[b] - x[a];
            let length = d.norm();
            let pull = (CABLE_EA * (length / c.rest_length - 1.0)).max(0.0) / length;
            f[a] += d * pull;
            f[b] -= d * pull;
        }
        for i in 0..x.len() {
            v[i] = (v[i] + f[i] * (dt / mass[i])) * (1.0 / (1.0 + 8.0 * dt));
        }
        for &(n, fixed) in &mesh.fixed {
            for (a, _) in fixed.iter().enumerate().filter(|(_, fixed)| **fixed) {
                v[n as usize][a] = 0.0;
            }
        }
        for i in 0..x.len() {
            x[i] += v[i] * dt;
        }
    }
    x.into_iter().take(mesh.n_canopy).map(Point::from).collect()
}
