//! The interface of the coupling schemes to the three solver programs; running programs, recordings and closed-form
//! models implement it.

use std::path::Path;

use case::Role;
use channel::{Stats, Window};

use crate::error::RunError;

/// Load of the canopy over a window, each `[faces][LOAD_WIDTH]` (Pa).
#[derive(Clone, Copy)]
pub struct LoadOverWindow<'a> {
    /// At the start of the window.
    pub start: &'a [f64],
    /// At its end; the structure interpolates linearly over its substeps.
    pub end: &'a [f64],
}

/// Response of a program to one solve.
#[derive(Clone, Copy, Debug, Default)]
pub struct SolverResponse {
    /// Statistics; `busy_s` of the slowest rank.
    pub stats: Stats,
    /// Wall seconds from request to response.
    pub wall_s: f64,
}

/// What the programs spent on the acceptance of a window, all at the same time.
#[derive(Clone, Copy, Debug, Default)]
pub struct AcceptCost {
    /// Seconds that structure, flow, mesh worked; of the slowest rank.
    pub busy_s: [f64; 3],
    /// Wall seconds until all had done so.
    pub wall_s: f64,
}

/// Processor time and memory of all ranks of a program on this host.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Usage {
    /// Processor seconds, of the program and of the system for it.
    pub cpu_s: f64,
    /// Sum over the ranks of the most memory that each held, bytes.
    pub peak_bytes: u64,
}

/// The solver programs of a stage. Each solve may be repeated within a window; every time it starts from the last
/// accepted window.
///
/// # Examples
///
/// A closed-form model instead of the programs: one node on a spring, and a flow whose pressure falls with the
/// displacement. Its fixed point iteration diverges; interface quasi-Newton converges.
///
/// ```
/// use std::path::Path;
///
/// use case::{Acceleration, Coupling, LoadShape, Role};
/// use channel::{LOAD_WIDTH, Window};
/// use coupling::error::RunError;
/// use coupling::frame_axes::FrameAxes;
/// use coupling::partners::{AcceptCost, LoadOverWindow, Partners, SolverResponse};
/// use coupling::schemes::{Criterion, Field, InterfaceState, Uniform, Unknowns, WindowLoopSetup, window_loop};
///
/// /// Structure: z = p / 100 Pa/m. Flow: p = 8 Pa - 300 Pa/m z.
/// struct Spring {
///     z: f64,
/// }
///
/// impl Partners for Spring {
///     fn structure(
///         &mut self,
///         _: &Window,
///         load: LoadOverWindow<'_>,
///         displacement: &mut [f64],
///     ) -> Result<SolverResponse, RunError> {
///         displacement.copy_from_slice(&[0.0, 0.0, load.end[0] / 100.0]);
///         Ok(SolverResponse::default())
///     }
///
///     fn mesh(&mut self, _: &Window, displacement: &[f64]) -> Result<SolverResponse, RunError> {
///         self.z = displacement[2];
///         Ok(SolverResponse::default())
///     }
///
///     fn flow(&mut self, _: &Window, load: &mut [f64]) -> Result<SolverResponse, RunError> {
///         load.copy_from_slice(&[8.0 - 300.0 * self.z, 0.0, 0.0, 0.0]);
///         Ok(SolverResponse::default())
///     }
///
///     fn accept(&mut self, _: &Window) -> Result<AcceptCost, RunError> {
///         Ok(AcceptCost::default())
///     }
///
///     fn save(&mut self, _: &Path) -> Result<(), RunError> {
///         Ok(())
///     }
///
///     fn snapshot(&mut self, _: Role, _: f64, _: &Path) -> Result<(), RunError> {
///         Ok(())
///     }
/// }
///
/// let coupling = Coupling {
///     acceleration: Acceleration::IqnIls,
///     load_interpolation: Some(LoadShape::Linear),
///     tolerance: 1e-6,
///     ..Coupling::default()
/// };
/// let unknowns = Unknowns::new(1, 0.1, FrameAxes::None);
/// let fields = vec![Field::new(0..unknowns.len(), 1e-9)];
/// let mut windows = window_loop(WindowLoopSetup {
///     stage: "example",
///     coupling: &coupling,
///     unknowns,
///     criterion: Criterion::new(fields, coupling.tolerance),
///     faces: 1,
///     descent: None,
///     interface: InterfaceState {
///         displacement: vec![0.0; 3],
///         load: Some(vec![0.0; LOAD_WIDTH]),
///         ..InterfaceState::default()
///     },
///     relaxation: Box::new(Uniform(coupling.relaxation)),
///     surrogate: None,
///     accept_unconverged: false,
/// });
/// let window = Window { dt: 0.1, substeps: 1, ..Window::default() };
/// let report = windows.run(&mut Spring { z: 0.0 }, window, false)?;
/// assert!(report.converged && report.iterations < 8, "{report:?}");
/// // Balance: 100 Pa/m z = 8 Pa - 300 Pa/m z.
/// assert!((windows.state().displacement[2] - 0.02).abs() < 1e-7);
/// # Ok::<(), RunError>(())
/// ```
pub trait Partners {
    /// Structure: displacement `[nodes][3]` (m, from the unstressed shape) at
    /// the end of the window under `load`.
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<SolverResponse, RunError>;

    /// Mesh: moves the flow grid to the canopy's `displacement` `[nodes][3]`; where the canopy moves through the grid, the next solve of the flow
    /// is around it there.
    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<SolverResponse, RunError>;

    /// Flow: load `[faces][LOAD_WIDTH]` (Pa) at the end of the window.
    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<SolverResponse, RunError>;

    /// The last responses become the accepted state.
    fn accept(&mut self, w: &Window) -> Result<AcceptCost, RunError>;

    /// All programs write their accepted state below `folder`.
    fn save(&mut self, folder: &Path) -> Result<(), RunError>;

    /// One program adds its accepted state to its ParaView series below `folder`.
    fn snapshot(&mut self, role: Role, time: f64, folder: &Path) -> Result<(), RunError>;

    /// Names, for messages, of programs that do not support restart within a stage.
    fn cannot_resume(&self) -> Vec<String> {
        Vec::new()
    }

    /// Names of programs that cannot repeat a window with another length. All others announce the effect
    /// `coupling.adaptive`.
    fn fixed_windows(&self) -> Vec<String> {
        Vec::new()
    }

    /// Name, for messages, of a structure that does not report the mean force on the payload (effect
    /// `descent.equation`).
    fn without_support_force(&self) -> Option<String> {
        None
    }

    /// Processor time and memory of the programs so far.
    fn used(&self) -> Vec<(Role, Usage)> {
        Vec::new()
    }

    /// Grid of the last response of the mesh, `[grid nodes][6]`, where it is recorded.
    fn grid(&self) -> Option<&[f64]> {
        None
    }
}
