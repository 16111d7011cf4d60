//! Small meshes for the verification tests.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};

use mesh::{Cable, CableKind, StructureMesh};

/// `n` cable elements along x from 0 to `span`, ends fixed, with given total rest length.
pub fn chain(n: usize, span: f64, rest_length: f64) -> StructureMesh {
    let node = |i: usize| [span * i as f64 / n as f64, 0.0, 0.0];
    let mut m = StructureMesh {
        coords: (0..=n).map(node).collect(),
        fixed: vec![(0, [true; 3]), (n as u32, [true; 3])],
        ..Default::default()
    };
    (0..n as u32).for_each(|i| add_cable(&mut m, [i, i + 1], rest_length / n as f64));
    m
}

pub fn add_cable(m: &mut StructureMesh, nodes: [u32; 2], rest_length: f64) {
    m.cables.push(Cable {
        nodes,
        rest_length,
        kind: CableKind::SuspensionLine,
        line: 0,
        share: 1.0,
        group: None,
    });
}

/// `n[0]` x `n[1]` quadrilaterals over the unit square, mapped to space; cut along
/// alternating diagonals, or all along the same one.
pub fn grid(n: [usize; 2], alternating: bool, map: impl Fn(f64, f64) -> [f64; 3]) -> StructureMesh {
    let node = |i: usize, j: usize| (i + (n[0] + 1) * j) as u32;
    let mut m = StructureMesh::default();
    for j in 0..=n[1] {
        for i in 0..=n[0] {
            m.coords.push(map(i as f64 / n[0] as f64, j as f64 / n[1] as f64));
        }
    }
    m.n_canopy = m.coords.len();
    for j in 0..n[1] {
        for i in 0..n[0] {
            let q @ [a, b, c, d] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
            let first = !alternating || (i + j) % 2 == 0;
            m.triangles.extend(if first { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] });
            m.triangle_face.extend([m.faces.len() as u32; 2]);
            m.faces.push(q);
            m.face_panel.push(0);
        }
    }
    m
}

/// Fixes the components of each node that `of` names for its position.
pub fn fix(m: &mut StructureMesh, of: impl Fn([f64; 3]) -> [bool; 3]) {
    for (i, x) in m.coords.iter().enumerate() {
        let components = of(*x);
        if components.contains(&true) {
            m.fixed.push((i as u32, components));
        }
    }
}

/// A square sheet of side `a` with `n` x `n` cells, rim fixed.
pub fn sheet(n: usize, a: f64) -> StructureMesh {
    let mut m = grid([n, n], true, |s, t| [a * s, a * t, 0.0]);
    fix(&mut m, |x| [x[..2].iter().any(|c| *c == 0.0 || *c == a); 3]);
    m
}

/// A sheet whose inner nodes are shifted, so that no two elements are alike.
pub fn irregular() -> StructureMesh {
    let mut m = sheet(4, 1.0);
    for (k, x) in m.coords.iter_mut().enumerate() {
        let inner = x[..2].iter().all(|c| *c > 0.1 && *c < 0.9);
        if inner {
            x[0] += 0.06 * ((k * 7 % 5) as f64 - 2.0) / 2.0;
            x[1] += 0.06 * ((k * 3 % 5) as f64 - 2.0) / 2.0;
        }
    }
    m
}

/// A quarter of the disc of radius `a`: `n` rings; symmetry planes x = 0 and y = 0,
/// rim fixed. Squares around the centre become circles.
pub fn quarter_disc(n: usize, a: f64) -> StructureMesh {
    let mut m = grid([n, n], false, |s, t| {
        let r = s.max(t);
        if r == 0.0 {
            return [0.0; 3];
        }
        let angle = if s >= t { FRAC_PI_4 * t / s } else { FRAC_PI_2 - FRAC_PI_4 * s / t };
        let (x, y) = (a * r * angle.cos(), a * r * angle.sin());
        [if s == 0.0 { 0.0 } else { x }, if t == 0.0 { 0.0 } else { y }, 0.0]
    });
    let rim = |x: [f64; 3]| x[0].hypot(x[1]) > a * (1.0 - 1e-9);
    fix(&mut m, |x| if rim(x) { [true; 3] } else { [x[0] == 0.0, x[1] == 0.0, false] });
    m
}

/// A quarter of a cylinder of radius `r` and length `r` about z: `n` cells around,
/// `n / 2` along; symmetry planes x = 0 and y = 0, ends held along z.
pub fn quarter_cylinder(n: usize, r: f64) -> StructureMesh {
    let mut m = grid([n, n / 2], true, |s, t| {
        let angle = FRAC_PI_2 * s;
        [if s == 1.0 { 0.0 } else { r * angle.cos() }, r * angle.sin(), r * t]
    });
    fix(&mut m, |x| [x[0] == 0.0, x[1] == 0.0, x[2] == 0.0 || x[2] == r]);
    m
}

/// An octant of a sphere of radius `r`: a face of the octahedron with `n` triangles
/// along its edges, blown up to the sphere; symmetry planes x, y, z = 0.
pub fn octant(n: usize, r: f64) -> StructureMesh {
    let mut m = StructureMesh::default();
    let start = |row: usize| row * (2 * (n + 1) + 1 - row) / 2;
    let node = |i: usize, j: usize| (start(j) + i) as u32;
    for j in 0..=n {
        for i in 0..=n - j {
            let p = [(n - i - j) as f64, i as f64, j as f64];
            let length = p.iter().map(|c| c * c).sum::<f64>().sqrt();
            m.coords.push(p.map(|c| r * c / length));
        }
    }
    for j in 0..n {
        for i in 0..n - j {
            m.triangles.push([node(i, j), node(i + 1, j), node(i, j + 1)]);
            if i + j + 1 < n {
                m.triangles.push([node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)]);
            }
        }
    }
    m.n_canopy = m.coords.len();
    m.faces = m.triangles.iter().map(|&[a, b, c]| [a, b, c, c]).collect();
    m.triangle_face = (0..m.triangles.len() as u32).collect();
    m.face_panel = vec![0; m.faces.len()];
    fix(&mut m, |x| x.map(|c| c == 0.0));
    m
}
