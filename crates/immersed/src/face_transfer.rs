//! What passes between the faces of a surface and the constraints of its cut faces: normal velocities one way, forces the other.
//!
//! The sum $`W_r`$ of the weights of row r by axis is that of steps: it deviates from the normal of the surface, whose force on slip has no other part.
//! A row spreads over the surface around it by a smooth function of the distance, of 1.5 cells; face f has the share $`s_{rf}`$. With the unit
//! normal $`n_f`$, the mean velocity $`\bar v_f`$ of a face and the velocity V of the grid
//! ```math
//! w_{rf} = s_{rf}\, W_r \cdot n_f, \qquad
//! b_r = W_r \cdot V + \sum_f w_{rf}\, n_f \cdot (\bar v_f - V), \qquad F_f = n_f \sum_r w_{rf}\, \lambda_r,
//! ```
//! so that the power on the faces in the frame of the grid, $`\sum_f F_f \cdot (\bar v_f - V)`$, is that which the air loses, to round-off. The rest of the
//! force that the air loses acts along the surface, at the steps:
//! ```math
//! T_f = \sum_r s_{rf}\, (W_r - n_f\, n_f \cdot W_r)\, \lambda_r .
//! ```
//! On slip it is an error of the grid; with friction it is what the steps take of that. As a load of the same instant it would give light cloth the
//! inertia of air also along its surface; its mean over time does not (`docs/decisions/0058-force-along-immersed-fabric.md`).
//! Faces may be smaller or larger than cells: the load on a face follows its area, not the number of lines that cross it.

use nalgebra::Vector3;

use crate::cut_faces::{CutFaces, OutsideCore, RowPlace, scaled_positions};
use crate::grid::Grid;
use crate::slabs::{Ranks, share};

/// Distance at which the share of a row vanishes, in cells.
const RADIUS: f64 = 1.5;
/// Factor of distances across the surface, so that another layer of cloth close by has no share.
const ACROSS: f64 = 3.0;
/// Least cosine between the normals of a point and a row of the same layer.
const SAME_LAYER: f64 = 0.3;
/// Largest distance of sample points on a triangle, in cells.
const SAMPLE_DISTANCE: f64 = 0.5;
/// Most intervals along an edge of a triangle.
const MAX_INTERVALS: usize = 200;

/// Faces, each of one or more triangles, with their rows.
#[derive(Clone, Debug, Default)]
pub struct FaceTransfer {
    /// First entry of each row; one more than rows.
    offsets: Vec<usize>,
    /// Face and its share $`s_{rf}`$.
    entries: Vec<(u32, f64)>,
    /// Unit normals of the faces.
    normals: Vec<Vector3<f64>>,
    /// Sum of the weights of each row by axis, m2.
    weights: Vec<Vector3<f64>>,
}

impl FaceTransfer {
    /// For the surface of `triangles` between nodes at `positions` (m, in the frame of the grid); `face_of` is the face of each triangle. Each of the
    /// `ranks` finds the faces of its share of the rows; all get all of them.
    ///
    /// # Errors
    /// A node outside the core.
    pub fn new(
        grid: &Grid,
        positions: &[Vector3<f64>],
        triangles: &[[u32; 3]],
        face_of: &[u32],
        cut: &CutFaces,
        ranks: &dyn Ranks,
    ) -> Result<Self, OutsideCore> {
        let scaled = scaled_positions(grid, positions)?;
        let rows = cut.rows.len();
        let samples = SamplesByCell::new(&scaled, triangles, face_of);
        let own = share(rows, ranks.rank(), ranks.size());
        let mut faces = FacesOfRow::new(face_of);
        let mut entries = Vec::new();
        let mut counts = vec![0.0; rows];
        let places = cut.row_places(own.clone(), triangles, &scaled);
        let mut places = places.iter().peekable();
        for row in own {
            faces.clear();
            while let Some(place) = places.next_if(|place| place.row == row) {
                samples.near(place, |face, area| faces.add(face, area));
            }
            let of_row = faces.shares(face_of[cut.triangle_of(row)]);
            let before = entries.len();
            entries.extend(of_row);
            counts[row] = (entries.len() - before) as f64;
        }
        let (offsets, entries) = gather_rows(ranks, counts, entries);
        let weights = (0..rows).map(|row| cut.rows.weight_by_axis(row)).collect();
        Ok(Self { offsets, entries, normals: face_normals(&scaled, triangles, face_of), weights })
    }

    /// Faces of a row with their shares of it.
    fn shares(&self, row: usize) -> &[(u32, f64)] {
        &self.entries[self.offsets[row]..self.offsets[row + 1]]
    }

    /// Faces of a row with their weights $`w_{rf}`$, m2.
    fn of_row(&self, row: usize) -> impl Iterator<Item = (u32, f64)> {
        let weight = &self.weights[row];
        self.shares(row).iter().map(|(f, share)| (*f, share * weight.dot(&self.normals[*f as usize])))
    }

    /// Fluxes of the rows, m3/s, for the mean velocities of the faces on a grid that moves with the velocity `grid`, m/s.
    pub fn fluxes(&self, velocities: &[Vector3<f64>], grid: Vector3<f64>, fluxes: &mut [f64]) {
        let through = |f: u32| self.normals[f as usize].dot(&(velocities[f as usize] - grid));
        for (row, flux) in fluxes.iter_mut().enumerate() {
            let relative: f64 = self.of_row(row).map(|(f, w)| w * through(f)).sum();
            *flux = self.weights[row].dot(&grid) + relative;
        }
    }

    /// Adds the forces on the faces, N, for the pressure jumps of the rows, Pa.
    pub fn add_forces(&self, jumps: &[f64], forces: &mut [Vector3<f64>]) {
        for (row, jump) in jumps.iter().enumerate() {
            for (face, weight) in self.of_row(row) {
                forces[face as usize] += self.normals[face as usize] * (jump * weight);
            }
        }
    }

    /// Adds the forces $`T_f`$ along the faces, N, for the pressure jumps of the rows, Pa.
    pub fn add_forces_along(&self, jumps: &[f64], forces: &mut [Vector3<f64>]) {
        for (row, jump) in jumps.iter().enumerate() {
            let weight = self.weights[row];
            for (face, share) in self.shares(row) {
                let normal = self.normals[*face as usize];
                forces[*face as usize] += (weight - normal * normal.dot(&weight)) * (jump * share);
            }
        }
    }
}

/// Unit normals of faces of one or more triangles; zero for a face without area.
fn face_normals(nodes: &[Vector3<f64>], triangles: &[[u32; 3]], face_of: &[u32]) -> Vec<Vector3<f64>> {
    let mut normals = vec![Vector3::zeros(); number_of_faces(face_of)];
    for (triangle, face) in triangles.iter().zip(face_of) {
        let [a, b, c] = triangle.map(|n| nodes[n as usize]);
        normals[*face as usize] += (b - a).cross(&(c - a));
    }
    normals.into_iter().map(|n: Vector3<f64>| n.try_normalize(0.0).unwrap_or_default()).collect()
}

/// Entries of all rows and the first one of each, from the own ones of each rank and the `counts` of its rows.
fn gather_rows(
    ranks: &dyn Ranks,
    mut counts: Vec<f64>,
    own: Vec<(u32, f64)>,
) -> (Vec<usize>, Vec<(u32, f64)>) {
    let (rows, size) = (counts.len(), ranks.size());
    let ends: Vec<usize> = (0..size).map(|r| share(rows, r, size).end).collect();
    ranks.gather(&mut counts, &ends);
    let mut offsets = vec![0];
    let mut sum = 0;
    offsets.extend(counts.iter().map(|count| {
        sum += *count as usize;
        sum
    }));
    if size == 1 {
        return (offsets, own);
    }
    let first = offsets[share(rows, ranks.rank(), size).start];
    let mut numbers = vec![0.0; 2 * sum];
    for (to, (face, share)) in numbers[2 * first..].chunks_exact_mut(2).zip(own) {
        to.copy_from_slice(&[f64::from(face), share]);
    }
    let ends: Vec<usize> = ends.iter().map(|end| 2 * offsets[*end]).collect();
    ranks.gather(&mut numbers, &ends);
    (offsets, numbers.chunks_exact(2).map(|entry| (entry[0] as u32, entry[1])).collect())
}

/// Areas of the faces of one row.
struct FacesOfRow {
    areas: Vec<(u32, f64)>,
    /// Position of each face in `areas`.
    places: Vec<u32>,
}

/// Position of a face that has no area in a row.
const NOWHERE: u32 = u32::MAX;

impl FacesOfRow {
    fn new(face_of: &[u32]) -> Self {
        Self { areas: Vec::new(), places: vec![NOWHERE; number_of_faces(face_of)] }
    }

    fn clear(&mut self) {
        self.areas.drain(..).for_each(|(face, _)| self.places[face as usize] = NOWHERE);
    }

    fn add(&mut self, face: u32, area: f64) {
        let place = &mut self.places[face as usize];
        if *place == NOWHERE {
            *place = self.areas.len() as u32;
            self.areas.push((face, area));
        } else {
            self.areas[*place as usize].1 += area;
        }
    }

    /// Shares of the faces; a row without area acts on `nearest`.
    fn shares(&mut self, nearest: u32) -> impl Iterator<Item = (u32, f64)> {
        let mut total: f64 = self.areas.iter().map(|(_, area)| area).sum();
        if total <= 0.0 {
            self.clear();
            self.add(nearest, 1.0);
            total = 1.0;
        }
        self.areas.iter().map(move |(face, area)| (*face, area / total))
    }
}

/// Number of faces of which triangles are.
fn number_of_faces(face_of: &[u32]) -> usize {
    face_of.iter().max().map_or(0, |f| *f as usize + 1)
}

/// A point of the surface, in units of core cells.
struct Sample {
    x: Vector3<f64>,
    normal: Vector3<f64>,
    /// Its part of the area of the surface.
    area: f64,
    face: u32,
}

/// Samples of the surface by the cell in which they lie, in a box of cells around them.
struct SamplesByCell {
    /// Lowest cell and numbers of cells of the box.
    low: [isize; 3],
    cells: [isize; 3],
    /// First sample of each cell; one more than cells.
    offsets: Vec<u32>,
    samples: Vec<Sample>,
}

impl SamplesByCell {
    fn new(scaled: &[Vector3<f64>], triangles: &[[u32; 3]], face_of: &[u32]) -> Self {
        let mut samples = Vec::new();
        for (nodes, face) in triangles.iter().zip(face_of) {
            for_samples(nodes.map(|n| scaled[n as usize]), |x, normal, area| {
                samples.push(Sample { x, normal, area, face: *face });
            });
        }
        let (mut low, mut high) = ([isize::MAX; 3], [isize::MIN; 3]);
        for sample in &samples {
            for d in 0..3 {
                let cell = sample.x[d].floor() as isize;
                (low[d], high[d]) = (low[d].min(cell), high[d].max(cell));
            }
        }
        let cells = [0, 1, 2].map(|d| if samples.is_empty() { 0 } else { high[d] - low[d] + 1 });
        let number = |s: &Sample| {
            let at = [0, 1, 2].map(|d| s.x[d].floor() as isize - low[d]);
            ((at[2] * cells[1] + at[1]) * cells[0] + at[0]) as usize
        };
        samples.sort_by_cached_key(number);
        let mut offsets = vec![0; cells.iter().product::<isize>() as usize + 1];
        samples.iter().for_each(|s| offsets[number(s) + 1] += 1);
        for i in 1..offsets.len() {
            offsets[i] += offsets[i - 1];
        }
        Self { low, cells, offsets, samples }
    }

    /// Faces of the samples around the place of a row, and what part of their area belongs to it.
    fn near(&self, place: &RowPlace, mut found: impl FnMut(u32, f64)) {
        let range = |d: usize| {
            let cell = |x: f64| x.floor() as isize - self.low[d];
            cell(place.x[d] - RADIUS).max(0)..cell(place.x[d] + RADIUS).min(self.cells[d] - 1) + 1
        };
        let x = range(0);
        if x.is_empty() {
            return;
        }
        for k in range(2) {
            for j in range(1) {
                let line = (k * self.cells[1] + j) * self.cells[0];
                let [from, to] = [line + x.start, line + x.end].map(|cell| self.offsets[cell as usize]);
                for sample in &self.samples[from as usize..to as usize] {
                    let apart = sample.x - place.x;
                    let across = apart.dot(&place.normal);
                    let distance = apart.norm_squared() + (ACROSS * ACROSS - 1.0) * across * across;
                    let near = 1.0 - distance / (RADIUS * RADIUS);
                    if near > 0.0 && sample.normal.dot(&place.normal).abs() > SAME_LAYER {
                        found(sample.face, sample.area * near * near);
                    }
                }
            }
        }
    }
}

/// Sample points of a triangle with its unit normal, each with its share of the area.
fn for_samples(x: [Vector3<f64>; 3], mut found: impl FnMut(Vector3<f64>, Vector3<f64>, f64)) {
    let [u, v] = [x[1] - x[0], x[2] - x[0]];
    let area = u.cross(&v);
    let Some(normal) = area.try_normalize(1e-14) else { return };
    let longest = u.norm().max(v.norm()).max((u - v).norm());
    let n = ((longest / SAMPLE_DISTANCE).ceil().max(1.0) as usize).min(MAX_INTERVALS);
    let part = area.norm() / (n * n) as f64;
    let at = |i: f64, j: f64| x[0] + (u * i + v * j) / n as f64;
    for i in 0..n {
        for j in 0..n - i {
            let third = 1.0 / 3.0;
            found(at(i as f64 + third, j as f64 + third), normal, part);
            if i + j + 1 < n {
                found(at(i as f64 + 2.0 * third, j as f64 + 2.0 * third), normal, part);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axis::Axis;
    use crate::grid::{End, Ends};
    use crate::shapes;
    use crate::slabs::Alone;

    fn grid(cells: usize) -> Grid {
        let axis = || Axis::even(-1.0, 1.0, cells);
        let slip = Ends::Open([End::Slip, End::Slip]);
        Grid::new([axis(), axis(), axis()], [slip, slip, slip])
    }

    struct Case {
        cut: CutFaces,
        transfer: FaceTransfer,
        nodes: Vec<Vector3<f64>>,
        faces: Vec<[u32; 3]>,
    }

    fn sphere(cells: usize, level: u32) -> Case {
        let grid = grid(cells);
        let (nodes, faces) = shapes::sphere(0.6, level);
        let nodes: Vec<_> = nodes.iter().map(|x| x + Vector3::new(0.01, 0.02, -0.03)).collect();
        let cut = CutFaces::new(&grid, &nodes, &faces, 0.0).expect("inside");
        let own: Vec<u32> = (0..faces.len() as u32).collect();
        let transfer = FaceTransfer::new(&grid, &nodes, &faces, &own, &cut, &Alone).expect("inside");
        Case { cut, transfer, nodes, faces }
    }

    fn area(c: &Case, f: usize) -> Vector3<f64> {
        let [a, b, d] = c.faces[f].map(|n| c.nodes[n as usize]);
        0.5 * (b - a).cross(&(d - a))
    }

    /// The power on the faces is that which the air loses, and the forces are normal, for faces larger and smaller than cells.
    #[test]
    fn power_is_conserved_and_forces_are_normal() {
        let grid_velocity = Vector3::new(0.3, -2.0, 1.0);
        for level in [1, 3, 5] {
            let c = sphere(32, level);
            let rows = c.cut.rows.len();
            let jumps: Vec<f64> = (0..rows).map(|r| 1.0 + (r as f64).sin()).collect();
            let velocities: Vec<_> = (0..c.faces.len())
                .map(|f| Vector3::new((f as f64).cos(), 0.3, (2.0 * f as f64).sin()))
                .collect();
            let (mut forces, mut fluxes) = (vec![Vector3::zeros(); c.faces.len()], vec![0.0; rows]);
            c.transfer.add_forces(&jumps, &mut forces);
            c.transfer.fluxes(&velocities, grid_velocity, &mut fluxes);
            let power: f64 = forces.iter().zip(&velocities).map(|(f, v)| f.dot(&(v - grid_velocity))).sum();
            let weight = |r: usize| c.cut.rows.weight_by_axis(r);
            let lost: f64 = (0..rows).map(|r| jumps[r] * (fluxes[r] - weight(r).dot(&grid_velocity))).sum();
            assert!((power - lost).abs() < 1e-12 * lost.abs().max(1.0), "{level}: {power} {lost}");
            for (f, force) in forces.iter().enumerate() {
                assert!(force.cross(&area(&c, f).normalize()).norm() < 1e-12, "{level}: face {f}");
            }
        }
    }

    /// Normal forces and those along the faces are all that the air loses, in each face and in sum.
    #[test]
    fn forces_along_the_faces_complete_what_the_air_loses() {
        for level in [1, 3, 5] {
            let c = sphere(32, level);
            let jumps: Vec<f64> = (0..c.cut.rows.len()).map(|r| 1.0 + (r as f64).sin()).collect();
            let zero = vec![Vector3::zeros(); c.faces.len()];
            let (mut normal, mut along) = (zero.clone(), zero);
            c.transfer.add_forces(&jumps, &mut normal);
            c.transfer.add_forces_along(&jumps, &mut along);
            let lost: Vector3<f64> =
                jumps.iter().enumerate().map(|(r, jump)| c.cut.rows.weight_by_axis(r) * *jump).sum();
            let sum: Vector3<f64> = normal.iter().chain(&along).sum();
            assert!((sum - lost).norm() < 1e-12, "{level}: {sum} {lost}");
            let largest = along.iter().map(|f| f.norm()).fold(0.0, f64::max);
            assert!(largest > 0.0);
            for (f, force) in along.iter().enumerate() {
                assert!(force.dot(&area(&c, f).normalize()).abs() < 1e-12 * largest, "{level}: face {f}");
            }
        }
    }

    /// A surface that moves with the grid takes the air along exactly.
    #[test]
    fn translation_with_the_grid_is_exact() {
        let c = sphere(24, 3);
        let v = Vector3::new(0.7, -0.2, 3.0);
        let mut fluxes = vec![0.0; c.cut.rows.len()];
        c.transfer.fluxes(&vec![v; c.faces.len()], v, &mut fluxes);
        for (r, flux) in fluxes.iter().enumerate() {
            assert!((flux - c.cut.rows.weight_by_axis(r).dot(&v)).abs() < 1e-15);
        }
    }

    /// A uniform jump gives each face a pressure near it, however small: no face is left out between the lines of cells. The edges of the
    /// faces are 2.3, 1.2 and 0.3 cells long in the mean (measured: rms 0.047, 0.071, 0.105).
    #[test]
    fn uniform_pressure_reaches_every_face() {
        for (level, bounds) in [(2, [0.16, 0.055]), (3, [0.26, 0.08]), (5, [0.63, 0.12])] {
            let c = sphere(32, level);
            let mut forces = vec![Vector3::zeros(); c.faces.len()];
            c.transfer.add_forces(&vec![1.0; c.cut.rows.len()], &mut forces);
            let (mut worst, mut square) = (0.0f64, 0.0);
            for (f, force) in forces.iter().enumerate() {
                let a = area(&c, f);
                let pressure = force.dot(&a) / a.norm_squared();
                worst = worst.max((pressure - 1.0).abs());
                square += (pressure - 1.0).powi(2) / forces.len() as f64;
            }
            let rms = f64::sqrt(square);
            println!("level {level}: worst {worst:.3}, rms {rms:.3}");
            assert!(worst < bounds[0] && rms < bounds[1], "level {level}: {worst} {rms}");
        }
    }
}
