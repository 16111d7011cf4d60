//! The contract between the programs, over zero-copy shared memory.
//!
//! A solver implements [`Participant`]; [`serve`] carries one rank of it through
//! a run. The coupler drives all participants through a [`Hub`]. Only the
//! `transport` module names iceoryx2. The whole contract, byte by byte:
//! `docs/contract.md`.

mod args;
mod error;
mod hub;
mod message;
mod participant;
mod serve;

pub use args::*;
pub use error::*;
pub use hub::*;
pub use message::*;
pub use participant::*;
pub use serve::*;
