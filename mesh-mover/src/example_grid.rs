//! A small grid for tests and benchmarks without a scene: a box of mixed cells with a plate of zero thickness inside.

use mesh::{FlowGrid, Patch, StructureMesh};

/// A box `[-1, 1]^3` with `n^3` hexahedra (`n` even, at least 4) and a square plate
/// of half the width in its middle plane `z = 0`, whose nodes are the canopy.
///
/// `wiggle` moves interior nodes off the plate by that fraction of a cell; `stretch` below 1 reduces the height of
/// the layers towards the plate by that ratio each; with `mixed`, every third column of cells is cut into prisms and
/// every seventh cell elsewhere into six pyramids, so that faces match.
pub fn plate_in_box(n: usize, wiggle: f64, stretch: f64, mixed: bool) -> FlowGrid {
    plate_with_margin(n, n.div_ceil(4), wiggle, stretch, mixed)
}

/// As [`plate_in_box`], with the plate's edge `margin` cells from the sides of the box.
pub fn plate_with_margin(n: usize, margin: usize, wiggle: f64, stretch: f64, mixed: bool) -> FlowGrid {
    assert!(n >= 4 && n.is_multiple_of(2), "the plate needs a middle plane");
    let plan = Plan { n, margin, wiggle, stretch, mixed };
    let mut grid = FlowGrid::default();
    plan.add_nodes(&mut grid);
    plan.add_plate(&mut grid);
    for k in 0..n {
        for j in 0..n {
            for i in 0..n {
                plan.add_cells([i, j, k], &mut grid);
                plan.add_boundary([i, j, k], &mut grid);
            }
        }
    }
    grid
}

/// Parameters of [`plate_with_margin`].
struct Plan {
    n: usize,
    margin: usize,
    wiggle: f64,
    stretch: f64,
    mixed: bool,
}

impl Plan {
    fn at(&self, i: usize, j: usize, k: usize) -> u32 {
        let m = self.n + 1;
        (i + m * (j + m * k)) as u32
    }

    /// Height of layer `k` of nodes, m.
    fn height(&self, k: usize) -> f64 {
        let half = self.n / 2;
        let total: f64 = (0..half).map(|l| self.stretch.powi((half - l) as i32)).sum();
        let layers = k.abs_diff(half);
        let z: f64 = (0..layers).map(|l| self.stretch.powi((half - l) as i32)).sum::<f64>() / total;
        if k < half { -z } else { z }
    }

    /// Whether a column of cells is cut into prisms.
    fn cut(&self, i: usize, j: usize) -> bool {
        self.mixed && (i + 2 * j).is_multiple_of(3)
    }

    fn add_nodes(&self, grid: &mut FlowGrid) {
        let (n, half) = (self.n, self.n / 2);
        let even = |i: usize| 2.0 * i as f64 / n as f64 - 1.0;
        let heights: Vec<f64> = (0..=n).map(|k| self.height(k)).collect();
        let on_plate = |i: usize| (self.margin..=n - self.margin).contains(&i);
        for k in 0..=n {
            for j in 0..=n {
                for i in 0..=n {
                    let mut p = [even(i), even(j), heights[k]];
                    let inside = [i, j, k].iter().all(|&a| a > 0 && a < n);
                    if inside && k != half {
                        let layer = (heights[k + 1] - heights[k]).min(heights[k] - heights[k - 1]);
                        let h = [2.0 / n as f64, 2.0 / n as f64, layer];
                        let s = self.at(i, j, k) as f64;
                        for c in 0..3 {
                            p[c] += self.wiggle * h[c] * ((c as f64 + 1.3) * 12.9 * s).sin();
                        }
                    }
                    grid.coords.push(p);
                    if k == half && on_plate(i) && on_plate(j) {
                        grid.canopy_nodes.push(self.at(i, j, k));
                    }
                }
            }
        }
    }

    /// Faces of the canopy, after its nodes.
    fn add_plate(&self, grid: &mut FlowGrid) {
        for j in 0..self.n {
            for i in 0..self.n {
                let f = self.base(i, j, self.n / 2);
                if !f.iter().all(|a| grid.canopy_nodes.binary_search(a).is_ok()) {
                    continue;
                }
                if self.cut(i, j) {
                    grid.canopy_faces.extend(halves(f));
                } else {
                    grid.canopy_faces.push(f);
                }
            }
        }
    }

    /// Lower face of the hexahedron at `i`, `j`, `k`.
    fn base(&self, i: usize, j: usize, k: usize) -> [u32; 4] {
        [self.at(i, j, k), self.at(i + 1, j, k), self.at(i + 1, j + 1, k), self.at(i, j + 1, k)]
    }

    fn hexahedron(&self, [i, j, k]: [usize; 3]) -> [u32; 8] {
        let ([a, b, c, d], [e, g, h, l]) = (self.base(i, j, k), self.base(i, j, k + 1));
        [a, b, c, d, e, g, h, l]
    }

    /// A hexahedron, or the prisms or pyramids that it is cut into.
    fn add_cells(&self, [i, j, k]: [usize; 3], grid: &mut FlowGrid) {
        let n = self.n;
        let cell @ [a, b, c, d, e, g, h, l] = self.hexahedron([i, j, k]);
        if self.cut(i, j) {
            grid.cells.push([a, b, c, c, e, g, h, h]);
            grid.cells.push([a, c, d, d, e, h, l, l]);
        } else if self.mixed && (i + n * (j + n * k)).is_multiple_of(7) {
            let mut centre = [0.0; 3];
            for v in cell {
                (0..3).for_each(|c| centre[c] += grid.coords[v as usize][c] / 8.0);
            }
            let o = grid.coords.len() as u32;
            grid.coords.push(centre);
            for face in mesh::HEX_FACES {
                // Reversed, the face is a base oriented towards the apex.
                let q = [face[0], face[3], face[2], face[1]].map(|v| cell[v]);
                grid.cells.push([q[0], q[1], q[2], q[3], o, o, o, o]);
            }
        } else {
            grid.cells.push(cell);
        }
    }

    /// Faces of a hexahedron on the sides of the box.
    fn add_boundary(&self, [i, j, k]: [usize; 3], grid: &mut FlowGrid) {
        let n = self.n;
        let cell = self.hexahedron([i, j, k]);
        let outer = [k == 0, k + 1 == n, j == 0, i + 1 == n, j + 1 == n, i == 0];
        for (face, _) in mesh::HEX_FACES.iter().zip(outer).filter(|(_, outer)| *outer) {
            let quad = face.map(|v| cell[v]);
            let flat = face == &mesh::HEX_FACES[0] || face == &mesh::HEX_FACES[1];
            if flat && self.cut(i, j) {
                grid.boundary.extend(halves(quad).map(|f| (Patch::FarField, f)));
            } else {
                grid.boundary.push((Patch::FarField, quad));
            }
        }
    }
}

fn halves([a, b, c, d]: [u32; 4]) -> [[u32; 4]; 2] {
    [[a, b, c, c], [a, c, d, d]]
}

/// The plate as the canopy of a structure, unstressed in the grid's position.
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
