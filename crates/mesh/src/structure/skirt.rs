//! The ring of nodes where suspension lines are attached.

use crate::{CableKind, StructureMesh};

impl StructureMesh {
    /// Canopy nodes where suspension lines are attached, once each, in the order of their
    /// angle about the vertical through their middle: where a reefing line runs.
    pub fn skirt(&self) -> Vec<u32> {
        let lines = self.cables.iter().filter(|c| c.kind == CableKind::SuspensionLine);
        let mut nodes: Vec<u32> =
            lines.flat_map(|c| c.nodes).filter(|n| (*n as usize) < self.n_canopy).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let middle: [f64; 2] = std::array::from_fn(|i| {
            nodes.iter().map(|&n| self.coords[n as usize][i]).sum::<f64>() / nodes.len().max(1) as f64
        });
        let angle = |n: &u32| {
            let x = self.coords[*n as usize];
            (x[1] - middle[1]).atan2(x[0] - middle[0])
        };
        nodes.sort_by(|a, b| angle(a).total_cmp(&angle(b)).then(a.cmp(b)));
        nodes
    }
}

#[cfg(test)]
mod tests {
    use case::{Atps, Canopy};

    use crate::structure::tests::scene;
    use crate::structure_mesh;

    /// Neighbours on the hem follow each other: no step is longer than the gap between
    /// the outer lines of two arms.
    #[test]
    fn skirt_of_the_atps_is_a_ring() {
        let mesh = structure_mesh(&scene(Canopy::Atps(Atps::default()))).unwrap();
        let ring = mesh.skirt();
        let step = |k: usize| {
            let [a, b] = [ring[k], ring[(k + 1) % ring.len()]].map(|n| mesh.coords[n as usize]);
            ((a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2) + (a[2] - b[2]).powi(2)).sqrt()
        };
        let around: f64 = (0..ring.len()).map(step).sum();
        // Stitched at the hem: the corners are shared, and the ring is the whole hem.
        assert_eq!(ring.len(), 24);
        assert!((around - 4.0 * 6.096).abs() < 1e-6, "{around}");
    }
}
