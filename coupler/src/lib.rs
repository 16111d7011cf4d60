//! The coupler: launches the solver programs, runs them stage by stage, and implements the command line.

// An error ends the run: its size does not affect performance.
#![allow(clippy::result_large_err)]

pub mod allocator;
mod arguments;
pub mod check;
pub mod cli;
pub mod command_line;
pub mod conform;
pub mod diff_command;
pub mod effects_command;
pub mod exit_codes;
mod former_options;
pub mod hub;
pub mod launch;
pub mod mesh_command;
mod new_command;
pub mod replay;
pub mod run;
pub mod settings;
pub mod shell_help;
mod signals;
pub mod stages;
pub mod statistics_command;
mod watch_command;
