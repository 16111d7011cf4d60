//! A payload that is a body: where its lines are attached.

use case::PayloadBody;

use super::refuse;
use crate::{MeshError, Point, StructureMesh};

impl StructureMesh {
    /// Gives each attachment of the payload a node of its own, held like the payload's point,
    /// which is the mean of them; lines take them in turn. Returns nothing to be moved: the
    /// nodes stand in the set `payload`, in the order of the attachments.
    pub(super) fn attach_payload(&mut self, body: &PayloadBody) -> Result<(), MeshError> {
        let held = |n: &u32| self.fixed.iter().any(|(m, c)| m == n && *c == [true; 3]);
        let ends = self.cables.iter().flat_map(|c| c.nodes);
        let Some(payload) = ends.filter(|n| *n as usize >= self.n_canopy).find(held) else {
            return Err(refuse("descent.body", "a body", "no line ends at a payload that is held"));
        };
        let middle = self.coords[payload as usize];
        let mean = mean(&body.attachments_m);
        let place = |a: &Point| std::array::from_fn(|i| middle[i] + a[i] - mean[i]);
        let mut nodes = vec![payload];
        self.coords[payload as usize] = place(&body.attachments_m[0]);
        for a in &body.attachments_m[1..] {
            let node = self.push_node(place(a));
            self.fixed.push((node, [true; 3]));
            nodes.push(node);
        }
        let mut turn = 0;
        for end in self.cables.iter_mut().flat_map(|c| &mut c.nodes).filter(|n| **n == payload) {
            *end = nodes[turn % nodes.len()];
            turn += 1;
        }
        if turn < nodes.len() {
            let count = format!("{} attachments", nodes.len());
            return Err(refuse(
                "descent.body.attachments_m",
                count,
                format!("only {turn} lines end at the payload"),
            ));
        }
        self.node_sets.insert("payload".into(), nodes);
        Ok(())
    }
}

fn mean(points: &[Point]) -> Point {
    std::array::from_fn(|i| points.iter().map(|p| p[i]).sum::<f64>() / points.len() as f64)
}

#[cfg(test)]
mod tests {
    use case::{Atps, Canopy};

    use super::*;
    use crate::structure::tests::scene;
    use crate::{CableKind, structure_mesh};

    #[test]
    fn risers_are_assigned_to_attachments_cyclically() {
        let mut s = scene(Canopy::Atps(Atps::default()));
        let plain = structure_mesh(&s).unwrap();
        let arm = |x: f64, y: f64| [x, y, 0.4];
        let attachments_m = vec![arm(0.3, 0.0), arm(0.0, 0.3), arm(-0.3, 0.0), arm(0.0, -0.3)];
        s.descent.as_mut().unwrap().body = Some(PayloadBody {
            inertia_kg_m2: [3.0, 3.0, 4.0],
            attachments_m,
            initial_velocity_m_s: [0.0; 3],
            initial_spin_rad_s: [0.0; 3],
            initial_rotation_deg: [0.0; 3],
        });
        let mesh = structure_mesh(&s).unwrap();
        assert_eq!(mesh.coords.len(), plain.coords.len() + 3);
        let nodes = &mesh.node_sets["payload"];
        let risers: Vec<_> = mesh.cables.iter().filter(|c| c.kind == CableKind::Riser).collect();
        for (k, riser) in risers.iter().enumerate() {
            assert_eq!(riser.nodes[1], nodes[k]);
        }
        let (payload, _) = plain.fixed[0];
        let middle = plain.coords[payload as usize];
        assert!((mesh.coords[nodes[0] as usize][0] - 0.3).abs() < 1e-12);
        assert!((mesh.coords[nodes[0] as usize][2] - middle[2]).abs() < 1e-12);
        // The body has its mass itself.
        assert!(mesh.point_masses.is_empty());
        s.descent.as_mut().unwrap().body.as_mut().unwrap().attachments_m = vec![[0.0; 3]; 5];
        let error = structure_mesh(&s).unwrap_err().to_string();
        assert!(error.contains("only 4 lines"), "{error}");
    }
}
