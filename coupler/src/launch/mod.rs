//! Starting the solver programs, watching over them, and ending them.
//!
//! Every program is a child of this process: its death is seen at once, and it
//! dies with this process however that ends. Nothing here knows what the
//! programs say to each other.

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
