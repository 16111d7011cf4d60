//! The coupled unknowns of a window as one vector.

/// Layout of the vector of coupled unknowns: displacement `[nodes][3]` (m),
/// then, when the canopy descends, the frame's vertical velocity times
/// [`Unknowns::velocity_scale`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknowns {
    nodes: usize,
    velocity_scale: f64,
    descends: bool,
}

impl Unknowns {
    /// For `nodes` canopy nodes and windows of `dt` seconds.
    ///
    /// The velocity is scaled by $\Delta t \sqrt{N}$: a change of the frame's
    /// velocity then weighs as much as the displacement of all nodes that would
    /// move the canopy equally far through the air within the window.
    pub fn new(nodes: usize, dt: f64, descends: bool) -> Self {
        Self { nodes, velocity_scale: dt * (nodes as f64).sqrt(), descends }
    }

    /// Length of the vector.
    pub fn len(&self) -> usize {
        3 * self.nodes + usize::from(self.descends)
    }

    /// Whether there is nothing to couple.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Numbers that are displacements.
    pub fn displacements(&self) -> usize {
        3 * self.nodes
    }

    /// Factor on the velocity in the vector, s.
    pub fn velocity_scale(&self) -> f64 {
        self.velocity_scale
    }

    /// Puts displacement and velocity into `x`.
    pub fn pack(&self, displacement: &[f64], velocity: f64, x: &mut [f64]) {
        x[..3 * self.nodes].copy_from_slice(displacement);
        if self.descends {
            x[3 * self.nodes] = velocity * self.velocity_scale;
        }
    }

    /// Displacement part of `x`.
    pub fn displacement<'a>(&self, x: &'a [f64]) -> &'a [f64] {
        &x[..3 * self.nodes]
    }

    /// Velocity in `x`, m/s; `at_rest` when the frame does not descend.
    pub fn velocity(&self, x: &[f64], at_rest: f64) -> f64 {
        if self.descends { x[3 * self.nodes] / self.velocity_scale } else { at_rest }
    }
}
