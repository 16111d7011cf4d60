//! Vertical slices through flow and canopy.

use std::collections::{HashMap, HashSet};

use mesh::Point;
use mesh::vtk::read::Piece;

/// The slice plane: a vertical plane through the axis of the canopy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    /// Horizontal direction in the plane, length 1.
    along: [f64; 2],
    /// Distance of the plane from the axis, m.
    offset: f64,
}

/// A polygon or line of the slice: (distance along the plane, height), m.
pub(super) type Outline = Vec<[f64; 2]>;

/// Speeds at the nodes of the cells that intersect the plane: means over the cells of each node, over all pieces of a grid
/// (ParaView: "Cell Data to Point Data"). Nodes on the canopy have none, because the flow jumps across the fabric.
#[derive(Default)]
pub(super) struct NodeSpeeds(HashMap<Key, (f64, f64)>);

/// A point by its digits: ranks write identical digits for shared points.
type Key = [u32; 3];

/// Digits of a point in single precision, as snapshots may have it.
fn key(p: Point) -> Key {
    p.map(|x| (x as f32 + 0.0).to_bits())
}

impl NodeSpeeds {
    /// Means over `pieces`, each with its cell velocities `[cells][3]` (m/s), at the nodes near the plane.
    pub(super) fn new(plane: Plane, pieces: &[(&Piece, &[f64])], canopy: Option<&Piece>) -> Self {
        let mut speeds = HashMap::new();
        for (piece, _) in pieces {
            let sides = plane.sides(piece);
            for cell in (0..piece.n_cells()).filter(|&cell| met(piece, &sides, cell)) {
                speeds.extend(piece.cell(cell).iter().map(|&n| (key(piece.points[n as usize]), (0.0, 0.0))));
            }
        }
        if let Some(canopy) = canopy {
            // Canopy positions of grid and structure agree within the coupling tolerance only: compared in boxes.
            let (boxes, size) = boxes_around(canopy);
            speeds
                .retain(|key: &Key, _| !boxes.contains(&in_box(key.map(|b| f32::from_bits(b).into()), size)));
        }
        for (piece, velocity) in pieces {
            let keys: Vec<Option<Key>> =
                piece.points.iter().map(|&p| Some(key(p)).filter(|k| speeds.contains_key(k))).collect();
            for (cell, v) in velocity.as_chunks::<3>().0.iter().enumerate().take(piece.n_cells()) {
                for key in piece.cell(cell).iter().filter_map(|&n| keys[n as usize]) {
                    let (sum, count) = speeds.entry(key).or_default();
                    *sum += magnitude(*v);
                    *count += 1.0;
                }
            }
        }
        Self(speeds)
    }

    fn at(&self, point: Point) -> Option<f64> {
        self.0.get(&key(point)).map(|(sum, count)| sum / count)
    }
}

/// Box of a point among cubes of `size`, m.
fn in_box(p: Point, size: f64) -> [i64; 3] {
    p.map(|x| (x / size).round() as i64)
}

/// The boxes of the points of a surface with their neighbours, and the box size: 1/1000 of the width of the surface.
fn boxes_around(surface: &Piece) -> (HashSet<[i64; 3]>, f64) {
    let x = || surface.points.iter().map(|p| p[0]);
    let size = 1e-3 * (x().fold(f64::MIN, f64::max) - x().fold(f64::MAX, f64::min)).max(1e-9);
    let near = |b: [i64; 3]| (0..27).map(move |i| [b[0] + i % 3 - 1, b[1] + i / 3 % 3 - 1, b[2] + i / 9 - 1]);
    (surface.points.iter().flat_map(|&p| near(in_box(p, size))).collect(), size)
}

fn magnitude(v: [f64; 3]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Whether a cell has nodes on both sides of the plane.
fn met(piece: &Piece, sides: &[f64], cell: usize) -> bool {
    let nodes = piece.cell(cell);
    let above = nodes.iter().filter(|&&n| sides[n as usize] >= 0.0).count();
    above != 0 && above != nodes.len()
}

/// The intersection of a cell with the plane.
pub(super) struct Patch {
    pub(super) outline: Outline,
    /// Speeds at the corners of the outline, m/s.
    pub(super) speeds: Vec<f64>,
    /// Velocity relative to the canopy's frame, in the plane, m/s.
    pub(super) velocity: [f64; 2],
    /// Magnitude of the velocity, m/s.
    pub(super) speed: f64,
}

impl Plane {
    /// The plane `y = 0` or `y = x`, shifted by a small fraction of `size` (m) to avoid the faces of a symmetric grid.
    pub(super) fn new(diagonal: bool, size: f64) -> Self {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        Self { along: if diagonal { [half, half] } else { [1.0, 0.0] }, offset: 1e-6 * size }
    }

    /// Distance of a point from the plane.
    fn side(self, p: Point) -> f64 {
        p[1] * self.along[0] - p[0] * self.along[1] - self.offset
    }

    /// A point or vector in the coordinates of the plane.
    pub(super) fn flat(self, p: Point) -> [f64; 2] {
        [p[0] * self.along[0] + p[1] * self.along[1], p[2]]
    }

    /// Intersections of the edges of a cell with the plane, with the value of a function of the points there.
    fn crossings(
        self,
        piece: &Piece,
        sides: &[f64],
        cell: usize,
        value: impl Fn(Point) -> f64,
    ) -> Vec<([f64; 2], f64)> {
        if !met(piece, sides, cell) {
            return Vec::new();
        }
        let cut = |[a, b]: [u32; 2]| {
            let (a, b) = (a as usize, b as usize);
            let (da, db) = (sides[a], sides[b]);
            ((da >= 0.0) != (db >= 0.0)).then(|| {
                let t = da / (da - db);
                let (p, q) = (piece.points[a], piece.points[b]);
                let at = self.flat([0, 1, 2].map(|c| p[c] + t * (q[c] - p[c])));
                (at, (1.0 - t) * value(p) + t * value(q))
            })
        };
        piece.edges(cell).filter_map(cut).collect()
    }

    fn sides(self, piece: &Piece) -> Vec<f64> {
        piece.points.iter().map(|&p| self.side(p)).collect()
    }

    /// The slice through the cells of a piece of the flow with velocities `[cells][3]`. Neighbours share the intersections
    /// of their edges, so the patches have no gaps. Nodes without a speed in `nodes` use that of the cell.
    pub(super) fn patches(self, piece: &Piece, velocity: &[f64], nodes: &NodeSpeeds) -> Vec<Patch> {
        let sides = self.sides(piece);
        let mut patches = Vec::new();
        for (cell, &v) in velocity.as_chunks::<3>().0.iter().enumerate().take(piece.n_cells()) {
            let speed = magnitude(v);
            let mut corners = self.crossings(piece, &sides, cell, |p| nodes.at(p).unwrap_or(speed));
            if corners.len() < 3 {
                continue;
            }
            let n = corners.len() as f64;
            let centre = [0, 1].map(|c| corners.iter().map(|(p, _)| p[c]).sum::<f64>() / n);
            let angle = |p: &[f64; 2]| (p[1] - centre[1]).atan2(p[0] - centre[0]);
            corners.sort_unstable_by(|(a, _), (b, _)| angle(a).total_cmp(&angle(b)));
            let (outline, speeds) = corners.into_iter().unzip();
            patches.push(Patch { outline, speeds, velocity: self.flat(v), speed });
        }
        patches
    }

    /// The slice through a surface.
    pub(super) fn lines(self, surface: &Piece) -> Vec<[[f64; 2]; 2]> {
        let sides = self.sides(surface);
        (0..surface.n_cells())
            .filter_map(|cell| match self.crossings(surface, &sides, cell, |_| 0.0)[..] {
                [(a, _), (b, _), ..] => Some([a, b]),
                _ => None,
            })
            .collect()
    }
}

impl Patch {
    /// The middle of the corners, and the mean of their speeds.
    pub(super) fn middle(&self) -> ([f64; 2], f64) {
        let n = self.outline.len() as f64;
        let middle = [0, 1].map(|c| self.outline.iter().map(|p| p[c]).sum::<f64>() / n);
        (middle, self.speeds.iter().sum::<f64>() / n)
    }

    /// Whether a point lies in this patch (its corners run counterclockwise).
    pub(super) fn contains(&self, p: [f64; 2]) -> bool {
        let next = self.outline.iter().cycle().skip(1);
        self.outline
            .iter()
            .zip(next)
            .all(|(a, b)| (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= 0.0)
    }
}

#[cfg(test)]
mod tests {
    use mesh::vtk::write_volume;
    use mesh::{BoxShape, Patch as Side, box_grid_of};

    use super::*;

    fn area(outline: &Outline) -> f64 {
        let next = outline.iter().cycle().skip(1);
        0.5 * outline.iter().zip(next).map(|(a, b)| a[0] * b[1] - a[1] * b[0]).sum::<f64>()
    }

    #[test]
    fn patches_tile_the_slice_for_every_cell_type() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("flow.vtu");
        for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
            // 4 cells across: the plane runs through nodes.
            let grid = box_grid_of(shape, [4; 3], [-1.0; 3], [1.0; 3], [Side::Wall; 6]);
            write_volume(&file, &grid.coords, &grid.cells, &[], &[]).unwrap();
            let piece = Piece::read(&file).unwrap();
            let velocity = vec![2.0; 3 * piece.n_cells()];
            for (diagonal, expected) in [(false, 4.0), (true, 4.0 * 2f64.sqrt())] {
                let patches = Plane::new(diagonal, 2.0).patches(&piece, &velocity, &NodeSpeeds::default());
                let total: f64 = patches.iter().map(|p| area(&p.outline)).sum();
                assert!((total - expected).abs() < 1e-4, "{shape:?} {diagonal}: {total}");
                assert!(patches.iter().all(|p| (p.speed - 12f64.sqrt()).abs() < 1e-12));
                let in_plane = if diagonal { 8f64.sqrt() } else { 2.0 };
                assert!(patches.iter().all(|p| (p.velocity[0] - in_plane).abs() < 1e-12));
                let around = patches.iter().filter(|p| p.contains([0.11, 0.37])).count();
                assert_eq!(around, 1, "{shape:?} {diagonal}");
            }
        }
    }

    #[test]
    fn node_speeds_are_means_of_all_pieces_except_on_the_canopy() {
        let folder = tempfile::tempdir().unwrap();
        let piece = |name: &str, low: f64| {
            let file = folder.path().join(name);
            let grid = box_grid_of(
                BoxShape::Hexahedra,
                [1, 1, 1],
                [low, -1.0, 0.0],
                [low + 1.0, 1.0, 1.0],
                [Side::Wall; 6],
            );
            write_volume(&file, &grid.coords, &grid.cells, &[], &[]).unwrap();
            Piece::read(&file).unwrap()
        };
        let (left, right) = (piece("left.vtu", -1.0), piece("right.vtu", 0.0));
        let (slow, fast) = ([0.0, 0.0, 2.0], [0.0, 0.0, 6.0]);
        let pieces: [(&Piece, &[f64]); 2] = [(&left, &slow), (&right, &fast)];
        let plane = Plane::new(false, 1.0);
        let nodes = NodeSpeeds::new(plane, &pieces, None);
        let at = |nodes: &NodeSpeeds, x: f64| nodes.at([x, 1.0, 1.0]);
        assert_eq!([-1.0, 0.0, 1.0].map(|x| at(&nodes, x)), [Some(2.0), Some(4.0), Some(6.0)]);
        let patch = &plane.patches(&left, &slow, &nodes)[0];
        let found = patch.outline.iter().zip(&patch.speeds);
        assert!(
            found.clone().all(|(p, s)| (s - if p[0] < -0.5 { 2.0 } else { 4.0 }).abs() < 1e-6),
            "{:?}",
            patch.speeds
        );
        // A canopy between them has two sides.
        let nodes = NodeSpeeds::new(plane, &pieces, Some(&right));
        assert_eq!([-1.0, 0.0].map(|x| at(&nodes, x)), [Some(2.0), None]);
    }
}
