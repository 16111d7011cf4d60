//! Grid motion: geometry, swept volumes and wall velocities.

use mesh::geometry::distinct;

use super::*;
use crate::geometry::vec3::Mat3;
use crate::topology::Side;

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Geometry of the moved grid.
    pub(super) fn move_grid(&mut self, dt: f64) -> Result<(), FlowError> {
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
        timing::timed("metrics", || self.metrics.update(&self.topology, &self.halo, &self.nodes));
        self.check_volumes()?;
        timing::timed("least squares", || self.least_squares.update(&self.topology, &self.metrics));
        self.swept.resize(self.topology.face_nodes.len(), 0.0);
        self.swept_before.resize(self.topology.face_nodes.len(), 0.0);
        timing::timed("swept volumes", || {
            Metrics::swept(&self.topology, &self.previous[0].nodes, &self.nodes, &mut self.swept);
        });
        if self.spatial.viscosity.is_active() {
            let first = self.topology.cells.len();
            self.boundary.spin.resize(self.wall_velocity.len(), Vec3::zeros());
            for side in &self.topology.no_slip {
                let at = side.face as usize - first;
                if side.canopy == u32::MAX {
                    (self.wall_velocity[at], self.boundary.spin[at]) = self.rigid_wall(side, dt);
                } else {
                    self.wall_velocity[at] = self.mean_node_velocity(side.face);
                }
            }
        }
        Ok(())
    }

    /// Velocity of a wall of the outer boundary at its face, and what the rotation of the wall as a rigid body adds to it at the
    /// centre of the cell, m/s: a rotation of wall and air together has no friction. By the time difference of the step, as the
    /// volumes that the face sweeps. Where the nodes are at rest, the velocities that the grid comes with: a wall may slide on it.
    /// Nodes that slide along a wall at rest ([`Solver::set_walls_at_rest`]) do not move it.
    pub(super) fn rigid_wall(&self, side: &Side, dt: f64) -> (Vec3, Vec3) {
        let place = side.face as usize - self.topology.cells.len();
        if self.boundary.at_rest.get(place) == Some(&true) {
            return (Vec3::zeros(), Vec3::zeros());
        }
        let [c0, _, c2] = self.order(dt).c;
        let [x1, x2] = [&self.previous[0].nodes, &self.previous[1].nodes];
        let nodes = distinct(&self.topology.face_nodes[side.face as usize]);
        let velocity = |n: u32| {
            let (n, earlier) = (n as usize, |n: usize| if c2 == 0.0 { Vec3::zeros() } else { x1[n] - x2[n] });
            ((self.nodes[n] - x1[n]) * c0 - earlier(n) * c2) / dt
        };
        let count = nodes.len() as f64;
        let mean = nodes.iter().fold(Vec3::zeros(), |s, &n| s + velocity(n)) / count;
        if nodes.iter().all(|&n| velocity(n) == Vec3::zeros()) {
            return (self.mean_node_velocity(side.face), Vec3::zeros());
        }
        let middle = nodes.iter().fold(Vec3::zeros(), |s, &n| s + self.nodes[n as usize]) / count;
        let rate =
            rigid_rotation(nodes.iter().map(|&n| (self.nodes[n as usize] - middle, velocity(n) - mean)));
        let arm = self.metrics.centre(side.cell as usize) - self.metrics.border(side.face);
        (mean, rate.cross(&arm))
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

/// Angular velocity, rad/s, of the rigid rotation that is nearest to the velocities `v` (m/s) at the places `r` (m), both
/// relative to their means: $`\sum (r \cdot r - r r^T)\, \omega = \sum r \times v`$.
fn rigid_rotation(places: impl Iterator<Item = (Vec3, Vec3)>) -> Vec3 {
    let (mut matrix, mut moment) = (Mat3::zeros(), Vec3::zeros());
    for (r, v) in places {
        matrix += Mat3::identity() * r.dot(&r) - r * r.transpose();
        moment += r.cross(&v);
    }
    matrix.try_inverse().map_or_else(Vec3::zeros, |inverse| inverse * moment)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_of_a_rigid_face_is_exact() {
        let rate = Vec3::new(0.3, -2.0, 1.1);
        let corners = [[1.0, 0.2, 0.0], [-0.4, 0.5, 0.3], [-0.6, -0.7, -0.3]].map(Vec3::from);
        for n in [3, 4] {
            let last = -(corners[0] + corners[1] + corners[2]);
            let mean = if n == 3 { -last / 3.0 } else { Vec3::zeros() };
            let all = corners.into_iter().chain([last]).take(n).map(|r| r - mean);
            let found = rigid_rotation(all.map(|r| (r, rate.cross(&r))));
            assert!((found - rate).norm() < 1e-13, "{found}");
        }
        assert_eq!(rigid_rotation([(Vec3::zeros(), rate)].into_iter()), Vec3::zeros());
    }
}
