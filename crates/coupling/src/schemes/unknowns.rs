//! The coupled unknowns of a window as one vector.

use std::ops::Range;

use crate::frame_axes::FrameAxes;

/// Layout of the vector of coupled unknowns: displacement `[nodes][3]` (m),
/// then the frame's velocity in the axes in which it accelerates, times
/// [`Unknowns::velocity_scale`], then, where the load is iterated too, the load
/// `[faces][LOAD_WIDTH]` times [`Unknowns::load_scale`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unknowns {
    nodes: usize,
    window_s: f64,
    velocity_scale: f64,
    axes: FrameAxes,
    loads: usize,
    load_scale: f64,
}

impl Unknowns {
    /// For `nodes` canopy nodes and windows of `dt` seconds.
    ///
    /// The velocity is scaled by $`\Delta t \sqrt{N}`$: a change of the frame's velocity then has the norm of the nodal
    /// displacements that move the canopy equally far through the air within the window.
    pub fn new(nodes: usize, dt: f64, axes: FrameAxes) -> Self {
        let velocity_scale = dt * (nodes as f64).sqrt();
        Self { nodes, window_s: dt, velocity_scale, axes, loads: 0, load_scale: 0.0 }
    }

    /// Window length of the scales, s.
    pub fn window_s(&self) -> f64 {
        self.window_s
    }

    /// With `numbers` of the load among the unknowns, each times `scale` (m/Pa): best the displacement by a pressure
    /// on all faces within a window, so that both have the same weight.
    pub fn with_loads(self, numbers: usize, scale: f64) -> Self {
        Self { loads: numbers, load_scale: scale, ..self }
    }

    /// Number of load unknowns.
    pub fn loads(&self) -> usize {
        self.loads
    }

    /// Factor on the load in the vector, m/Pa.
    pub fn load_scale(&self) -> f64 {
        self.load_scale
    }

    fn loads_at(&self) -> usize {
        3 * self.nodes + self.axes.len()
    }

    /// Puts the load into `x`; no effect where the load is not an unknown.
    pub fn pack_load(&self, load: &[f64], x: &mut [f64]) {
        let at = self.loads_at();
        x[at..at + self.loads].iter_mut().zip(load).for_each(|(x, l)| *x = l * self.load_scale);
    }

    /// Load part of `x`, Pa.
    pub fn load(&self, x: &[f64], load: &mut [f64]) {
        load.iter_mut().zip(&x[self.loads_at()..]).for_each(|(l, x)| *l = x / self.load_scale);
    }

    /// Length of the vector.
    pub fn len(&self) -> usize {
        self.loads_at() + self.loads
    }

    /// Whether there is nothing to couple.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of displacement unknowns.
    pub fn displacements(&self) -> usize {
        3 * self.nodes
    }

    /// Axes in which the frame's velocity is an unknown.
    pub fn axes(&self) -> FrameAxes {
        self.axes
    }

    /// Places of the frame's velocity in the vector.
    pub fn velocities(&self) -> Range<usize> {
        3 * self.nodes..self.loads_at()
    }

    /// Factor on the velocity in the vector, s.
    pub fn velocity_scale(&self) -> f64 {
        self.velocity_scale
    }

    /// Puts displacement and velocity into `x`.
    pub fn pack(&self, displacement: &[f64], velocity: [f64; 3], x: &mut [f64]) {
        x[..3 * self.nodes].copy_from_slice(displacement);
        let places = x[self.velocities()].iter_mut().zip(self.axes.range());
        places.for_each(|(x, axis)| *x = velocity[axis] * self.velocity_scale);
    }

    /// Displacement part of `x`.
    pub fn displacement<'a>(&self, x: &'a [f64]) -> &'a [f64] {
        &x[..3 * self.nodes]
    }

    /// Velocity of the frame in `x`, m/s; `constant` in the axes in which it does not accelerate.
    pub fn velocity(&self, x: &[f64], constant: [f64; 3]) -> [f64; 3] {
        let mut velocity = constant;
        let places = x[self.velocities()].iter().zip(self.axes.range());
        places.for_each(|(x, axis)| velocity[axis] = x / self.velocity_scale);
        velocity
    }
}
