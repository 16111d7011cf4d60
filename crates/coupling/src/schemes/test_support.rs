//! Shared test fixtures.

use std::path::Path;

use case::{Coupling, CouplingOrder, Role, Scheme};
use channel::{LOAD_WIDTH, Stats, Window};
use mesh::Point;

use super::acceleration::relaxation::Uniform;
use super::build::{WindowLoopSetup, window_loop};
use super::unknowns::Unknowns;
use super::window::criterion::{Criterion, Field};
use super::window::values::InterfaceState;
use super::window::window_loop::WindowLoop;
use crate::error::RunError;
use crate::frame_axes::FrameAxes;
use crate::partners::{AcceptCost, LoadOverWindow, Partners, SolverResponse};

/// Flat square of `n` x `n` faces with side 1.
pub fn plate(n: usize) -> (Vec<Point>, Vec<[u32; 4]>) {
    let at = |i: usize, j: usize| (i * (n + 1) + j) as u32;
    let line = 0..=n;
    let positions = line
        .clone()
        .flat_map(|i| line.clone().map(move |j| [i as f64 / n as f64, j as f64 / n as f64, 0.0]))
        .collect();
    let faces = (0..n)
        .flat_map(|i| (0..n).map(move |j| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]))
        .collect();
    (positions, faces)
}

/// Closed-form solvers instead of the programs.
pub trait ClosedForm {
    /// Structure: its displacement, `[nodes][3]`, under a load over the window.
    fn solve_structure(&mut self, w: &Window, load: LoadOverWindow<'_>, displacement: &mut [f64]) -> Stats;

    /// Mesh: follows the displacement of the canopy.
    fn move_mesh(&mut self, displacement: &[f64]);

    /// Flow: its load, `[faces][LOAD_WIDTH]`.
    fn solve_flow(&mut self, w: &Window, load: &mut [f64]) -> Result<Stats, RunError>;

    /// The last responses become the accepted state.
    fn accept_window(&mut self, w: &Window);
}

impl<T: ClosedForm> Partners for T {
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<SolverResponse, RunError> {
        Ok(SolverResponse { stats: self.solve_structure(w, load, displacement), wall_s: 0.0 })
    }

    fn mesh(&mut self, _w: &Window, displacement: &[f64]) -> Result<SolverResponse, RunError> {
        self.move_mesh(displacement);
        Ok(SolverResponse::default())
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<SolverResponse, RunError> {
        Ok(SolverResponse { stats: self.solve_flow(w, load)?, wall_s: 0.0 })
    }

    fn accept(&mut self, w: &Window) -> Result<AcceptCost, RunError> {
        self.accept_window(w);
        Ok(AcceptCost::default())
    }

    fn save(&mut self, _folder: &Path) -> Result<(), RunError> {
        Ok(())
    }

    fn snapshot(&mut self, _role: Role, _time: f64, _folder: &Path) -> Result<(), RunError> {
        Ok(())
    }
}

/// An interface at rest without load, in a frame with this vertical velocity.
pub fn at_rest(nodes: usize, faces: usize, velocity: f64) -> InterfaceState {
    InterfaceState {
        displacement: vec![0.0; 3 * nodes],
        load: Some(vec![0.0; faces * LOAD_WIDTH]),
        velocity: [0.0, 0.0, velocity],
        ..InterfaceState::default()
    }
}

/// The loop over one node with one face, at rest; `scale` of the load in Jacobi order.
pub fn one_mode(coupling: &Coupling, scale: f64) -> WindowLoop {
    let mut unknowns = Unknowns::new(1, 1.0, FrameAxes::None);
    if coupling.scheme == Scheme::Implicit && coupling.order == CouplingOrder::Jacobi {
        unknowns = unknowns.with_loads(LOAD_WIDTH, scale);
    }
    let fields = vec![Field::new(0..unknowns.len(), 1e-9)];
    let criterion = Criterion::new(fields, coupling.tolerance);
    window_loop(WindowLoopSetup {
        stage: "test",
        coupling,
        unknowns,
        criterion,
        faces: 1,
        descent: None,
        interface: at_rest(1, 1, 0.0),
        relaxation: Box::new(Uniform(coupling.relaxation)),
        surrogate: None,
        accept_unconverged: false,
    })
}
