//! The flow alone around the canopy held still, at the speed the run has so far.

use coupling::error::RunError;

use super::single::{Attempt, Questions};

pub(super) struct FlowOnly;

impl Questions for FlowOnly {
    fn ask(&mut self, attempt: &mut Attempt<'_>) -> Result<(), RunError> {
        attempt.flow()
    }
}
