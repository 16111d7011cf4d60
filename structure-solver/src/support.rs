//! Force of the structure on what holds it, from the momentum of the structure.
//!
//! In a frame that moves with the payload, $`\mathbf p = \sum_i m_i \dot{\mathbf u}_i`$ changes by the external forces
//! $`\mathbf F`$, by damping, by the weight and inertia of the frame $`\mathbf b = \mathbf g - \dot{\mathbf v}`$ where
//! the scene asks for them, and by the reaction $`-\mathbf R`$ of the held nodes. Internal forces cancel. Over a window of
//! length $`T`$
//!
//! ```math
//! \bar{\mathbf R}\,T = \int \mathbf F\,dt - c \sum_i m_i \Delta \mathbf u_i - \Delta \mathbf p + \mathbf b\,m\,T .
//! ```
//!
//! $`\int \mathbf F\,dt`$ is summed at the points in time at which the steps balance forces, $`\Delta \mathbf p`$ is that
//! of the velocities, and $`c\,m\,\Delta \mathbf u`$ is the impulse of mass-proportional damping. So the momentum of
//! structure and payload together changes by the external impulse to round-off, whatever the time integration and
//! the tolerance of Newton's method. $`m`$ is the mass of the structure without the payload.
//!
//! Components that are prescribed have no share in $`\mathbf p`$: what moves them is outside, and the force on it is
//! that of the lines, without the inertia of the payload's own point mass.

use mesh::geometry::Vec3;

use crate::dynamics::{Dynamics, WindowInfo};

impl Dynamics {
    /// Mean of $`\bar{\mathbf R} - \mathbf b\,m`$ over the window of `dt` seconds that was computed last and gave `info`,
    /// N: the force on the held nodes without their and the structure's weight in the frame. Collective.
    pub fn mean_support_force(&self, dt: f64, info: &WindowInfo) -> Vec3 {
        let (from, to) = (&self.accepted, &self.current);
        let own = self.over_free_components(|i| to.v[i] - from.v[i] + self.damping * (to.u[i] - from.u[i]));
        (info.applied_impulse - own) / dt
    }

    /// Momentum of the free components of all nodes at the end of the last window, N s. Collective.
    pub fn momentum(&self) -> Vec3 {
        self.over_free_components(|i| self.current.v[i])
    }

    /// Sums of `value` over the free components of all nodes in each axis, each times the node's mass. Collective.
    fn over_free_components(&self, value: impl Fn(usize) -> f64) -> Vec3 {
        let model = &self.system.model;
        let mut sums = [0.0; 3];
        for n in 0..model.n_owned() {
            let mass = self.system.lumped_mass(n);
            let free = (0..3).filter(|c| !model.fixed[3 * n + c]);
            free.for_each(|c| sums[c] += mass * value(3 * n + c));
        }
        model.comm.sum_slice(&mut sums);
        sums.into()
    }

    /// Mean force on the mass of a free payload over the last window of `dt` seconds (lines, drag, inertia of the
    /// attachments' nodes), N, in a frame with the acceleration `body` (m/s2) on every mass; `None` without such a payload.
    pub fn mean_payload_force(&self, dt: f64, body: Vec3) -> Option<Vec3> {
        let (payload, from, to) = (self.payload()?, self.accepted.body?, self.current.body?);
        Some(((to.v - from.v) / dt - body) * payload.own_mass)
    }
}
