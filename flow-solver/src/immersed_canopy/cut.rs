//! Where the canopy cuts the grid.

use immersed::cut_faces::{CutFaces, OutsideCore};
use immersed::face_transfer::FaceTransfer;
use immersed::flow::Flow;
use nalgebra::Vector3;

use super::canopy::CanopySurface;
use crate::face_permeability::FacePermeability;

/// Where the canopy cuts the grid at the end of a step, and how faces and constraints are connected there.
#[derive(Clone, Debug, Default)]
pub struct Cut {
    /// Cut faces with their constraints.
    pub faces: CutFaces,
    /// Connection with the faces of the canopy.
    pub transfer: FaceTransfer,
    /// Area of the cloth of each row, m2.
    areas: Vec<f64>,
    /// Vertices of the surface, m.
    vertices: Vec<Vector3<f64>>,
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
        Ok(Self { areas: faces.rows.permeability.clone(), vertices: vertices.to_vec(), faces, transfer })
    }

    /// That of the `last` step where the surface has not moved in the grid since, else a new one.
    pub fn from_last(
        last: Option<&Self>,
        flow: &Flow,
        surface: &CanopySurface,
        vertices: &[Vector3<f64>],
    ) -> Result<Self, OutsideCore> {
        match last.filter(|last| last.vertices == vertices) {
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
