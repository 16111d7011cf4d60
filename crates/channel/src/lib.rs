//! The contract between the programs, over zero-copy shared memory.
//!
//! A solver implements [`Participant`]; [`serve`] runs one rank of it. The coupler drives all participants through a
//! [`Hub`]. Only the `transport` module names iceoryx2. The complete contract, byte by byte: `docs/reference/contract.md`.

// The test participants of `tests/common` name this crate from outside.
#[cfg(test)]
extern crate self as channel;
#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod common;
#[cfg(test)]
mod input_tests;
#[cfg(test)]
mod order_tests;
#[cfg(test)]
mod relay_tests;

mod args;
mod bdf2;
mod convergence;
mod deadline;
mod error;
mod handshake;
mod header;
mod hub;
mod hub_options;
mod logged;
mod membership;
mod message;
mod participant;
mod program;
mod proxied_rank;
mod rank_server;
mod relay;
mod remote_rank;
mod reported_place;
mod resume;
mod serve;
mod session;
mod stalled_rank;
mod transport;
mod watchdog;
mod windows;
mod wire;

#[cfg(test)]
mod contract_doc;

pub use args::*;
pub use bdf2::{LONGEST_RATIO, bdf2};
pub use convergence::*;
pub use deadline::Deadline;
pub use error::*;
pub use header::{Header, Kind, MAGIC, Unit, role_code};
pub use hub::*;
pub use hub_options::*;
pub use logged::{LOG_VARIABLE, is_log_line, start_log};
pub use message::*;
pub use participant::*;
pub use relay::Peers;
pub use reported_place::{at_text, reported_place};
pub use resume::*;
pub use serve::*;
pub use session::{cleanup, cleanup_stale, session_files};
pub use wire::first_not_finite;
