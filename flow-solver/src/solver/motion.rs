//! Grid motion: geometry, swept volumes and wall velocities.

use super::*;

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Geometry of the moved grid.
    pub(super) fn move_grid(&mut self) -> Result<(), FlowError> {
        let _part = timing::part("geometry");
        assert!(
            self.settings.moving,
            "the solver was set up for a fixed grid (`Settings::moving` is false), but the grid moved"
        );
        let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
        let bad = self.nodes.iter().zip(&self.node_velocity).position(|(x, v)| !finite(x) || !finite(v));
        let finding = bad.map(|n| (self.topology.node_global[n], Vec3::zeros(), 0.0));
        if let Some((rank, (node, ..))) = agree(self.halo.comm(), finding) {
            return Err(FlowError::BadNode { node, rank });
        }
        self.metrics.update(&self.topology, &self.halo, &self.nodes);
        self.check_volumes()?;
        self.least_squares.update(&self.topology, &self.metrics);
        self.swept.resize(self.topology.face_nodes.len(), 0.0);
        self.swept_before.resize(self.topology.face_nodes.len(), 0.0);
        Metrics::swept(&self.topology, &self.previous[0].nodes, &self.nodes, &mut self.swept);
        if self.spatial.viscosity.is_active() {
            for side in &self.topology.no_slip {
                let mean = self.mean_node_velocity(side.face);
                self.wall_velocity[side.face as usize - self.topology.cells.len()] = mean;
            }
        }
        Ok(())
    }

    /// Mean velocity of the nodes of a face in the falling frame, m/s; zero on a grid at rest.
    pub(super) fn mean_node_velocity(&self, face: u32) -> Vec3 {
        if self.node_velocity.is_empty() {
            return Vec3::zeros();
        }
        let nodes = self.topology.face_nodes[face as usize];
        let count = if nodes[2] == nodes[3] { 3 } else { 4 };
        let sum = nodes[..count].iter().fold(Vec3::zeros(), |s, &n| s + self.node_velocity[n as usize]);
        sum / count as f64
    }

    pub(super) fn check_volumes(&self) -> Result<(), FlowError> {
        let n = self.topology.n_owned;
        let bad = self.metrics.volume[..n].iter().position(|v| v.is_nan() || *v <= 0.0);
        let finding =
            bad.map(|c| (self.topology.numbering.global[c], self.metrics.centre(c), self.metrics.volume[c]));
        match agree(self.halo.comm(), finding) {
            None => Ok(()),
            Some((rank, (cell, at, volume))) => Err(FlowError::InvertedCell { cell, at, rank, volume }),
        }
    }
}
