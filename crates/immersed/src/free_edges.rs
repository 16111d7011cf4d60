//! Upwind differences in the convective flux near the free edges of a surface.
//!
//! The velocity of the air is singular at a free edge (a skirt, a vent, the rim of a plate), as the square root of the distance. A central flux
//! of fourth order there answers with waves two cells long, which lower the drag of a plate by 9 % on 8 cells across. A flux at the distance r
//! from the nearest free edge therefore has at least the upwind share
//! ```math
//! s(r) = 1 \;\; (r \le h), \qquad 2 - r / h \;\; (h < r < 2h), \qquad 0 \;\; (r \ge 2h)
//! ```
//! with the width h of a cell: continuous in the position of the edge. What is added to a flux leaves one value and enters the next, so that
//! momentum is conserved. Source of the finding: `docs/records/flow-methods.md`.

use std::collections::HashMap;
use std::ops::Range;

use nalgebra::Vector3;

use crate::cut_faces::{OutsideCore, scaled_positions};
use crate::grid::{Grid, Velocity};
use crate::momentum::Momentum;
use crate::poisson::Box3;
use crate::projection::cells_of;

/// Distance from a free edge at which the upwind share begins to fall, and where it ends, in cells.
const FULL: f64 = 1.0;
const END: f64 = 2.0;

/// Edges that belong to one triangle only, in the order of the triangles.
pub fn free_edges(faces: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let sides = |f: &[u32; 3]| [[f[0], f[1]], [f[1], f[2]], [f[2], f[0]]];
    let key = |[a, b]: [u32; 2]| [a.min(b), a.max(b)];
    let mut count: HashMap<[u32; 2], u32> = HashMap::new();
    for side in faces.iter().flat_map(sides) {
        *count.entry(key(side)).or_default() += 1;
    }
    faces.iter().flat_map(sides).filter(|side| count[&key(*side)] == 1).collect()
}

/// A flux near a free edge.
#[derive(Clone, Copy, Debug, PartialEq)]
struct EdgeFlux {
    /// Component, and the axis along which it is carried.
    component: u8,
    axis: u8,
    /// Position in its array of the value above the flux.
    upper: usize,
    /// Upwind share there.
    share: f64,
}

/// The fluxes near the free edges of a surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EdgeFluxes {
    fluxes: Vec<EdgeFlux>,
    /// Width of a cell, m.
    spacing: f64,
}

/// Distances from the nearest edge at places of the same kind, one in each cell of a box.
struct Distances {
    /// Cells of the box, counted from the first of the core.
    cells: Box3,
    /// Place in a cell, in cells.
    place: Vector3<f64>,
    /// Squares, in cells.
    squares: Vec<f64>,
}

impl Distances {
    fn new(cells: &Box3, place: Vector3<f64>) -> Self {
        let count = cells.iter().map(ExactSizeIterator::len).product();
        Self { cells: cells.clone(), place, squares: vec![f64::INFINITY; count] }
    }

    fn index(&self, cell: [usize; 3]) -> usize {
        let i = [0, 1, 2].map(|d| cell[d] - self.cells[d].start);
        (i[2] * self.cells[1].len() + i[1]) * self.cells[0].len() + i[0]
    }

    /// Takes the edge from `a` to `b` into account, in units of core cells.
    fn add(&mut self, a: Vector3<f64>, b: Vector3<f64>) {
        let along = b - a;
        let length = along.norm_squared().max(f64::MIN_POSITIVE);
        for cell in cells_of(&near(&self.cells, a, b)) {
            let x = Vector3::from(cell.map(|i| i as f64)) + self.place - a;
            let nearest = along * (x.dot(&along) / length).clamp(0.0, 1.0);
            let at = self.index(cell);
            self.squares[at] = self.squares[at].min((x - nearest).norm_squared());
        }
    }
}

/// Cells of the box `within` that have places within [`END`] of the edge from `a` to `b`.
fn near(within: &Box3, a: Vector3<f64>, b: Vector3<f64>) -> Box3 {
    [0, 1, 2].map(|d| {
        let low = (a[d].min(b[d]) - END).floor() as isize - 1;
        let high = (a[d].max(b[d]) + END).ceil() as isize + 1;
        let inside = |i: isize| (i.max(0) as usize).clamp(within[d].start, within[d].end);
        inside(low)..inside(high)
    })
}

impl EdgeFluxes {
    /// Near the `edges` ([`free_edges`]) between nodes at `positions` (m, in the frame of the grid). An edge that lies beyond the end of a periodic axis
    /// is none of the flow's.
    ///
    /// # Errors
    /// A node is not at least three cells inside the core.
    pub fn new(grid: &Grid, positions: &[Vector3<f64>], edges: &[[u32; 2]]) -> Result<Self, OutsideCore> {
        let mut found = Self { fluxes: Vec::new(), spacing: grid.axes[0].spacing };
        let scaled = scaled_positions(grid, positions)?;
        let core = [0, 1, 2].map(|d| 0..grid.axes[d].core.len());
        let beyond = |a: &Vector3<f64>, b: &Vector3<f64>| {
            (0..3).any(|d| a[d].max(b[d]) < 0.0 || a[d].min(b[d]) > core[d].end as f64)
        };
        let ends = edges.iter().map(|e| e.map(|n| scaled[n as usize]));
        let ends: Vec<[Vector3<f64>; 2]> = ends.filter(|[a, b]| !beyond(a, b)).collect();
        let Some(bounds) = ends
            .iter()
            .map(|[a, b]| near(&core, *a, *b))
            .reduce(|all, own| [0, 1, 2].map(|d| all[d].start.min(own[d].start)..all[d].end.max(own[d].end)))
        else {
            return Ok(found);
        };
        // The flux of component c along c is in the middle of the lower cell, that along d on the edge of the cell that has c and d as normals.
        for c in 0..3 {
            for d in c..3 {
                let place = Vector3::from_fn(|i, _| if c != d && (i == c || i == d) { 0.0 } else { 0.5 });
                let mut distances = Distances::new(&bounds, place);
                ends.iter().for_each(|[a, b]| distances.add(*a, *b));
                found.push(grid, [c, d], &distances);
            }
        }
        Ok(found)
    }

    /// Adds the fluxes of component c along d, and of d along c, that are near an edge.
    fn push(&mut self, grid: &Grid, [c, d]: [usize; 2], distances: &Distances) {
        for cell in cells_of(&distances.cells) {
            let r = distances.squares[distances.index(cell)].sqrt();
            let share = ((END - r) / (END - FULL)).clamp(0.0, 1.0);
            if share == 0.0 {
                continue;
            }
            let mut above = [0, 1, 2].map(|i| (grid.axes[i].core.start + cell[i]) as isize);
            if c == d {
                above[d] += 1;
            }
            let upper = grid.at(above);
            let (own, other) = (c as u8, d as u8);
            self.fluxes.push(EdgeFlux { component: own, axis: other, upper, share });
            if c != d {
                self.fluxes.push(EdgeFlux { component: other, axis: own, upper, share });
            }
        }
    }

    /// Adds what these fluxes lack of their upwind share to the `rates` (m/s2) of values at the positions `own`, as [`Momentum::rates`] has its fluxes.
    pub(crate) fn add_rates(
        &self,
        momentum: &Momentum,
        grid: &Grid,
        u: &Velocity,
        frame: Vector3<f64>,
        own: &Range<usize>,
        rates: &mut Velocity,
    ) {
        for flux in &self.fluxes {
            let (c, d, upper) = (flux.component as usize, flux.axis as usize, flux.upper);
            let (across, along) = (grid.strides[c], grid.strides[d]);
            let lower = upper - along;
            let missing = flux.share - momentum.upwind_share;
            let mine = [own.contains(&lower), own.contains(&upper)];
            if missing <= 0.0 || mine == [false; 2] {
                continue;
            }
            let v = if c == d { u[c][lower] + u[c][upper] } else { u[d][upper - across] + u[d][upper] };
            let third = u[c][upper + along] - u[c][lower - along] - 3.0 * (u[c][upper] - u[c][lower]);
            let rate = missing / 12.0 * (0.5 * v - frame[d]).abs() * third / self.spacing;
            if mine[0] {
                rates[c][lower] -= rate;
            }
            if mine[1] {
                rates[c][upper] += rate;
            }
        }
    }

    /// Component, axis, position of the upper value and upwind share of each flux.
    pub(crate) fn fluxes(&self) -> impl Iterator<Item = (u8, u8, usize, f64)> + '_ {
        self.fluxes.iter().map(|f| (f.component, f.axis, f.upper, f.share))
    }

    /// Number of fluxes.
    pub fn len(&self) -> usize {
        self.fluxes.len()
    }

    /// Whether no flux is near a free edge.
    pub fn is_empty(&self) -> bool {
        self.fluxes.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::grid::{End, Ends};
    use crate::shapes;

    const SLIP: Ends = Ends::Open([End::Slip, End::Slip]);

    fn grid() -> Grid {
        let axis = || Axis::stretched([-1.0, 1.0], 0.1, [0.5, 0.5], 1.2, 2);
        Grid::new([axis(), axis(), axis()], [SLIP, SLIP, SLIP])
    }

    /// A velocity without any symmetry.
    fn field(grid: &Grid) -> Velocity {
        let value =
            |c: usize, i: usize| (0.37 * i as f64 + 1.3 * c as f64).sin() + 0.2 * (0.011 * i as f64).cos();
        [0, 1, 2].map(|c| (0..grid.array_len()).map(|i| value(c, i)).collect())
    }

    #[test]
    fn free_edges_of_a_plate_are_its_rim_and_a_sphere_has_none() {
        let (_, faces) = shapes::plate(5);
        assert_eq!(free_edges(&faces).len(), 20);
        assert!(free_edges(&shapes::sphere(1.0, 2).1).is_empty());
    }

    /// At values all of whose fluxes lie within a cell of an edge the rates are those of upwind differences, with whatever share elsewhere; at values
    /// beyond two cells they are unchanged; and the sum of what is added vanishes.
    #[test]
    fn rates_at_an_edge_are_those_of_upwind_differences() {
        let grid = grid();
        let frame = Vector3::new(0.3, -0.2, 0.5);
        let u = field(&grid);
        let planes = grid.all_cells()[2].clone();
        let share = |upwind_share: f64| Momentum { upwind_share, viscosity: 0.01 };
        let rates = |momentum: Momentum| {
            let mut rates = grid.uniform(Vector3::zeros());
            momentum.rates(&grid, &u, frame, planes.clone(), &mut rates);
            rates
        };
        let (nodes, faces) = shapes::plate(4);
        let nodes: Vec<_> = nodes.iter().map(|x| x + Vector3::new(0.013, -0.021, 0.034)).collect();
        let edges = free_edges(&faces);
        let fluxes = EdgeFluxes::new(&grid, &nodes, &edges).expect("inside");
        let [central, upwind] = [share(0.25), share(1.0)].map(rates);
        let mut mixed = central.clone();
        let all = 0..grid.array_len();
        fluxes.add_rates(&share(0.25), &grid, &u, frame, &all, &mut mixed);
        let distance = |x: Vector3<f64>| {
            let of = |e: &[u32; 2]| {
                let [a, b] = e.map(|n| nodes[n as usize]);
                let at = ((x - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
                (x - a - (b - a) * at).norm()
            };
            edges.iter().map(of).fold(f64::INFINITY, f64::min) / grid.axes[0].spacing
        };
        let (mut at_edge, mut away, mut sum) = (0, 0, 0.0);
        for c in 0..3 {
            for cell in cells_of(&grid.all_cells().map(|r| r.start + 1..r.end)) {
                let at = grid.at(cell.map(|i| i as isize));
                let x = Vector3::from_fn(|d, _| grid.coordinate(c, d, cell[d]));
                let flux =
                    |d: usize, side: f64| distance(x + Vector3::ith(d, side * 0.5 * grid.axes[0].spacing));
                let around: Vec<f64> = (0..3).flat_map(|d| [flux(d, -1.0), flux(d, 1.0)]).collect();
                sum += mixed[c][at] - central[c][at];
                if around.iter().all(|r| *r < FULL) {
                    at_edge += 1;
                    assert!((mixed[c][at] - upwind[c][at]).abs() < 1e-11 && mixed[c][at] != central[c][at]);
                } else if around.iter().all(|r| *r > END) {
                    away += 1;
                    assert_eq!(mixed[c][at], central[c][at]);
                }
            }
        }
        assert!(at_edge > 50 && away > 10_000 && sum.abs() < 1e-9, "{at_edge} {away} {sum:e}");
    }

    /// A plate that spans a periodic axis and extends beyond both its ends has two free edges there, not four.
    #[test]
    fn edges_beyond_a_periodic_axis_are_none() {
        let axis = || Axis::stretched([-1.0, 1.0], 0.1, [0.5, 0.5], 1.2, 2);
        let grid = Grid::new([axis(), Axis::even(-0.2, 0.2, 4), axis()], [SLIP, Ends::Periodic, SLIP]);
        let (nodes, faces) = shapes::plate(2);
        let fluxes = EdgeFluxes::new(&grid, &nodes, &free_edges(&faces)).expect("inside");
        let x = |f: &EdgeFlux| {
            (f.upper % grid.strides[1]) as f64 * 0.1 - grid.axes[0].core.start as f64 * 0.1 - 1.2
        };
        assert!(fluxes.len() > 200 && fluxes.fluxes.iter().all(|f| (x(f).abs() - 0.5).abs() < 0.35));
    }

    /// The share of a flux changes continuously with the place of the surface.
    #[test]
    fn shares_are_continuous_in_the_position() {
        let grid = grid();
        let (nodes, faces) = shapes::plate(4);
        let total = |shift: f64| {
            let nodes: Vec<_> =
                nodes.iter().map(|x| x + Vector3::new(shift, 0.4 * shift, 0.7 * shift)).collect();
            let fluxes = EdgeFluxes::new(&grid, &nodes, &free_edges(&faces)).expect("inside");
            fluxes.fluxes.iter().map(|f| f.share).sum::<f64>()
        };
        for k in 0..200 {
            let shift = 1e-3 * f64::from(k);
            let [here, next] = [total(shift), total(shift + 1e-6)];
            // 1e-5 cells; every share changes by at most the motion.
            assert!((next - here).abs() < 0.1 && here > 1000.0, "{shift}: {here} {next}");
        }
    }
}
