//! A small grid for tests, benchmarks and trials without a scene: a box of
//! mixed cells with a plate of zero thickness inside.

use mesh::{FlowGrid, Patch, StructureMesh, Vec3};

/// A box `[-1, 1]^3` with `n^3` hexahedra (`n` even, at least 4) and a square plate
/// of half the width in its middle plane `z = 0`, whose nodes are the canopy.
///
/// `wiggle` moves interior nodes off the plate by that share of a cell;
/// `stretch` below 1 thins the layers towards the plate by that ratio each;
/// with `mixed`, every third column of cells is cut into prisms and every
/// seventh cell elsewhere into six pyramids, so faces still match.
pub fn plate_in_box(n: usize, wiggle: f64, stretch: f64, mixed: bool) -> FlowGrid {
    plate_with_margin(n, n.div_ceil(4), wiggle, stretch, mixed)
}

/// As [`plate_in_box`], the plate's edge being `margin` cells from the sides of the box.
pub fn plate_with_margin(n: usize, margin: usize, wiggle: f64, stretch: f64, mixed: bool) -> FlowGrid {
    assert!(n >= 4 && n.is_multiple_of(2), "the plate needs a middle plane");
    let m = n + 1;
    let at = |i: usize, j: usize, k: usize| (i + m * (j + m * k)) as u32;
    let even = |i: usize| 2.0 * i as f64 / n as f64 - 1.0;
    let half = n / 2;
    let total: f64 = (0..half).map(|l| stretch.powi((half - l) as i32)).sum();
    let height = |k: usize| {
        let layers = k.abs_diff(half);
        let z: f64 = (0..layers).map(|l| stretch.powi((half - l) as i32)).sum::<f64>() / total;
        if k < half { -z } else { z }
    };
    let cut = |i: usize, j: usize| mixed && (i + 2 * j).is_multiple_of(3);
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c, c], [a, c, d, d]];
    let on_plate = |i: usize| (margin..=n - margin).contains(&i);
    let mut grid = FlowGrid::default();
    for k in 0..m {
        for j in 0..m {
            for i in 0..m {
                let mut p: Vec3 = [even(i), even(j), height(k)];
                let inside = [i, j, k].iter().all(|&a| a > 0 && a < n);
                if inside && k != half {
                    let h = [
                        2.0 / n as f64,
                        2.0 / n as f64,
                        (height(k + 1) - height(k)).min(height(k) - height(k - 1)),
                    ];
                    let s = at(i, j, k) as f64;
                    for c in 0..3 {
                        p[c] += wiggle * h[c] * ((c as f64 + 1.3) * 12.9 * s).sin();
                    }
                }
                grid.coords.push(p);
                if k == half && on_plate(i) && on_plate(j) {
                    grid.canopy_nodes.push(at(i, j, k));
                }
            }
        }
    }
    let canopy = |a: u32| grid.canopy_nodes.binary_search(&a).is_ok();
    for j in 0..n {
        for i in 0..n {
            let f = [at(i, j, half), at(i + 1, j, half), at(i + 1, j + 1, half), at(i, j + 1, half)];
            if f.iter().all(|&a| canopy(a)) {
                if cut(i, j) {
                    grid.canopy_faces.extend(halves(f));
                } else {
                    grid.canopy_faces.push(f);
                }
            }
        }
    }
    for k in 0..n {
        for j in 0..n {
            for i in 0..n {
                let f = |k| [at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k)];
                let ([a, b, c, d], [e, g, h, l]) = (f(k), f(k + 1));
                if cut(i, j) {
                    grid.cells.push([a, b, c, c, e, g, h, h]);
                    grid.cells.push([a, c, d, d, e, h, l, l]);
                } else if mixed && (i + n * (j + n * k)).is_multiple_of(7) {
                    let cell = [a, b, c, d, e, g, h, l];
                    let mut o = [0.0; 3];
                    for v in cell {
                        for (o, x) in o.iter_mut().zip(grid.coords[v as usize]) {
                            *o += x / 8.0;
                        }
                    }
                    let o_index = grid.coords.len() as u32;
                    grid.coords.push(o);
                    for face in mesh::HEX_FACES {
                        // Turned inwards, the face is a base that looks at the apex.
                        let q = [face[0], face[3], face[2], face[1]].map(|v| cell[v]);
                        grid.cells.push([q[0], q[1], q[2], q[3], o_index, o_index, o_index, o_index]);
                    }
                } else {
                    grid.cells.push([a, b, c, d, e, g, h, l]);
                }
                let cell = [a, b, c, d, e, g, h, l];
                for (face, outer) in
                    mesh::HEX_FACES.iter().zip([k == 0, k + 1 == n, j == 0, i + 1 == n, j + 1 == n, i == 0])
                {
                    if !outer {
                        continue;
                    }
                    let quad = face.map(|v| cell[v]);
                    let flat = face == &mesh::HEX_FACES[0] || face == &mesh::HEX_FACES[1];
                    if flat && cut(i, j) {
                        grid.boundary.extend(halves(quad).map(|f| (Patch::FarField, f)));
                    } else {
                        grid.boundary.push((Patch::FarField, quad));
                    }
                }
            }
        }
    }
    grid
}

/// The plate as the canopy of a structure, unstressed where the grid has it.
pub fn plate_structure(grid: &FlowGrid) -> StructureMesh {
    let of_grid = |a: u32| {
        grid.canopy_nodes.iter().position(|&b| a == b).expect("canopy faces have canopy nodes") as u32
    };
    StructureMesh {
        coords: grid.canopy_nodes.iter().map(|&a| grid.coords[a as usize]).collect(),
        n_canopy: grid.canopy_nodes.len(),
        faces: grid.canopy_faces.iter().map(|f| f.map(of_grid)).collect(),
        face_panel: vec![0; grid.canopy_faces.len()],
        ..StructureMesh::default()
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn faces_match() {
        for mixed in [false, true] {
            let grid = super::plate_in_box(8, 0.1, 0.8, mixed);
            let faces = mesh::FaceTable::new(&grid).unwrap();
            assert_eq!(faces.canopy.len(), grid.canopy_faces.len());
        }
    }
}
