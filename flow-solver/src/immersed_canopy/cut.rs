//! Where the canopy cuts the grid.

use std::rc::Rc;

use immersed::cut_faces::{CutFaces, OutsideCore};
use immersed::face_transfer::FaceTransfer;
use immersed::flow::Flow;
use nalgebra::Vector3;

use super::canopy::CanopySurface;
use crate::face_permeability::FacePermeability;

/// Where the canopy cuts the grid at the end of a step, and how faces and constraints are connected there. Copies share what steps do not change.
#[derive(Clone, Debug, Default)]
pub struct Cut {
    /// Cut faces with their constraints.
    pub faces: CutFaces,
    /// Connection with the faces of the canopy.
    pub transfer: Rc<FaceTransfer>,
    /// Area of the cloth of each row, m2.
    areas: Rc<[f64]>,
    /// Vertices of the surface, m.
    vertices: Rc<[Vector3<f64>]>,
}

impl Cut {
    /// For vertices of the surface in coordinates of the grid, m. Collective.
    ///
    /// # Errors
    /// A node outside the even cells.
    pub fn new(flow: &Flow, surface: &CanopySurface, vertices: &[Vector3<f64>]) -> Result<Self, OutsideCore> {
        let CanopySurface { triangles, face_of, .. } = surface;
        let (grid, ranks) = (&flow.grid, &**flow.slabs().ranks());
        let faces = CutFaces::new(grid, vertices, triangles, 1.0)?;
        let transfer = FaceTransfer::new(grid, vertices, triangles, face_of, &faces, ranks)?;
        let areas = faces.rows.permeability.as_slice().into();
        Ok(Self { areas, vertices: vertices.into(), transfer: Rc::new(transfer), faces })
    }

    /// That of the `last` step where the surface has not moved in the grid since, else a new one.
    pub fn from_last(
        last: Option<&Self>,
        flow: &Flow,
        surface: &CanopySurface,
        vertices: &[Vector3<f64>],
    ) -> Result<Self, OutsideCore> {
        match last.filter(|last| *last.vertices == *vertices) {
            Some(last) => Ok(last.clone()),
            None => Self::new(flow, surface, vertices),
        }
    }

    /// Sets what passes through the cloth of the face of each row: nothing, or as at the last pressure jumps. `face_of`: face of each triangle; `floor`:
    /// jump below which the law is linear, Pa.
    pub fn set_cloth(&mut self, cloth: &FacePermeability, face_of: &[u32], jumps: &[f64], floor: f64) {
        for (r, area) in self.areas.iter().enumerate() {
            let jump = jumps.get(r).copied().unwrap_or(0.0).abs().max(floor);
            let face = face_of[self.faces.triangle_of(r)] as usize;
            self.faces.rows.permeability[r] =
                area * cloth.at(face).map_or(0.0, |cloth| cloth.velocity(jump, 0.0) / jump);
        }
    }
}

#[cfg(test)]
mod tests {
    use immersed::axis::Axis;
    use immersed::grid::{End, Ends, Grid};
    use immersed::slabs::Alone;

    use super::*;
    use crate::permeable::Permeability;

    /// A square of two faces, the first airtight: air passes the rows of the second alone, by its law at the last jump.
    #[test]
    fn rows_have_the_permeability_of_their_face() {
        let axis = || Axis::even(0.0, 1.6, 16);
        let grid = Grid::new([axis(), axis(), axis()], [Ends::Open([End::Slip; 2]); 3]);
        let at = |x: f64, y: f64| Vector3::new(x, y, 0.83);
        let vertices = [at(0.5, 0.5), at(0.8, 0.5), at(1.1, 0.5), at(1.1, 1.1), at(0.8, 1.1), at(0.5, 1.1)];
        let triangles = [[0u32, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]];
        let face_of = [0u32, 0, 1, 1];
        let faces = CutFaces::new(&grid, &vertices, &triangles, 1.0).expect("inside the grid");
        let transfer =
            FaceTransfer::new(&grid, &vertices, &triangles, &face_of, &faces, &Alone).expect("inside");
        let areas = faces.rows.permeability.clone();
        let mut cut = Cut {
            areas: areas.as_slice().into(),
            vertices: vertices.as_slice().into(),
            transfer: Rc::new(transfer),
            faces,
        };
        let cloth = FacePermeability::by_face(vec![None, Some(Permeability::new(100.0, 50.0))]);
        let jumps = vec![-30.0; areas.len()];
        cut.set_cloth(&cloth, &face_of, &jumps, 1.0);
        // 100 v + 50 v^2 = 30.
        let velocity = -1.0 + 1.6f64.sqrt();
        let mut rows = [0, 0];
        for (r, (found, area)) in cut.faces.rows.permeability.iter().zip(&areas).enumerate() {
            let face = face_of[cut.faces.triangle_of(r)];
            rows[face as usize] += 1;
            let exact = if face == 0 { 0.0 } else { area * velocity / 30.0 };
            assert!((found - exact).abs() < 1e-12 * area, "row {r} on face {face}: {found} {exact}");
        }
        assert!(rows[0] > 10 && rows[1] > 10, "{rows:?}");
    }
}
