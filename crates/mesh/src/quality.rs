//! How good cells are: volume, scaled Jacobian, aspect.

use crate::geometry::{Point, Vec3, at};
use crate::{FlowGrid, HEX_FACES, MeshError};

/// Corners of a cell.
pub fn corners(coords: &[Point], cell: &[u32; 8]) -> [Vec3; 8] {
    cell.map(|n| at(coords, n))
}

/// Volume of a cell, m3: divergence theorem, each quadrilateral as four
/// triangles about the mean of its nodes.
pub fn volume(x: &[Vec3; 8]) -> f64 {
    // Relative to one corner, so that far-away cells keep their digits.
    let o = x[0];
    let mut sum = 0.0;
    for face in HEX_FACES {
        let p = face.map(|i| x[i] - o);
        let m = (p[0] + p[1] + (p[2] + p[3])) * 0.25;
        for i in 0..4 {
            sum += m.dot(&p[i].cross(&p[(i + 1) % 4]));
        }
    }
    sum / 6.0
}

/// Volume of cell `c`, m3.
pub fn cell_volume(grid: &FlowGrid, c: usize) -> f64 {
    volume(&corners(&grid.coords, &grid.cells[c]))
}

/// Mean of the (distinct) nodes of cell `c`, m.
pub fn cell_centre(grid: &FlowGrid, c: usize) -> Point {
    let cell = &grid.cells[c];
    let mut sum = Vec3::zeros();
    let mut n = 0.0;
    for i in 0..8 {
        if !cell[..i].contains(&cell[i]) {
            sum += at(&grid.coords, cell[i]);
            n += 1.0;
        }
    }
    (sum * (1.0 / n)).into()
}

/// Errs on the first cell without positive (or with unknown) volume.
pub(crate) fn check_volumes(grid: &FlowGrid) -> Result<(), MeshError> {
    for cell in 0..grid.cells.len() {
        let volume = cell_volume(grid, cell);
        if volume <= 0.0 || volume.is_nan() {
            return Err(MeshError::NegativeVolume { cell, at: cell_centre(grid, cell), volume });
        }
    }
    Ok(())
}

/// The three neighbours of each corner in VTK order, right-handed.
pub const CORNER_EDGES: [[usize; 3]; 8] =
    [[1, 3, 4], [2, 0, 5], [3, 1, 6], [0, 2, 7], [7, 5, 0], [4, 6, 1], [5, 7, 2], [6, 4, 3]];

/// Smallest scaled Jacobian over the corners of a cell: 1 for a rectangular
/// corner, 0 for a flat one, negative for an inverted one. Corners with a
/// collapsed edge are skipped. A cell whose corners are all skipped counts its
/// volume over its longest edge cubed.
pub fn scaled_jacobian(coords: &[Point], cell: &[u32; 8]) -> f64 {
    let mut worst = f64::INFINITY;
    for (corner, edges) in CORNER_EDGES.iter().enumerate() {
        let own = cell[corner];
        let ends = edges.map(|e| cell[e]);
        let degenerate =
            ends.contains(&own) || ends[0] == ends[1] || ends[1] == ends[2] || ends[2] == ends[0];
        if degenerate {
            continue;
        }
        let e = ends.map(|n| at(coords, n) - at(coords, own));
        let det = e[0].dot(&e[1].cross(&e[2]));
        worst = worst.min(det / (e[0].norm() * e[1].norm() * e[2].norm()));
    }
    if worst == f64::INFINITY {
        let x = corners(coords, cell);
        let mut longest = 0.0f64;
        for i in 0..8 {
            for j in 0..i {
                longest = longest.max((x[i] - x[j]).norm());
            }
        }
        worst = volume(&x) / longest.powi(3);
    }
    if worst.is_nan() { f64::NEG_INFINITY } else { worst }
}

/// Longest over shortest (uncollapsed) edge of a cell.
pub fn aspect(coords: &[Point], cell: &[u32; 8]) -> f64 {
    let (mut short, mut long) = (f64::INFINITY, 0.0f64);
    for (corner, edges) in CORNER_EDGES.iter().enumerate() {
        for &e in edges {
            if cell[e] != cell[corner] {
                let length = (at(coords, cell[e]) - at(coords, cell[corner])).norm();
                short = short.min(length);
                long = long.max(length);
            }
        }
    }
    long / short
}

/// The worst of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Summary {
    /// Number of cells.
    pub cells: usize,
    /// Smallest scaled Jacobian.
    pub min_scaled_jacobian: f64,
    /// Cell with the smallest scaled Jacobian.
    pub worst_cell: usize,
    /// Its centre, m.
    pub worst_at: Point,
    /// Smallest volume, m3.
    pub min_volume: f64,
    /// Sum of volumes, m3.
    pub total_volume: f64,
    /// Largest ratio of edges.
    pub max_aspect: f64,
}

/// Looks at every cell.
pub fn summary(grid: &FlowGrid) -> Summary {
    let mut s = Summary {
        cells: grid.cells.len(),
        min_scaled_jacobian: f64::INFINITY,
        worst_cell: 0,
        worst_at: [0.0; 3],
        min_volume: f64::INFINITY,
        total_volume: 0.0,
        max_aspect: 0.0,
    };
    for (c, cell) in grid.cells.iter().enumerate() {
        let j = scaled_jacobian(&grid.coords, cell);
        if j < s.min_scaled_jacobian {
            (s.min_scaled_jacobian, s.worst_cell) = (j, c);
        }
        let v = cell_volume(grid, c);
        s.min_volume = s.min_volume.min(v);
        s.total_volume += v;
        s.max_aspect = s.max_aspect.max(aspect(&grid.coords, cell));
    }
    if !grid.cells.is_empty() {
        s.worst_at = cell_centre(grid, s.worst_cell);
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoxShape, Patch, box_grid_of};

    #[test]
    fn quality_of_reference_shapes() {
        let cube = box_grid_of(BoxShape::Hexahedra, [1; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        assert_eq!(summary(&cube).min_scaled_jacobian, 1.0);
        assert_eq!(summary(&cube).total_volume, 1.0);
        let prisms = box_grid_of(BoxShape::Prisms, [1; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        // Corners at 45 degrees.
        assert!((summary(&prisms).min_scaled_jacobian - 0.5f64.sqrt()).abs() < 1e-15);
        let tets = box_grid_of(BoxShape::Tetrahedra, [1; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        assert!(summary(&tets).min_scaled_jacobian > 0.0);
        assert!((summary(&tets).max_aspect - 3f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn inverted_corner_has_negative_quality_and_skewed_volume_is_exact() {
        let mut cube = box_grid_of(BoxShape::Hexahedra, [1; 3], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        cube.coords[7] = [0.2, 0.2, 0.2];
        assert!(summary(&cube).min_scaled_jacobian < 0.0);
        // A shear keeps volume.
        let mut sheared = box_grid_of(BoxShape::Hexahedra, [3, 2, 4], [0.0; 3], [1.0; 3], [Patch::Wall; 6]);
        for x in &mut sheared.coords {
            x[0] += 0.7 * x[2] + 100.0;
        }
        assert!((summary(&sheared).total_volume - 1.0).abs() < 1e-12);
    }
}
