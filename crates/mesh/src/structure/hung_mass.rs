//! Masses that hang on the payload, and the payload's own.

use case::Scene;

use crate::StructureMesh;

impl StructureMesh {
    /// Mass (kg) of a payload that this mesh of `scene` holds as a point mass on its node: the first of them.
    /// Zero where the payload is a body of its own or the mesh has no single node for it.
    pub fn payload_point_mass(&self, scene: &Scene) -> f64 {
        let point = scene.descent.as_ref().filter(|d| d.body.is_none());
        let held = |n: u32| self.fixed.iter().any(|(m, c)| *m == n && *c == [true; 3]);
        match (point, self.point_masses.first()) {
            (Some(d), Some(&(n, m))) if m == d.payload_mass_kg && held(n) => m,
            _ => 0.0,
        }
    }

    /// Sum of all other point masses, kg.
    pub fn hung_point_masses(&self, scene: &Scene) -> f64 {
        self.point_masses.iter().map(|(_, m)| m).sum::<f64>() - self.payload_point_mass(scene)
    }
}
