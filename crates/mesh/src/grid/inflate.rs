//! A crude inflation for tests: explicit dynamics of the fabric as a tension
//! field under uniform pressure, heavily damped. Only the shape matters.

use crate::quality::{add, cross, dot, norm, scale, sub};
use crate::{StructureMesh, Vec3};

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

/// Positions of the canopy nodes after `steps` steps of `dt` (s) under `pressure` (Pa).
pub fn inflate(mesh: &StructureMesh, pressure: f64, dt: f64, steps: usize) -> Vec<Vec3> {
    let x0 = &mesh.coords;
    let mut mass = vec![1e-3; x0.len()];
    let elements: Vec<Element> = mesh
        .triangles
        .iter()
        .map(|t| {
            let nodes = t.map(|n| n as usize);
            let [a, b, c] = nodes.map(|n| x0[n]);
            let (u, v) = (sub(b, a), sub(c, a));
            let ex = scale(u, 1.0 / norm(u));
            let area = 0.5 * norm(cross(u, v));
            let ey_v = 2.0 * area / norm(u);
            let (m00, m01, m11) = (norm(u), dot(v, ex), ey_v);
            for n in nodes {
                mass[n] += area * THICKNESS * DENSITY / 3.0;
            }
            let inverse = [[1.0 / m00, -m01 / (m00 * m11)], [0.0, 1.0 / m11]];
            Element { nodes, inverse, area }
        })
        .collect();
    for c in &mesh.cables {
        for n in c.nodes {
            mass[n as usize] += 0.02;
        }
    }
    let mut x = x0.clone();
    let mut v = vec![[0.0; 3]; x.len()];
    let mut f = vec![[0.0; 3]; x.len()];
    for step in 0..steps {
        f.fill([0.0; 3]);
        let p = pressure * (1.0f64).min(step as f64 / (0.1 * steps as f64));
        for e in &elements {
            let [a, b, c] = e.nodes.map(|n| x[n]);
            let (u, w) = (sub(b, a), sub(c, a));
            let m = e.inverse;
            let f1 = scale(u, m[0][0]);
            let f2 = add(scale(u, m[0][1]), scale(w, m[1][1]));
            let s = stress([0.5 * (dot(f1, f1) - 1.0), 0.5 * (dot(f2, f2) - 1.0), 0.5 * dot(f1, f2)]);
            let h = e.area * THICKNESS;
            // First Piola stress columns, then nodal forces.
            let p1 = scale(add(scale(f1, s[0]), scale(f2, s[2])), h);
            let p2 = scale(add(scale(f1, s[2]), scale(f2, s[1])), h);
            let fb = add(scale(p1, m[0][0]), scale(p2, m[0][1]));
            let fc = scale(p2, m[1][1]);
            let push = scale(cross(u, w), p / 6.0);
            for (n, force) in [(0, add(fb, fc)), (1, scale(fb, -1.0)), (2, scale(fc, -1.0))] {
                f[e.nodes[n]] = add(f[e.nodes[n]], add(force, push));
            }
        }
        for c in &mesh.cables {
            let [a, b] = c.nodes.map(|n| n as usize);
            let d = sub(x[b], x[a]);
            let length = norm(d);
            let pull = (CABLE_EA * (length / c.rest_length - 1.0)).max(0.0) / length;
            f[a] = add(f[a], scale(d, pull));
            f[b] = sub(f[b], scale(d, pull));
        }
        for i in 0..x.len() {
            v[i] = scale(add(v[i], scale(f[i], dt / mass[i])), 1.0 / (1.0 + 8.0 * dt));
        }
        for &(n, fixed) in &mesh.fixed {
            for (a, &fixed) in fixed.iter().enumerate() {
                if fixed {
                    v[n as usize][a] = 0.0;
                }
            }
        }
        for i in 0..x.len() {
            x[i] = add(x[i], scale(v[i], dt));
        }
    }
    x.truncate(mesh.n_canopy);
    x
}
