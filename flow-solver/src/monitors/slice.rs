//! Plane cuts: each cell that the plane meets gives one polygon.

use std::collections::HashMap;
use std::path::Path;

use channel::Fault;
use mesh::vtk::{Values, write_surface};

use super::pieces::Pieces;
use crate::geometry::vec3::Vec3;
use crate::gradient;
use crate::physics::{Gas, velocity};
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
        let height: Vec<f64> = x.iter().map(|x| normal.dot(&(x - point))).collect();
        // Two directions within the plane.
        let axis = if normal.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
        let e = normal.cross(&axis);
        let e = e * (1.0 / e.norm());
        let f = normal.cross(&e);
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
                    cut.points.push(x[a as usize] * (1.0 - s) + x[b as usize] * s);
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
            let sum: Vec3 = around.iter().map(|p| cut.points[p.1 as usize]).sum();
            let middle = sum * (1.0 / around.len() as f64);
            for p in &mut around {
                let d = cut.points[p.1 as usize] - middle;
                p.0 = d.dot(&f).atan2(d.dot(&e));
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
        p.iter().map(|&n| self.points[n as usize]).sum::<Vec3>() * (1.0 / p.len() as f64)
    }
}

impl Slice {
    /// As the scene says.
    pub fn new(s: &case::Slice) -> Self {
        let normal = Vec3::from(s.normal);
        Self {
            point: s.point_m.into(),
            normal: normal * (1.0 / normal.norm()),
            every: u64::from(s.every_windows),
            pieces: Pieces::new(&s.name),
        }
    }

    /// Adds a cut where one is due. Collective.
    ///
    /// # Errors
    /// A file cannot be written.
    pub fn record<G: Gas<N>, const N: usize>(
        &mut self,
        solver: &Solver<G, N>,
        done: u64,
        time: f64,
        folder: &Path,
    ) -> Result<(), Fault> {
        if !done.is_multiple_of(self.every) {
            return Ok(());
        }
        let cut = Cut::new(&solver.nodes, &solver.topology.cell_nodes, self.point, self.normal);
        let n = cut.polygons.len();
        let (mut pressure, mut velocities, mut vorticity) =
            (Vec::with_capacity(n), Vec::with_capacity(n), Vec::with_capacity(n));
        for (k, &c) in cut.cells.iter().enumerate() {
            let c = c as usize;
            let g = &solver.gradient[c];
            let q = gradient::extrapolated(&solver.q[c], g, &(cut.middle(k) - solver.metrics.centre(c)));
            pressure.push(q[0]);
            velocities.push((velocity(&q) - solver.scheme.frame).into());
            vorticity.push(gradient::vorticity(g).into());
        }
        let points: Vec<mesh::Point> = cut.points.iter().map(|x| (*x).into()).collect();
        self.pieces.push(solver.comm(), folder, done, time, n > 0, |file| {
            let fields = [
                ("pressure_pa", Values::F64(&pressure)),
                ("velocity_frame_m_s", Values::Vector(&velocities)),
                ("vorticity_1_s", Values::Vector(&vorticity)),
            ];
            write_surface(file, &points, &cut.polygons, &[], &fields)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh::{BoxShape, FlowGrid, Patch, box_grid_of};

    /// Area of a polygon.
    fn area(cut: &Cut, k: usize) -> f64 {
        let at = |n: u32| cut.points[n as usize];
        let p = &cut.polygons[k];
        let sum: Vec3 =
            (1..p.len() - 1).map(|i| (at(p[i]) - at(p[0])).cross(&(at(p[i + 1]) - at(p[0])))).sum();
        0.5 * sum.norm()
    }

    #[test]
    fn plane_section_of_a_box_has_no_gap_or_overlap() {
        let normal = Vec3::new(1.0, 2.0, 3.0) / 14f64.sqrt();
        let half = Vec3::repeat(0.5);
        let nodes = |grid: &FlowGrid| grid.coords.iter().map(|x| Vec3::from(*x)).collect::<Vec<_>>();
        for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
            let grid = box_grid_of(shape, [4, 5, 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
            let cut = Cut::new(&nodes(&grid), &grid.cells, half, normal);
            let sum: f64 = (0..cut.polygons.len()).map(|k| area(&cut, k)).sum();
            // Its shadow along z is the strip 0.5 (y) x 3 z between 0 and 1: x + 2y + 3z = 3.
            // Over (x, y): z = (3 - x - 2y) / 3 lies in [0, 1] everywhere, so the shadow is the unit square.
            assert!((sum - 14f64.sqrt() / 3.0).abs() < 1e-12, "{shape:?}: {sum}");
            assert!(cut.points.iter().all(|p| normal.dot(&(p - half)).abs() < 1e-14));
        }
        // Along the faces of the cells: one layer, no more.
        let grid = box_grid_of(BoxShape::Hexahedra, [4; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        let cut = Cut::new(&nodes(&grid), &grid.cells, half, Vec3::z());
        assert_eq!((cut.polygons.len(), cut.points.len()), (16, 25));
        assert!(Cut::new(&nodes(&grid), &grid.cells, Vec3::z() * 2.0, Vec3::z()).polygons.is_empty());
    }
}
