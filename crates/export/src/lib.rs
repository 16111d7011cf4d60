//! `ripstop export`: results of a run as files for other programs: VTKHDF, animations, the canopy for Gmsh.

// An error ends the command once, so its size does not matter.
#![allow(clippy::result_large_err)]

pub mod gmsh;
pub mod vtkhdf;

use clap::{Args, Subcommand};
use coupling::error::RunError;
use figures::picture::AnimationArgs;
use terminal::Console;

/// Arguments of `ripstop export`.
#[derive(Args)]
pub struct ExportArgs {
    #[command(subcommand)]
    format: Format,
}

#[derive(Subcommand)]
enum Format {
    /// Write the snapshots of a stage as one VTKHDF file with all times, for ParaView, VTK and h5py
    Vtkhdf(vtkhdf::VtkhdfArgs),
    /// Draw the canopy over time, as an animated GIF or a sequence of PNG files
    Animation(AnimationArgs),
    /// Write the canopy at the end of a stage as a surface for Gmsh, with a script for the air around it
    Gmsh(gmsh::GmshArgs),
}

/// Exports results of a run.
///
/// # Errors
/// [`RunError::Input`]: the run has no such snapshots, or they cannot be read; files that cannot be written.
pub fn export(args: &ExportArgs, console: &Console) -> Result<(), RunError> {
    match &args.format {
        Format::Vtkhdf(args) => vtkhdf::export(args, console),
        Format::Animation(args) => figures::picture::export_animation(args, console),
        Format::Gmsh(args) => gmsh::export(args, console),
    }
}
