//! A stage in which no program runs.

use std::path::Path;

use case::Role;
use channel::Window;
use coupling::error::RunError;
use coupling::partners::{AcceptCost, LoadOverWindow, Partners, SolverResponse};

/// No partners: they accept and save nothing, and solve nothing.
pub(super) struct WithoutPrograms;

fn none(role: Role) -> RunError {
    RunError::Input(format!("a stage without programs asked the {} for a solve", role.program()))
}

impl Partners for WithoutPrograms {
    fn structure(
        &mut self,
        _: &Window,
        _: LoadOverWindow<'_>,
        _: &mut [f64],
    ) -> Result<SolverResponse, RunError> {
        Err(none(Role::Structure))
    }

    fn mesh(&mut self, _: &Window, _: &[f64]) -> Result<SolverResponse, RunError> {
        Err(none(Role::Mesh))
    }

    fn flow(&mut self, _: &Window, _: &mut [f64]) -> Result<SolverResponse, RunError> {
        Err(none(Role::Flow))
    }

    fn accept(&mut self, _: &Window) -> Result<AcceptCost, RunError> {
        Ok(AcceptCost::default())
    }

    fn save(&mut self, _: &Path) -> Result<(), RunError> {
        Ok(())
    }

    fn snapshot(&mut self, _: Role, _: f64, _: &Path) -> Result<(), RunError> {
        Ok(())
    }
}
