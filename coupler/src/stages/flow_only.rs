//! Flow-only stage: the flow around the canopy at rest, at the current descent speed.

use coupling::error::RunError;

use super::single::{WindowSolve, WindowSolver};

pub(super) struct FlowOnly;

impl WindowSolver for FlowOnly {
    fn solve(&mut self, solve: &mut WindowSolve<'_>) -> Result<(), RunError> {
        solve.flow()
    }
}
