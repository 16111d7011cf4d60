//! Fields of the fabric that follow from its shape.

use mesh::geometry::{Vec3, at};
use mesh::vtk::read::{Column, Number, Piece};

/// Unit normals and areas (m2) of the faces at the present shape. A normal points out of the canopy: a positive pressure
/// jump pushes along it.
pub(super) fn normals_and_areas(piece: &Piece) -> [Column; 2] {
    let twice = |cell: usize| -> Vec3 {
        let Some((first, rest)) = piece.cell(cell).split_first() else { return Vec3::zeros() };
        let corner = |n: &u32| at(&piece.points, *n) - at(&piece.points, *first);
        rest.windows(2).map(|pair| corner(&pair[0]).cross(&corner(&pair[1]))).sum()
    };
    let all: Vec<Vec3> = (0..piece.n_cells()).map(twice).collect();
    let unit = |v: &Vec3| <[f64; 3]>::from(v.try_normalize(0.0).unwrap_or_else(Vec3::zeros));
    let column = |name: &str, width, values| Column { name: name.into(), width, number: Number::F64, values };
    [
        column("normal", 3, all.iter().flat_map(unit).collect()),
        column("area_m2", 1, all.iter().map(|v| 0.5 * v.norm()).collect()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh::vtk::write_surface;

    #[test]
    fn normals_and_areas_are_those_of_the_faces() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("canopy.vtu");
        let points = [[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 3.0, 1.0], [0.0, 3.0, 1.0], [0.0, 0.0, 3.0]];
        // A rectangle of 6 m2 seen from above, and a triangle in the plane y = 0 of 2 m2.
        write_surface(&file, &points, &[[0, 1, 2, 3], [0, 1, 4, 4]], &[], &[]).unwrap();
        let [normal, area] = normals_and_areas(&Piece::read(&file).unwrap());
        assert_eq!(normal.values, [0.0, 0.0, 1.0, 0.0, -1.0, 0.0]);
        assert_eq!(area.values, [6.0, 2.0]);
    }
}
