//! Vertical force of the structure on what holds it, from the momentum of the structure.
//!
//! In a frame that moves with the payload, $`p = \sum_i m_i \dot u_{i,z}`$ changes by the external forces $`F`$, by damping,
//! by the weight and inertia of the frame $`b = -g - \dot v`$ where the scene asks for them, and by the
//! reaction $`-R`$ of the held nodes. Internal forces cancel. Over a window of length $`T`$
//!
//! ```math
//! \bar R\,T = \int F_z\,dt - c \sum_i m_i \Delta u_{i,z} - \Delta p + b\,m\,T .
//! ```
//!
//! $`\int F_z\,dt`$ is summed at the points in time at which the steps balance forces, $`\Delta p`$ is that of the
//! velocities, and $`c\,m\,\Delta u`$ is the impulse of mass-proportional damping. So the momentum of structure and
//! payload together changes by the external impulse to round-off, whatever the time integration and
//! the tolerance of Newton's method. $`m`$ is the mass of the structure without the payload.
//!
//! Nodes whose height is prescribed have no share in $`p`$: what moves them is outside, and the force on it is
//! that of the lines, without the inertia of the payload's own point mass.

use crate::dynamics::{Dynamics, WindowInfo};

impl Dynamics {
    /// Mean of $`\bar R - b\,m`$ over the window of `dt` seconds that was computed last and gave `info`, N: the force
    /// on the held nodes without their and the structure's weight in the frame. Collective.
    pub fn mean_support_force(&self, dt: f64, info: &WindowInfo) -> f64 {
        let (from, to) = (&self.accepted, &self.current);
        let own = self.over_free_heights(|z| to.v[z] - from.v[z] + self.damping * (to.u[z] - from.u[z]));
        (info.applied_impulse - own) / dt
    }

    /// Vertical momentum of the nodes of free height at the end of the last window, N s. Collective.
    pub fn vertical_momentum(&self) -> f64 {
        self.over_free_heights(|z| self.current.v[z])
    }

    /// Sum of `value` of the vertical components of nodes of free height, each times the node's mass. Collective.
    fn over_free_heights(&self, value: impl Fn(usize) -> f64) -> f64 {
        let model = &self.system.model;
        let heights = (0..model.n_owned()).map(|n| (n, 3 * n + 2)).filter(|(_, z)| !model.fixed[*z]);
        model.comm.sum(heights.map(|(n, z)| self.system.lumped_mass(n) * value(z)).sum())
    }

    /// Mean vertical force on the mass of a free payload over the last window of `dt` seconds (lines, drag, inertia of
    /// the attachments' nodes), N, in a frame with the acceleration `body` (m/s2) on every mass; `None` without such
    /// a payload.
    pub fn mean_payload_force(&self, dt: f64, body: f64) -> Option<f64> {
        let (payload, from, to) = (self.payload()?, self.accepted.body?, self.current.body?);
        Some(payload.own_mass * ((to.v[2] - from.v[2]) / dt - body))
    }
}
