//! Starts, supervises and ends the solver programs.
//!
//! Every program is a child of this process: its exit is detected immediately, and it
//! ends with this process in all cases. This module does not depend on the
//! contract.

mod command;
mod process;
mod session;
mod supervisor;
mod usage;

pub use command::{LaunchPlan, Program};
pub(crate) use session::Session;
pub use supervisor::{ProcessFailure, Supervisor};

#[cfg(test)]
mod tests;
