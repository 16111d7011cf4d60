//! What schemes and accelerations carry from window to window, as bytes, so that a run goes on
//! where another one was saved, to the last digit.

use archive::codec::fixed;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::window::WindowLoop;
use crate::error::RunError;

/// `value` as bytes.
pub fn pack(value: &impl Serialize) -> Vec<u8> {
    fixed::encode(value)
}

/// What [`pack`] packed.
///
/// # Errors
/// Bytes of another scheme.
pub fn unpack<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, RunError> {
    fixed::decode(bytes).map_err(|_| {
        RunError::Input(
            "the saved state of the coupling is that of another scheme or version of ripstop".into(),
        )
    })
}

impl WindowLoop {
    /// What later windows depend on.
    pub fn memory(&self) -> Vec<u8> {
        let lengths = [self.last_dt, self.tuned_dt];
        pack(&(&self.state, &self.start, lengths, self.sequence.memory(), self.accelerator.memory()))
    }

    /// Goes on from a [`WindowLoop::memory`] of the same scheme.
    ///
    /// # Errors
    /// A memory of another one.
    pub fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        let (state, start, [last_dt, tuned_dt], sequence, accelerator): (
            _,
            Vec<f64>,
            [f64; 2],
            Vec<u8>,
            Vec<u8>,
        ) = unpack(memory)?;
        (self.state, self.start) = (state, start);
        self.tune(tuned_dt);
        self.last_dt = last_dt;
        self.x.clone_from(&self.start);
        self.x_tilde.clone_from(&self.start);
        self.next.clone_from(&self.start);
        self.end.displacement.clone_from(&self.state.displacement);
        self.end.velocity = self.state.velocity;
        if let Some(load) = &self.state.load {
            self.end.load.clone_from(load);
        }
        self.sequence.recall(&sequence)?;
        self.accelerator.recall(&accelerator)
    }
}
