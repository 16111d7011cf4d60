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
pub trait Partners {
    /// Structure: displacement `[nodes][3]` (m, from the unstressed shape) at
    /// the end of the window under `load`.
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<SolverResponse, RunError>;

    /// Mesh: moves the flow grid to the canopy's `displacement` `[nodes][3]`.
    fn mesh(&mut self, w: &Window, displacement: &[f64]) -> Result<SolverResponse, RunError>;

    /// Flow: load `[faces][LOAD_WIDTH]` (Pa) at the end of the window.
    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<SolverResponse, RunError>;

    /// The last responses become the accepted state.
    fn accept(&mut self, w: &Window) -> Result<(), RunError>;

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
