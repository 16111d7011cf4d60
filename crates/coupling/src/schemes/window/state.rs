//! State of an open window.

use channel::{LOAD_WIDTH, Window};

use super::load_shape::FlowLoads;
use super::report::WindowReport;
use super::values::{InterfaceState, InterfaceValues};
use crate::schemes::unknowns::Unknowns;

/// State of a coupling time window: its iterates, the values at its start and its end, and what it cost.
#[derive(Debug)]
pub struct WindowState {
    /// The open window: index, time, length, iteration, motion of the frame.
    pub window: Window,
    /// Values at its start.
    pub interface: InterfaceState,
    /// Values at its end.
    pub end: InterfaceValues,
    /// Unknowns at its start.
    pub start: Vec<f64>,
    /// Iterate $`x`$ of the unknowns.
    pub x: Vec<f64>,
    /// Response $`\tilde x`$ of the solvers to it.
    pub x_tilde: Vec<f64>,
    /// The iterate in preparation.
    pub next: Vec<f64>,
    /// Length of the window relative to the one before it.
    pub ratio: f64,
    /// The canopy was held until this window begins.
    pub released: bool,
    /// Structure solves in this window so far, including those of rejected attempts: more than flow solves where the
    /// structure is solved against a surrogate.
    pub structure_solves: u64,
    /// Cost of the window.
    pub report: WindowReport,
}

/// A configuration of the canopy in an open window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Configuration {
    /// At the start of the window.
    Start,
    /// The displacement of the iterate.
    Iterate,
    /// The last response of the structure.
    End,
}

impl WindowState {
    /// Before the first window, from `interface`, on an interface of `faces` faces.
    pub fn new(interface: InterfaceState, unknowns: &Unknowns, faces: usize) -> Self {
        let start = interface.unknowns(unknowns);
        Self {
            window: Window::default(),
            end: InterfaceValues {
                displacement: interface.displacement.clone(),
                load: vec![0.0; faces * LOAD_WIDTH],
                velocity: interface.velocity,
            },
            interface,
            x: start.clone(),
            x_tilde: start.clone(),
            next: start.clone(),
            start,
            ratio: 1.0,
            released: false,
            structure_solves: 0,
            report: WindowReport::default(),
        }
    }

    /// Returns to the last accepted window, with its values and the unknowns at its end.
    pub fn restore(&mut self, interface: InterfaceState, start: Vec<f64>) {
        self.x.clone_from(&start);
        self.x_tilde.clone_from(&start);
        self.next.clone_from(&start);
        self.end.displacement.clone_from(&interface.displacement);
        self.end.velocity = interface.velocity;
        if let Some(load) = &interface.load {
            self.end.load.clone_from(load);
        }
        (self.interface, self.start) = (interface, start);
    }

    /// Sets the frame velocity at the end of the window to `velocity` (m/s).
    pub fn set_frame_velocity(&mut self, velocity: [f64; 3]) {
        self.window.frame_velocity = velocity;
        self.window.frame_acceleration = self.frame_acceleration(velocity);
    }

    /// Mean acceleration (m/s2) of a frame that has this velocity (m/s) at the end of the window.
    pub fn frame_acceleration(&self, velocity: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|i| (velocity[i] - self.interface.velocity[i]) / self.window.dt)
    }

    /// Sets the frame velocity at the end of the window to that of the iterate.
    pub fn set_frame_to_iterate(&mut self, unknowns: &Unknowns) {
        self.set_frame_velocity(unknowns.velocity(&self.x, self.interface.velocity));
    }

    /// Flow loads of the window, with `end` at its end, each `[faces][LOAD_WIDTH]`, Pa.
    pub fn loads<'a>(&'a self, end: &'a [f64]) -> FlowLoads<'a> {
        FlowLoads::of(&self.interface, end, self.ratio, self.released)
    }

    /// Replaces an unknown load at the start of the window by the last response of the flow.
    pub fn set_unknown_start_load(&mut self) {
        self.interface.load.get_or_insert_with(|| self.end.load.clone());
    }

    /// Packs displacement and velocity of the last responses into $`\tilde x`$.
    pub fn pack_response(&mut self, unknowns: &Unknowns) {
        unknowns.pack(&self.end.displacement, self.end.velocity, &mut self.x_tilde);
    }

    /// Accepts the values at the end of the window as the start of the next one.
    pub fn accept(&mut self) {
        let acceleration = self.frame_acceleration(self.end.velocity);
        let (interface, end) = (&mut self.interface, &self.end);
        let mean = |i: usize| 0.5 * (interface.velocity[i] + end.velocity[i]);
        interface.position = std::array::from_fn(|i| interface.position[i] + mean(i) * self.window.dt);
        (interface.velocity, interface.acceleration) = (end.velocity, acceleration);
        interface.displacement.copy_from_slice(&end.displacement);
        std::mem::swap(&mut interface.load, &mut interface.load_before);
        let load = interface.load.get_or_insert_default();
        load.clear();
        load.extend_from_slice(&end.load);
        if self.released {
            // The load of the held canopy did not act on the free fabric.
            interface.load_before = None;
        }
        self.start.copy_from_slice(&self.x_tilde);
    }
}
