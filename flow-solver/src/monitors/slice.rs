//! Plane cuts: each cell that the plane meets gives one polygon.

use std::collections::HashMap;
use std::path::Path;

use channel::Fault;
use mesh::vtk::{Values, write_surface};

use super::pieces::Pieces;
use crate::geometry::vec3::{Vec3, add, cross, dot, norm, scale, sub};
use crate::physics::{Gas, Viscosity};
use crate::solver::Solver;

/// A plane and its series.
pub struct Slice {
    point: Vec3,
    /// Unit normal.
    normal: Vec3,
    every: u64,
    pieces: Pieces,
}

/// The polygons that a plane cuts out of cells.
#[derive(Clone, Debug, Default)]
pub struct Cut {
    /// Corners, m; polygons of neighbours share them.
    pub points: Vec<Vec3>,
    /// Corners of each polygon, in order around it.
    pub polygons: Vec<Vec<u32>>,
    /// Cell of each polygon.
    pub cells: Vec<u32>,
}

/// The twelve edges of a hexahedron in VTK order.
const EDGES: [[usize; 2]; 12] =
    [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [5, 6], [6, 7], [7, 4], [0, 4], [1, 5], [2, 6], [3, 7]];

impl Cut {
    /// Cuts `cells` of nodes `x` by the plane through `point` with the unit vector
    /// `normal`. A node on the plane counts as beyond it, so a plane along faces cuts
    /// the cells behind them.
    pub fn new(x: &[Vec3], cells: &[[u32; 8]], point: Vec3, normal: Vec3) -> Self {
        let height: Vec<f64> = x.iter().map(|x| dot(normal, sub(*x, point))).collect();
        // Two directions within the plane.
        let axis = if normal[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let e = cross(normal, axis);
        let e = scale(1.0 / norm(e), e);
        let f = cross(normal, e);
        let mut cut = Self::default();
        let mut corner: HashMap<(u32, u32), u32> = HashMap::new();
        let mut around: Vec<(f64, u32)> = Vec::with_capacity(8);
        for (c, cell) in cells.iter().enumerate() {
            let below = cell.iter().filter(|&&n| height[n as usize] < 0.0).count();
            if below == 0 || below == 8 {
                continue;
            }
            around.clear();
            for [a, b] in EDGES.map(|e| e.map(|i| cell[i])) {
                let (ha, hb) = (height[a as usize], height[b as usize]);
                if (ha < 0.0) == (hb < 0.0) {
                    continue;
                }
                let node = *corner.entry((a.min(b), a.max(b))).or_insert_with(|| {
                    let s = ha / (ha - hb);
                    cut.points.push(add(scale(1.0 - s, x[a as usize]), scale(s, x[b as usize])));
                    cut.points.len() as u32 - 1
                });
                // An edge that two edges have collapsed onto counts once.
                if around.iter().all(|p| p.1 != node) {
                    around.push((0.0, node));
                }
            }
            if around.len() < 3 {
                continue;
            }
            let sum = around.iter().fold([0.0; 3], |s, p| add(s, cut.points[p.1 as usize]));
            let middle = scale(1.0 / around.len() as f64, sum);
            for p in &mut around {
                let d = sub(cut.points[p.1 as usize], middle);
                p.0 = dot(d, f).atan2(dot(d, e));
            }
            around.sort_by(|a, b| a.0.total_cmp(&b.0));
            cut.polygons.push(around.iter().map(|p| p.1).collect());
            cut.cells.push(c as u32);
        }
        cut
    }

    /// Mean of the corners of polygon `k`, m.
    pub fn middle(&self, k: usize) -> Vec3 {
        let p = &self.polygons[k];
        scale(1.0 / p.len() as f64, p.iter().fold([0.0; 3], |s, &n| add(s, self.points[n as usize])))
    }
}

impl Slice {
    /// As the scene says.
    pub fn new(s: &case::Slice) -> Self {
        Self {
            point: s.point_m,
            normal: scale(1.0 / norm(s.normal), s.normal),
            every: u64::from(s.every_windows),
            pieces: Pieces::new(&s.name),
        }
    }

    /// Adds a cut where one is due. Collective.
    ///
    /// # Errors
    /// Trouble with a file.
    pub fn record<G: Gas<N>, V: Viscosity, const N: usize>(
        &mut self,
        solver: &Solver<G, V, N>,
        done: u64,
        time: f64,
        folder: &Path,
    ) -> Result<(), Fault> {
        if !done.is_multiple_of(self.every) {
            return Ok(());
        }
        let cut = Cut::new(&solver.nodes, &solver.topology.cell_nodes, self.point, self.normal);
        let n = cut.polygons.len();
        let (mut pressure, mut velocity, mut vorticity) =
            (Vec::with_capacity(n), Vec::with_capacity(n), Vec::with_capacity(n));
        for (k, &c) in cut.cells.iter().enumerate() {
            let c = c as usize;
            let (q, g) = (&solver.q[c], &solver.gradient[c]);
            let d = sub(cut.middle(k), solver.metrics.centre[c]);
            let at = |v: usize| q[v] + g[0][v] * d[0] + g[1][v] * d[1] + g[2][v] * d[2];
            pressure.push(at(0));
            velocity.push(sub([at(1), at(2), at(3)], solver.scheme.frame));
            let slope = |u: usize, x: usize| g[x][1 + u];
            vorticity.push([slope(2, 1) - slope(1, 2), slope(0, 2) - slope(2, 0), slope(1, 0) - slope(0, 1)]);
        }
        self.pieces.push(solver.comm(), folder, done, time, n > 0, |file| {
            let fields = [
                ("pressure_pa", Values::F64(&pressure)),
                ("velocity_frame_m_s", Values::Vector(&velocity)),
                ("vorticity_1_s", Values::Vector(&vorticity)),
            ];
            write_surface(file, &cut.points, &cut.polygons, &[], &fields)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh::{BoxShape, Patch, box_grid_of};

    /// Area of a polygon.
    fn area(cut: &Cut, k: usize) -> f64 {
        let at = |n: u32| cut.points[n as usize];
        let p = &cut.polygons[k];
        let sum = (1..p.len() - 1)
            .fold([0.0; 3], |s, i| add(s, cross(sub(at(p[i]), at(p[0])), sub(at(p[i + 1]), at(p[0])))));
        0.5 * norm(sum)
    }

    #[test]
    fn a_plane_through_a_box_is_cut_without_gap_or_overlap() {
        let normal = scale(1.0 / 14f64.sqrt(), [1.0, 2.0, 3.0]);
        for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
            let grid = box_grid_of(shape, [4, 5, 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
            let cut = Cut::new(&grid.coords, &grid.cells, [0.5; 3], normal);
            let sum: f64 = (0..cut.polygons.len()).map(|k| area(&cut, k)).sum();
            // Its shadow along z is the strip 0.5 (y) x 3 z between 0 and 1: x + 2y + 3z = 3.
            // Over (x, y): z = (3 - x - 2y) / 3 lies in [0, 1] everywhere, so the shadow is the unit square.
            assert!((sum - 14f64.sqrt() / 3.0).abs() < 1e-12, "{shape:?}: {sum}");
            assert!(cut.points.iter().all(|p| dot(normal, sub(*p, [0.5; 3])).abs() < 1e-14));
        }
        // Along the faces of the cells: one layer, no more.
        let grid = box_grid_of(BoxShape::Hexahedra, [4; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let cut = Cut::new(&grid.coords, &grid.cells, [0.5; 3], [0.0, 0.0, 1.0]);
        assert_eq!((cut.polygons.len(), cut.points.len()), (16, 25));
        assert!(Cut::new(&grid.coords, &grid.cells, [0.0, 0.0, 2.0], [0.0, 0.0, 1.0]).polygons.is_empty());
    }
}
