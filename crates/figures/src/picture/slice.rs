//! Vertical slices through flow and canopy.

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

/// The intersection of a cell with the plane.
pub(super) struct Patch {
    pub(super) outline: Outline,
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

    /// Intersections of the edges of a cell with the plane.
    fn crossings(self, piece: &Piece, sides: &[f64], cell: usize) -> Outline {
        let nodes = piece.cell(cell);
        let above = nodes.iter().filter(|&&n| sides[n as usize] >= 0.0).count();
        if above == 0 || above == nodes.len() {
            return Vec::new();
        }
        let cut = |[a, b]: [u32; 2]| {
            let (a, b) = (a as usize, b as usize);
            let (da, db) = (sides[a], sides[b]);
            ((da >= 0.0) != (db >= 0.0)).then(|| {
                let t = da / (da - db);
                let (p, q) = (piece.points[a], piece.points[b]);
                self.flat([0, 1, 2].map(|c| p[c] + t * (q[c] - p[c])))
            })
        };
        piece.edges(cell).filter_map(cut).collect()
    }

    fn sides(self, piece: &Piece) -> Vec<f64> {
        piece.points.iter().map(|&p| self.side(p)).collect()
    }

    /// The slice through the cells of a piece of the flow with velocities `[cells][3]`. Neighbours share the intersections
    /// of their edges, so the patches have no gaps.
    pub(super) fn patches(self, piece: &Piece, velocity: &[f64]) -> Vec<Patch> {
        let sides = self.sides(piece);
        let mut patches = Vec::new();
        for (cell, &v) in velocity.as_chunks::<3>().0.iter().enumerate().take(piece.n_cells()) {
            let mut outline = self.crossings(piece, &sides, cell);
            if outline.len() < 3 {
                continue;
            }
            let n = outline.len() as f64;
            let centre = [0, 1].map(|c| outline.iter().map(|p| p[c]).sum::<f64>() / n);
            let angle = |p: &[f64; 2]| (p[1] - centre[1]).atan2(p[0] - centre[0]);
            outline.sort_unstable_by(|a, b| angle(a).total_cmp(&angle(b)));
            let speed = v.iter().map(|x| x * x).sum::<f64>().sqrt();
            patches.push(Patch { outline, velocity: self.flat(v), speed });
        }
        patches
    }

    /// The slice through a surface.
    pub(super) fn lines(self, surface: &Piece) -> Vec<[[f64; 2]; 2]> {
        let sides = self.sides(surface);
        (0..surface.n_cells())
            .filter_map(|cell| match self.crossings(surface, &sides, cell)[..] {
                [a, b, ..] => Some([a, b]),
                _ => None,
            })
            .collect()
    }
}

impl Patch {
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
                let patches = Plane::new(diagonal, 2.0).patches(&piece, &velocity);
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
}
