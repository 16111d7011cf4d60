//! The contract between the programs, over zero-copy shared memory.
//!
//! A solver implements [`Participant`]; [`serve`] carries one rank of it through
//! a run. The coupler drives all participants through a [`Hub`]. Only the
//! `transport` module names iceoryx2. The whole contract, byte by byte:
//! `docs/contract.md`.

// The fakes of `tests/common` name this crate from outside.
#[cfg(test)]
extern crate self as channel;
#[cfg(test)]
mod input_tests;

mod args;
mod convergence;
mod culprit;
mod error;
mod handshake;
mod header;
mod hub;
mod hub_options;
mod kept;
mod message;
mod participant;
mod post;
mod program;
mod relay;
mod serve;
mod session;
mod transport;
mod windows;
mod wire;

#[cfg(test)]
mod contract_doc;

pub use args::*;
pub use convergence::*;
pub use error::*;
pub use header::{Header, Kind, MAGIC, Unit, role_code};
pub use hub::*;
pub use hub_options::*;
pub use kept::*;
pub use message::*;
pub use participant::*;
pub use relay::Peers;
pub use serve::*;
pub use session::{cleanup, cleanup_stale, session_files};
