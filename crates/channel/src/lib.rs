//! The contract between the programs, over zero-copy shared memory.
//!
//! A solver implements [`Participant`]; `serve` carries it through a run. The
//! coupler drives all participants through a `Hub`. Only the `transport`
//! module names iceoryx2.

mod message;
mod participant;

pub use message::*;
pub use participant::*;
