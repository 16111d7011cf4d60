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
    /// For the surface of `triangles` between nodes at `positions` (m, in the frame of the grid); `face_of` is the face of each triangle.
    ///
    /// # Errors
    /// A node outside the core.
    pub fn new(
        grid: &Grid,
        positions: &[Vector3<f64>],
        triangles: &[[u32; 3]],
        face_of: &[u32],
        cut: &CutFaces,
    ) -> Result<Self, OutsideCore> {
        let scaled = scaled_positions(grid, positions)?;
        let rows = cut.rows.len();
        let places =
            PlacesByCell::new(cut.row_places(triangles, &scaled), [0, 1, 2].map(|d| grid.axes[d].core.len()));
        let mut areas: Vec<Vec<(u32, f64)>> = vec![Vec::new(); rows];
        for (nodes, face) in triangles.iter().zip(face_of) {
            for_samples(nodes.map(|n| scaled[n as usize]), |x, normal, area| {
                places.near(&x, &normal, |row, share| match areas[row].last_mut() {
                    Some((last, sum)) if last == face => *sum += area * share,
                    _ => areas[row].push((*face, area * share)),
                });
            });
        }
        let normals = face_normals(&scaled, triangles, face_of);
        let mut transfer = Self { offsets: vec![0], normals, ..Self::default() };
        for (row, areas) in areas.iter().enumerate() {
            transfer.push(cut.rows.weight_by_axis(row), areas, face_of[cut.triangle_of(row)]);
        }
        Ok(transfer)
    }

    /// Adds a row with the sum `weight` of its weights (m2) and the areas of its faces; one without area acts on `nearest`.
    fn push(&mut self, weight: Vector3<f64>, areas: &[(u32, f64)], nearest: u32) {
        let total: f64 = areas.iter().map(|(_, area)| area).sum();
        let alone = [(nearest, 1.0)];
        let (areas, total) = if total > 0.0 { (areas, total) } else { (&alone[..], 1.0) };
        self.entries.extend(areas.iter().map(|(f, area)| (*f, area / total)));
        self.offsets.push(self.entries.len());
        self.weights.push(weight);
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
    let mut normals = vec![Vector3::zeros(); face_of.iter().max().map_or(0, |f| *f as usize + 1)];
    for (triangle, face) in triangles.iter().zip(face_of) {
        let [a, b, c] = triangle.map(|n| nodes[n as usize]);
        normals[*face as usize] += (b - a).cross(&(c - a));
    }
    normals.into_iter().map(|n: Vector3<f64>| n.try_normalize(0.0).unwrap_or_default()).collect()
}

/// Places of rows by the cell of the core that they lie in.
struct PlacesByCell {
    cells: [usize; 3],
    /// First place of each cell; one more than cells.
    offsets: Vec<u32>,
    places: Vec<RowPlace>,
}

impl PlacesByCell {
    fn new(mut places: Vec<RowPlace>, cells: [usize; 3]) -> Self {
        let number = |p: &RowPlace| {
            let at = [0, 1, 2].map(|d| (p.x[d].floor().max(0.0) as usize).min(cells[d] - 1));
            (at[2] * cells[1] + at[1]) * cells[0] + at[0]
        };
        places.sort_by_key(number);
        let mut offsets = vec![0; cells.iter().product::<usize>() + 1];
        places.iter().for_each(|p| offsets[number(p) + 1] += 1);
        for i in 1..offsets.len() {
            offsets[i] += offsets[i - 1];
        }
        Self { cells, offsets, places }
    }

    /// Rows around a point of the surface with the unit normal `normal`, and what share of its area each has.
    fn near(&self, x: &Vector3<f64>, normal: &Vector3<f64>, mut found: impl FnMut(usize, f64)) {
        let range = |d: usize| {
            let last = self.cells[d] - 1;
            let cell = |x: f64| (x.floor().max(0.0) as usize).min(last);
            cell(x[d] - RADIUS)..=cell(x[d] + RADIUS)
        };
        for k in range(2) {
            for j in range(1) {
                let line = (k * self.cells[1] + j) * self.cells[0];
                let (from, to) = (line + range(0).start(), line + range(0).end());
                for place in &self.places[self.offsets[from] as usize..self.offsets[to + 1] as usize] {
                    let apart = x - place.x;
                    let across = apart.dot(&place.normal);
                    let distance = apart.norm_squared() + (ACROSS * ACROSS - 1.0) * across * across;
                    let near = 1.0 - distance / (RADIUS * RADIUS);
                    if near > 0.0 && normal.dot(&place.normal).abs() > SAME_LAYER {
                        found(place.row, near * near);
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
        let transfer = FaceTransfer::new(&grid, &nodes, &faces, &own, &cut).expect("inside");
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
