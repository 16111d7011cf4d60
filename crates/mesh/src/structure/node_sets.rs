//! Nodes that a scene speaks of: by the name of a set, or by a point.

use crate::geometry::{Point, Vec3, at};
use crate::{MeshError, StructureMesh};

impl StructureMesh {
    /// Adds the sets that every structure has: `held`, `rim` and `canopy`. Physical
    /// groups of a mesh file that have these names stay as the file has them.
    pub(super) fn name_sets(&mut self) {
        let held = self.fixed.iter().filter(|(_, c)| c.contains(&true)).map(|(n, _)| *n).collect();
        let sets =
            [("held", held), ("rim", self.open_edges()), ("canopy", (0..self.n_canopy as u32).collect())];
        for (name, nodes) in sets {
            self.node_sets.entry(name.into()).or_insert(nodes);
        }
    }

    /// Nodes on edges of one face only, ascending.
    fn open_edges(&self) -> Vec<u32> {
        let sides = |f: &[u32; 4]| {
            let f = *f;
            (0..4).map(move |i| [f[i], f[(i + 1) % 4]]).filter(|[a, b]| a != b)
        };
        let mut edges: Vec<[u32; 2]> =
            self.faces.iter().flat_map(sides).map(|[a, b]| [a.min(b), a.max(b)]).collect();
        edges.sort_unstable();
        let single = edges.chunk_by(|a, b| a == b).filter(|c| c.len() == 1).map(|c| c[0]);
        let mut nodes: Vec<u32> = single.flatten().collect();
        nodes.sort_unstable();
        nodes.dedup();
        nodes
    }

    /// Nodes of the set `name`, or the node nearest to the point `near` (m, in the
    /// unstressed shape). `key` is where the scene says so, for messages.
    ///
    /// # Errors
    /// [`MeshError::UnknownNodeSet`] for an unknown or empty set, or neither of both.
    pub fn nodes_of(
        &self,
        key: &str,
        name: Option<&str>,
        near: Option<Point>,
    ) -> Result<Vec<u32>, MeshError> {
        if let Some(x) = near.map(Vec3::from) {
            let far = |n: &u32| (at(&self.coords, *n) - x).norm();
            let nearest = (0..self.coords.len() as u32).min_by(|a, b| far(a).total_cmp(&far(b)));
            return Ok(nearest.into_iter().collect());
        }
        let name = name.unwrap_or_default();
        match self.node_sets.get(name) {
            Some(nodes) if !nodes.is_empty() => Ok(nodes.clone()),
            found => Err(MeshError::UnknownNodeSet {
                key: key.into(),
                name: name.into(),
                what: if found.is_some() { "is empty" } else { "does not exist" },
                sets: self.node_sets.iter().filter(|(_, n)| !n.is_empty()).map(|(k, _)| k.clone()).collect(),
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use case::{AirBag, Canopy};

    use crate::structure::tests::scene;
    use crate::structure_mesh;

    #[test]
    fn node_sets_and_points_select_nodes() {
        let mut scene = scene(Canopy::AirBag(AirBag { edge_m: 0.4, cells_across: 4 }));
        let mass = |nodes: Option<&str>, at_m| case::PointMass {
            nodes: nodes.map(String::from),
            at_m,
            mass_kg: 2.0,
        };
        scene.point_masses = vec![mass(Some("rim"), None), mass(None, Some([0.11, 0.09, 0.0]))];
        let mesh = structure_mesh(&scene).unwrap();
        assert_eq!((mesh.node_sets["rim"].len(), mesh.node_sets["canopy"].len()), (16, 25));
        assert_eq!(mesh.node_sets["held"].len(), 16);
        assert_eq!(mesh.point_masses.len(), 17);
        assert_eq!(mesh.coords[mesh.point_masses[16].0 as usize], [0.1, 0.1, 0.0]);
        scene.point_masses = vec![mass(Some("rims"), None)];
        let error = structure_mesh(&scene).unwrap_err().to_string();
        assert!(error.contains("point_mass[0]") && error.contains("\"rims\" does not exist"), "{error}");
        assert!(error.contains("canopy, held, rim"), "{error}");
    }
}
