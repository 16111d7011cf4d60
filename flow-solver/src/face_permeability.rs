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
            // Infinite resistance is an airtight cloth, which closes a region.
            (a.is_finite() && b.is_finite()).then(|| Permeability::new(a, b))
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

#[cfg(test)]
mod tests {
    use super::*;
    use case::{Canopy, FabricGroup, GmshCanopy};

    /// Faces of `[fabric]`, of an airtight group and of one with a cloth of its own.
    #[test]
    fn faces_have_the_cloth_of_their_group() {
        let text = include_str!("../../cases/square-drop/scene.toml");
        let text = text.replacen("[fabric]", "[fabric]\npermeability = { viscous_pa_s_m = 100.0 }", 1);
        let mut scene = case::parse("scene.toml".as_ref(), &text).unwrap_or_else(|e| panic!("{e}"));
        let group = |viscous: f64| {
            let permeability = case::Permeability { viscous_pa_s_m: Some(viscous), ..Default::default() };
            FabricGroup { permeability: Some(permeability), ..FabricGroup::default() }
        };
        let fabrics = vec![group(f64::INFINITY), group(400.0)];
        scene.canopy = Canopy::Gmsh(GmshCanopy { file: "any.msh".into(), cables: Vec::new(), fabrics });
        let face_fabric = vec![Some(1), None, Some(0)];
        let canopy = StructureMesh { face_fabric, ..StructureMesh::default() };
        let found = FacePermeability::of_scene(&scene, &canopy, 1.225);
        let of = |viscous: f64| Some(Permeability::new(viscous, 0.0));
        assert_eq!([0, 1, 2].map(|face| found.at(face)), [of(400.0), of(100.0), None]);
        assert!(found.is_any());
        scene.make_airtight();
        assert!(!FacePermeability::of_scene(&scene, &canopy, 1.225).is_any());
    }
}
