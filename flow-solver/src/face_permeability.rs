//! Permeability of each face of the canopy, by the cloth that it is made of.

use case::Scene;
use mesh::StructureMesh;

use crate::physics::Permeability;

/// Permeability of each face of the canopy.
#[derive(Clone, Debug, Default)]
pub struct FacePermeability {
    /// Of faces without a group, then of each group; `None`: airtight.
    cloths: Vec<Option<Permeability>>,
    /// Place of each face in `cloths`. Empty: all have the first.
    cloth_of: Vec<u16>,
}

impl FacePermeability {
    /// One cloth for all faces; `None`: airtight.
    pub fn uniform(cloth: Option<Permeability>) -> Self {
        Self { cloths: vec![cloth], cloth_of: Vec::new() }
    }

    /// A cloth for each face; `None`: airtight.
    pub fn by_face(cloths: Vec<Option<Permeability>>) -> Self {
        Self { cloth_of: (0..cloths.len() as u16).collect(), cloths }
    }

    /// Of the canopy of a scene, in air of `density` (kg/m3).
    pub fn of_scene(scene: &Scene, canopy: &StructureMesh, density: f64) -> Self {
        let cloth = |group: Option<u16>| {
            let (a, b) = scene.fabric_of(group).permeability.as_ref()?.coefficients(density);
            Some(Permeability::new(a, b))
        };
        let groups = (0..scene.fabric_groups().len()).map(|k| Some(k as u16));
        let place = |group: &Option<u16>| group.map_or(0, |k| k + 1);
        Self {
            cloths: std::iter::once(None).chain(groups).map(cloth).collect(),
            cloth_of: canopy.face_fabric.iter().map(place).collect(),
        }
    }

    /// Of a face; `None`: airtight.
    pub fn at(&self, face: usize) -> Option<Permeability> {
        let cloth = self.cloth_of.get(face).copied().unwrap_or(0);
        self.cloths.get(usize::from(cloth)).copied().flatten()
    }

    /// Whether air passes any face.
    pub fn is_any(&self) -> bool {
        self.cloths.iter().any(Option::is_some)
    }
}
