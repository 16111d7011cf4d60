//! Triangulated surfaces in the even core of the grid: the faces of cells that they cut, and the constraints there.
//!
//! A surface cuts a face of the grid where it crosses the line between the centres of the two cells next to it. The triangles are rasterised
//! along x, y and z with one rule for shared edges, so that the cut faces of a closed surface leave no hole, whatever its shape. The velocity
//! through the cut faces is that of the surface, so nothing leaks; the pressure may jump there.
//!
//! A constraint belongs to the column of a face that the surface cuts at the largest angle (the dominant one), and to the faces next to it that it cuts at a smaller
//! angle: the flux through all of them together is that of the surface, and its unknown is one pressure jump. This is the normal
//! velocity and the normal force of the surface; along it the air slides, unless friction acts (`friction.rs`).

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

use nalgebra::Vector3;

use crate::constraints::FluxConstraints;
use crate::grid::{Ends, Grid};
use crate::pockets;

/// A node outside the even core of the grid, or too close to its end.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "node {node} of the surface at {axis} = {at:.4} m is outside the even part of the grid, from {from:.4} to {to:.4} m"
)]
pub struct OutsideCore {
    /// Number of the node.
    pub node: usize,
    /// Axis.
    pub axis: char,
    /// Coordinate, m.
    pub at: f64,
    /// Least coordinate of a node, m.
    pub from: f64,
    /// Largest coordinate of a node, m.
    pub to: f64,
}

/// Where a triangle crosses the line through the centres of the cells along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Crossing {
    /// Axis of the line.
    pub axis: usize,
    /// Cell whose lower face along the axis is cut.
    pub cell: [usize; 3],
    /// Triangle.
    pub triangle: usize,
    /// Shares of the triangle's nodes.
    pub shares: [f64; 3],
    /// Unit normal of the triangle.
    pub normal: Vector3<f64>,
    /// Distance from the crossing to the value above it on the line, in cells.
    pub to_upper: f64,
}

/// Cut faces of a surface with their constraints.
#[derive(Clone, Debug, Default)]
pub struct CutFaces {
    /// Constraints.
    pub rows: FluxConstraints,
    /// Crossings, those of a face one after the other. Copies of a cut share what does not change.
    crossings: Arc<[Crossing]>,
    /// Of each row's entries: the crossings of its face.
    of_entry: Arc<[std::ops::Range<usize>]>,
    /// Area of a face, m2.
    area: f64,
}

/// Cells between a surface and the ends of the even ones, at least.
pub const MARGIN: f64 = 3.0;
/// Least cosine between the normals of a face that is cut at a small angle and the one whose constraint it joins.
const SAME_SHEET: f64 = 0.3;
/// [`FluxConstraints::leak`] at a pocket of few cells: the jump is then a few times that of a face in the open.
const POCKET_LEAK: f64 = 0.3;
/// Cells around a face in which that one is sought.
const REACH: isize = 2;

/// Signed double area of the triangle of p and an edge, bitwise the same from both sides of the edge but for its sign. Where p lies on
/// the line of the edge: what decides the sign once p is shifted by an infinitesimal length along the first axis, and by a still smaller one
/// along the second. The shift is the same for all triangles, so that a line through an edge or a node is inside one of them.
#[inline(always)]
fn edge(p: [f64; 2], from: ([f64; 2], u32), to: ([f64; 2], u32)) -> (f64, f64) {
    let forward = from.1 < to.1;
    let (low, high) = if forward { (from.0, to.0) } else { (to.0, from.0) };
    let along = [high[0] - low[0], high[1] - low[1]];
    let e = along[0] * (p[1] - low[1]) - along[1] * (p[0] - low[0]);
    let shifted = if e != 0.0 {
        e
    } else if along[1] != 0.0 {
        -along[1]
    } else {
        along[0]
    };
    if forward { (e, shifted) } else { (-e, -shifted) }
}

/// A triangle in units of core cells, from the first face of the core.
struct Triangle {
    number: usize,
    nodes: [u32; 3],
    x: [Vector3<f64>; 3],
    normal: Vector3<f64>,
}

impl Triangle {
    /// Crossings with the lines along `axis` through values that lie at `place` of their cells, in cells; `start`: first cell of the core.
    fn crossings(&self, axis: usize, place: [f64; 3], start: [usize; 3], mut found: impl FnMut(Crossing)) {
        let Self { number, nodes, x, normal } = self;
        let [a, b] = [(axis + 1) % 3, (axis + 2) % 3];
        let flat = x.map(|x| [x[a] - place[a], x[b] - place[b]]);
        let range = |c: usize| {
            let (low, high) = flat.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[c]), h.max(p[c])));
            low.ceil() as isize..=high.floor() as isize
        };
        // The triangle is seen from below.
        let turned = normal[axis] < 0.0;
        for q in range(1) {
            for p in range(0) {
                let at = [p as f64, q as f64];
                let mut shares = [0.0; 3];
                let inside = (0..3).all(|i| {
                    let [j, k] = [(i + 1) % 3, (i + 2) % 3];
                    let (e, shifted) = edge(at, (flat[j], nodes[j]), (flat[k], nodes[k]));
                    let sign = if turned { -1.0 } else { 1.0 };
                    shares[i] = sign * e;
                    sign * shifted > 0.0
                });
                let sum: f64 = shares.iter().sum();
                if !inside || sum <= 0.0 {
                    continue;
                }
                let shares = shares.map(|s| s / sum);
                let along: f64 = shares.iter().zip(x).map(|(s, x)| s * x[axis]).sum();
                let above = (along - place[axis]).ceil();
                let to_upper = above - (along - place[axis]);
                // Outside of a periodic axis the position wraps to one that no cell has.
                let cell_at = |d: usize, i: isize| start[d].wrapping_add_signed(i);
                let mut cell = [0; 3];
                (cell[a], cell[b], cell[axis]) =
                    (cell_at(a, p), cell_at(b, q), cell_at(axis, above as isize));
                found(Crossing { axis, cell, triangle: *number, shares, normal: *normal, to_upper });
            }
        }
    }
}

/// Finds where triangles cross the lines of a grid.
pub(crate) struct Rasteriser<'a> {
    grid: &'a Grid,
    triangles: Vec<Triangle>,
}

impl<'a> Rasteriser<'a> {
    /// For the triangles `faces` of nodes at `positions`, m.
    pub fn new(grid: &'a Grid, positions: &[Vector3<f64>], faces: &[[u32; 3]]) -> Result<Self, OutsideCore> {
        let scaled = scaled_positions(grid, positions)?;
        let triangle = |(number, nodes): (usize, &[u32; 3])| {
            let x = nodes.map(|n| scaled[n as usize]);
            let normal = (x[1] - x[0]).cross(&(x[2] - x[0])).try_normalize(1e-14)?;
            Some(Triangle { number, nodes: *nodes, x, normal })
        };
        Ok(Self { grid, triangles: faces.iter().enumerate().filter_map(triangle).collect() })
    }

    /// Crossings with the lines along all axes through the centres of the cells.
    pub fn of_cells(&self) -> Vec<Crossing> {
        self.lines(&[0, 1, 2], [0.5; 3])
    }

    /// Crossings with the lines along `axis` through the values of component `c`; the cell is that of the value above.
    pub fn of_component(&self, c: usize, axis: usize) -> Vec<Crossing> {
        let mut place = [0.5; 3];
        place[c] = 0.0;
        self.lines(&[axis], place)
    }

    fn lines(&self, axes: &[usize], place: [f64; 3]) -> Vec<Crossing> {
        let start = [0, 1, 2].map(|d| self.grid.axes[d].core.start);
        let cells = self.grid.cells();
        // A surface may extend beyond the ends of a periodic axis.
        let in_grid = |c: &Crossing| (0..3).all(|d| c.cell[d] < cells[d]) && c.cell[c.axis] > 0;
        let mut crossings = Vec::new();
        for triangle in &self.triangles {
            for axis in axes {
                triangle.crossings(*axis, place, start, |c| {
                    if in_grid(&c) {
                        crossings.push(c);
                    }
                });
            }
        }
        crossings
    }
}

impl CutFaces {
    /// Of the triangles `faces` of nodes at `positions` (m, in the frame of the grid) on a grid with cubes in its core; `permeability` of
    /// the cloth, m/(s Pa). Along a periodic axis of even cells the surface may extend beyond both ends, parallel to the axis there.
    ///
    /// # Errors
    /// A node is not at least three cells inside the core.
    pub fn new(
        grid: &Grid,
        positions: &[Vector3<f64>],
        faces: &[[u32; 3]],
        permeability: f64,
    ) -> Result<Self, OutsideCore> {
        let h = grid.axes[0].spacing;
        let mut crossings = Rasteriser::new(grid, positions, faces)?.of_cells();
        let key = |c: &Crossing| (grid.at(c.cell.map(|i| i as isize)), c.axis, c.triangle);
        crossings.sort_by_key(key);
        let mut cut = Self {
            rows: FluxConstraints::new(grid),
            crossings: crossings.into(),
            of_entry: Arc::default(),
            area: h * h,
        };
        cut.assemble(grid, permeability);
        Ok(cut)
    }

    /// Crossings of each cut face.
    fn faces(&self) -> Vec<std::ops::Range<usize>> {
        let mut faces = Vec::new();
        let mut from = 0;
        for i in 1..=self.crossings.len() {
            let next = self.crossings.get(i);
            let own = &self.crossings[from];
            if next.is_none_or(|c| (c.cell, c.axis) != (own.cell, own.axis)) {
                faces.push(from..i);
                from = i;
            }
        }
        faces
    }

    /// The rows of all cut faces.
    fn assemble(&mut self, grid: &Grid, permeability: f64) {
        if self.crossings.is_empty() {
            return;
        }
        let faces = self.faces();
        let first = |f: &std::ops::Range<usize>| &self.crossings[f.start];
        let dominant = |c: &Crossing| c.normal[c.axis].abs() >= c.normal.amax() - 1e-12;
        let mut places = Places::new(self.crossings.iter().map(|c| c.cell));
        for (i, face) in faces.iter().enumerate().filter(|(_, f)| dominant(first(f))) {
            places.set(first(face), i);
        }
        let mut members: Vec<Vec<(usize, f64)>> = vec![Vec::new(); faces.len()];
        for (i, face) in faces.iter().enumerate() {
            let own = first(face);
            let joined = if dominant(own) { Some(i) } else { nearest(own, &places, |j| first(&faces[j])) };
            let joined = joined.unwrap_or(i);
            let turned = own.normal.dot(&first(&faces[joined]).normal) < 0.0;
            let sign = own.normal[own.axis].signum() * if turned { -1.0 } else { 1.0 };
            members[joined].push((i, sign));
        }
        let (mut rows, mut of_entry) = (FluxConstraints::new(grid), Vec::new());
        for (joined, members) in members.iter().enumerate().filter(|(_, m)| !m.is_empty()) {
            let own = first(&faces[joined]);
            let entries: Vec<_> = members
                .iter()
                .map(|(i, sign)| (first(&faces[*i]).axis, first(&faces[*i]).cell, sign * self.area))
                .collect();
            of_entry.extend(members.iter().map(|(i, _)| faces[*i].clone()));
            let area = self.area / own.normal[own.axis].abs().max(0.1);
            rows.push(grid, &entries, 0.0, permeability * area);
        }
        for row in pockets::unresolved(grid, &rows) {
            rows.leak[row] = POCKET_LEAK;
        }
        (self.rows, self.of_entry) = (rows, of_entry.into());
    }

    /// Sets the velocities of the nodes, m/s.
    pub fn set_velocities(&mut self, faces: &[[u32; 3]], velocities: &[Vector3<f64>]) {
        for row in 0..self.rows.len() {
            let mut target = 0.0;
            for entry in self.rows.offsets[row]..self.rows.offsets[row + 1] {
                let range = self.of_entry[entry].clone();
                let count = range.len() as f64;
                let at = |c: &Crossing| -> f64 {
                    let nodes = faces[c.triangle];
                    (0..3).map(|i| c.shares[i] * velocities[nodes[i] as usize][c.axis]).sum()
                };
                let mean = self.crossings[range].iter().map(at).sum::<f64>() / count;
                target += self.rows.weights[entry] * mean;
            }
            self.rows.target[row] = target;
        }
    }

    /// Adds the forces of the air on the nodes (N) for the pressure jumps of the rows. Force and moment are those that the air loses, to
    /// round-off: each acts along the line of its crossing. Layers that cut one face share its jump.
    pub fn add_forces(&self, faces: &[[u32; 3]], jumps: &[f64], forces: &mut [Vector3<f64>]) {
        for (row, jump) in jumps.iter().enumerate() {
            for entry in self.rows.offsets[row]..self.rows.offsets[row + 1] {
                let range = self.of_entry[entry].clone();
                let force = self.rows.weights[entry] * jump / range.len() as f64;
                for c in &self.crossings[range] {
                    for (node, share) in faces[c.triangle].iter().zip(&c.shares) {
                        forces[*node as usize][c.axis] += share * force;
                    }
                }
            }
        }
    }

    /// Pressure jumps of the rows from those of another set of cut faces, `old` with `jumps`: the start of an iteration.
    pub fn transfer(&self, old: &Self, jumps: &[f64]) -> Vec<f64> {
        let mut at: HashMap<(u8, usize), f64> = HashMap::new();
        for (row, jump) in jumps.iter().enumerate() {
            for entry in old.rows.offsets[row]..old.rows.offsets[row + 1] {
                at.insert(old.rows.faces[entry], jump * old.rows.weights[entry].signum());
            }
        }
        let of_row = |row: usize| {
            let (mut sum, mut count) = (0.0, 0.0);
            for entry in self.rows.offsets[row]..self.rows.offsets[row + 1] {
                if let Some(jump) = at.get(&self.rows.faces[entry]) {
                    sum += jump * self.rows.weights[entry].signum();
                    count += 1.0;
                }
            }
            if count > 0.0 { sum / count } else { 0.0 }
        };
        (0..self.rows.len()).map(of_row).collect()
    }

    /// Triangle of the first crossing of a row.
    pub fn triangle_of(&self, row: usize) -> usize {
        self.crossings[self.of_entry[self.rows.offsets[row]].start].triangle
    }

    /// Where `rows` lie on the surface of nodes at `scaled`, in their order: the crossings of the face of each that the surface cuts at the largest angle.
    pub(crate) fn row_places(
        &self,
        rows: Range<usize>,
        triangles: &[[u32; 3]],
        scaled: &[Vector3<f64>],
    ) -> Vec<RowPlace> {
        let mut places = Vec::with_capacity(rows.len());
        for row in rows {
            let entries = self.rows.offsets[row]..self.rows.offsets[row + 1];
            let first = |e: usize| &self.crossings[self.of_entry[e].start];
            let steep = |e: &usize| first(*e).normal[first(*e).axis].abs();
            let Some(entry) = entries.max_by(|a, b| steep(a).total_cmp(&steep(b))) else { continue };
            for c in &self.crossings[self.of_entry[entry].clone()] {
                let nodes = triangles[c.triangle];
                let x = (0..3).map(|i| scaled[nodes[i] as usize] * c.shares[i]).sum();
                places.push(RowPlace { row, x, normal: c.normal });
            }
        }
        places
    }

    /// All crossings.
    pub fn crossings(&self) -> &[Crossing] {
        &self.crossings
    }
}

/// A point of a row on the surface, in units of core cells, and the unit normal there.
pub(crate) struct RowPlace {
    pub row: usize,
    pub x: Vector3<f64>,
    pub normal: Vector3<f64>,
}

/// Positions in units of core cells, from the first face of the core.
pub(crate) fn scaled_positions(
    grid: &Grid,
    positions: &[Vector3<f64>],
) -> Result<Vec<Vector3<f64>>, OutsideCore> {
    let mut scaled = Vec::with_capacity(positions.len());
    // A surface that spans a periodic axis of even cells has no end there.
    let ends =
        [0, 1, 2].map(|d| grid.ends[d] != Ends::Periodic || grid.axes[d].core != (0..grid.axes[d].len()));
    for (node, x) in positions.iter().enumerate() {
        for d in (0..3).filter(|d| ends[*d]) {
            let axis = &grid.axes[d];
            let place = |cell: f64| axis.faces[axis.core.start] + axis.spacing * cell;
            let (from, to) = (place(MARGIN), place(axis.core.len() as f64 - MARGIN));
            if !(from..=to).contains(&x[d]) {
                return Err(OutsideCore { node, axis: ['x', 'y', 'z'][d], at: x[d], from, to });
            }
        }
        scaled.push(Vector3::from_fn(|d, _| {
            (x[d] - grid.axes[d].faces[grid.axes[d].core.start]) / grid.axes[d].spacing
        }));
    }
    Ok(scaled)
}

/// Faces by the cell whose lower face they are, in a box around all.
struct Places {
    start: [usize; 3],
    extent: [usize; 3],
    /// Number of the face of each cell along each axis, or [`NONE`].
    faces: Vec<[u32; 3]>,
}

/// No face.
const NONE: u32 = u32::MAX;

impl Places {
    /// Of faces in these cells, without any.
    fn new(cells: impl Iterator<Item = [usize; 3]>) -> Self {
        let (mut start, mut end) = ([usize::MAX; 3], [0; 3]);
        for cell in cells {
            for d in 0..3 {
                start[d] = cell[d].min(start[d]);
                end[d] = (cell[d] + 1).max(end[d]);
            }
        }
        let extent = [0, 1, 2].map(|d| end[d].saturating_sub(start[d]));
        Self { start, extent, faces: vec![[NONE; 3]; extent.iter().product()] }
    }

    fn index(&self, cell: [usize; 3]) -> Option<usize> {
        let [x, y, z] = [0, 1, 2].map(|d| cell[d].wrapping_sub(self.start[d]));
        let [nx, ny, nz] = self.extent;
        (x < nx && y < ny && z < nz).then_some((z * ny + y) * nx + x)
    }

    fn set(&mut self, crossing: &Crossing, face: usize) {
        if let Some(index) = self.index(crossing.cell) {
            self.faces[index][crossing.axis] = face as u32;
        }
    }

    fn get(&self, cell: [usize; 3]) -> impl Iterator<Item = usize> + '_ {
        let of_cell = self.index(cell).map_or(&[NONE; 3], |index| &self.faces[index]);
        of_cell.iter().filter(|face| **face != NONE).map(|face| *face as usize)
    }
}

/// The dominant face nearest to the crossing `own`, of the same sheet, by its normal.
fn nearest<'a>(own: &Crossing, places: &Places, crossing: impl Fn(usize) -> &'a Crossing) -> Option<usize> {
    let middle =
        |c: &Crossing| Vector3::from_fn(|d, _| c.cell[d] as f64 + if d == c.axis { 0.0 } else { 0.5 });
    let mut best = (f64::INFINITY, None);
    for dz in -REACH..=REACH {
        for dy in -REACH..=REACH {
            for dx in -REACH..=REACH {
                let cell = [0, 1, 2].map(|d| own.cell[d].wrapping_add_signed([dx, dy, dz][d]));
                for j in places.get(cell) {
                    let other = crossing(j);
                    if own.normal.dot(&other.normal).abs() < SAME_SHEET {
                        continue;
                    }
                    // Off the tangent plane is farther than along it.
                    let apart = middle(own) - middle(other);
                    let distance = apart.norm_squared() + 3.0 * own.normal.dot(&apart).powi(2);
                    if distance < best.0 - 1e-12 {
                        best = (distance, Some(j));
                    }
                }
            }
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::grid::End;
    use crate::shapes;

    fn grid(cells: usize) -> Grid {
        let axis = || Axis::even(-1.0, 1.0, cells);
        let slip = Ends::Open([End::Slip, End::Slip]);
        Grid::new([axis(), axis(), axis()], [slip, slip, slip])
    }

    /// A line crosses a closed surface as often outwards as inwards, also where it meets nodes and edges exactly.
    #[test]
    fn closed_surface_has_no_hole() {
        let grid = grid(40);
        for (level, radius, shift) in [(3, 0.7, 0.0), (2, 0.5, 0.025), (3, 0.61, 0.0137), (0, 0.7, 0.025)] {
            let (mut nodes, faces) = shapes::sphere(radius, level);
            nodes.iter_mut().for_each(|x| *x += Vector3::repeat(shift));
            let cut = CutFaces::new(&grid, &nodes, &faces, 0.0).expect("inside");
            let mut lines: HashMap<(usize, usize, usize), [i32; 2]> = HashMap::new();
            for c in cut.crossings() {
                let [a, b] = [(c.axis + 1) % 3, (c.axis + 2) % 3];
                let sums = lines.entry((c.axis, c.cell[a], c.cell[b])).or_default();
                sums[0] += c.normal[c.axis].signum() as i32;
                sums[1] += 1;
            }
            assert!(lines.values().all(|s| s[0] == 0 && s[1] >= 2), "{level} {radius} {shift}");
            assert!(lines.len() > 3 * (1.9 * radius * radius * 400.0) as usize, "{}", lines.len());
        }
    }

    /// An octahedron whose edges lie on lines through the centres of cells, in numbers that are exact: each line inside crosses it twice.
    #[test]
    fn lines_through_edges_and_nodes_cross_once() {
        let (grid, radius, shift) = (grid(32), 0.75, 1.0 / 32.0);
        let (nodes, faces) = shapes::sphere(radius, 0);
        let nodes: Vec<_> = nodes.iter().map(|x| x + Vector3::repeat(shift)).collect();
        let cut = CutFaces::new(&grid, &nodes, &faces, 0.0).expect("inside");
        for axis in 0..3 {
            let [a, b] = [(axis + 1) % 3, (axis + 2) % 3];
            for p in 0..32 {
                for q in 0..32 {
                    let inside = (grid.axes[a].centre(p) - shift).abs()
                        + (grid.axes[b].centre(q) - shift).abs()
                        < radius;
                    let on_line = |c: &&Crossing| c.axis == axis && c.cell[a] == p && c.cell[b] == q;
                    let count = cut.crossings().iter().filter(on_line).count();
                    assert!(!inside || count == 2, "axis {axis}, line {p} {q}: {count} crossings");
                }
            }
        }
    }

    /// Every cut face belongs to one row, and the forces on nodes have the resultant and moment of those on faces.
    #[test]
    fn forces_on_nodes_are_those_on_faces() {
        let grid = grid(32);
        let (nodes, faces) = shapes::sphere(0.6, 3);
        let nodes: Vec<_> = nodes.iter().map(|x| x + Vector3::new(0.01, 0.02, -0.03)).collect();
        let cut = CutFaces::new(&grid, &nodes, &faces, 0.0).expect("inside");
        let jumps: Vec<f64> = (0..cut.rows.len()).map(|r| 1.0 + (r as f64).sin()).collect();
        let mut forces = vec![Vector3::zeros(); nodes.len()];
        cut.add_forces(&faces, &jumps, &mut forces);
        let (mut total, mut moment) = (Vector3::zeros(), Vector3::zeros());
        for (row, jump) in jumps.iter().enumerate() {
            for entry in cut.rows.offsets[row]..cut.rows.offsets[row + 1] {
                let c = &cut.crossings[cut.of_entry[entry].start];
                let x = Vector3::from_fn(|d, _| grid.coordinate(c.axis, d, c.cell[d]));
                let f = Vector3::ith(c.axis, cut.rows.weights[entry] * jump);
                total += f;
                moment += x.cross(&f);
            }
        }
        let sum: Vector3<f64> = forces.iter().sum();
        let turn: Vector3<f64> = nodes.iter().zip(&forces).map(|(x, f)| x.cross(f)).sum();
        assert!(
            (sum - total).norm() < 1e-12 && (turn - moment).norm() < 1e-12,
            "{sum} {total} {turn} {moment}"
        );
        let mut seen: Vec<_> = cut.rows.faces.clone();
        seen.sort_unstable();
        let count = seen.len();
        seen.dedup();
        assert_eq!((seen.len(), count), (cut.faces().len(), cut.faces().len()));
    }

    #[test]
    fn node_outside_the_core_is_named() {
        let (mut nodes, faces) = shapes::sphere(0.5, 1);
        nodes[7].y = 0.97;
        let error = CutFaces::new(&grid(20), &nodes, &faces, 0.0).expect_err("outside");
        assert!(error.to_string().contains("node 7") && error.to_string().contains("y = 0.97"), "{error}");
    }
}
