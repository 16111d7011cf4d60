//! Effects that a program announces to save and resume, and the warm-start files of its ranks.

use std::path::{Path, PathBuf};

use case::Role;
use serde::de::DeserializeOwned;

/// Effect of a program that supports restart within a stage: it accepts `--resume FOLDER` and continues from the
/// files that it wrote there on `Save`.
pub const RESUME: &str = "resume";

/// Effect of a structure that reports the vertical parts of `SUPPORT_FORCE` and `MOMENTUM`.
pub const SUPPORT_FORCE: &str = "descent.equation";

/// Effect of a structure that reports `SUPPORT_FORCE` and `MOMENTUM` in all three axes: a frame may move sideways.
pub const FRAME_MOTION: &str = "descent.motion";

/// Effect of a program that uses the wind of a stage as `case::Scene::wind` defines it: winds and gusts of single
/// stages, and gusts whose time runs through several stages.
pub const STAGE_WIND: &str = "stage.wind";

/// Effect of a program that evaluates all shapes of a gust as `case::Gust` defines them: ramps, sines, tables and trains
/// of pulses.
pub const GUST_SHAPE: &str = "flow.gust.shape";

/// Effect of a program that evaluates the turbulence of a gust as `case::Gust` defines it.
pub const GUST_TURBULENCE: &str = "flow.gust.dryden";

/// Effect of a program whose wind contains the pulse of `case::Scene::perturbation`.
pub const PERTURBATION: &str = "stage.perturbation";

/// Effect of a program whose air is that of `case::Stage::altitude_m` in stages that have one.
pub const STAGE_ALTITUDE: &str = "stage.altitude";

/// Effect of a structure whose lines and free payload meet the wind of their height, as `case::Scene::air_motion` defines it. The height
/// of the frame follows from its velocity.
pub const WIND_BY_HEIGHT: &str = "flow.shear";

/// Effect of a program whose wind by height contains the turbulence of `case::Shear`.
pub const LAYERED_TURBULENCE: &str = "flow.shear.turbulence";

/// Effect of a structure that releases the payload at the attitude of `case::PayloadBody::initial_rotation_deg`.
pub const PAYLOAD_ATTITUDE: &str = "descent.body.attitude";

/// Effect of a structure that writes `reactions.csv`, as `case::Reaction` defines it.
pub const REACTIONS: &str = "output.reaction";

/// Effect of a flow whose inlets, outlets and walls have data of their own, as `case::InletValues`, `case::OutletValues` and
/// `case::MovingWall` define them.
pub const BOUNDARY_VALUES: &str = "flow.boundary-values";

/// Effect of a flow that joins the patches of a periodic pair, and of a mesh-mover that keeps their nodes at rest, as
/// `case::Condition::Periodic` defines it.
pub const PERIODIC: &str = "flow.periodic";

/// Effect of a flow with a force on the air, `case::Flow::body_force_n_m3`.
pub const BODY_FORCE: &str = "flow.body-force";

/// Effect of a mesh-mover that moves rigid bodies as `case::BodyMotion` defines it.
pub const BODY_MOTION: &str = "stage.body-motion";

/// Effect of a flow that reads the displacement of the canopy, `[nodes][3]`, as its input, and needs no moved grid. Its load is the mean over the
/// window.
pub const CANOPY_MOTION: &str = "canopy.motion";

/// Effect of a structure whose unstressed shapes are those of `mesh::StructureMesh::flat`, not the positions from which the canopy starts.
pub const FLAT_SHAPES: &str = "canopy.pattern";

/// File with the warm-start data of a rank, in addition to its part of the program's state: warm starts, factors and
/// all other data that affect only the last digits and are useless for another number of ranks.
pub fn warm_start_file(folder: &Path, role: Role, rank: usize, ranks: usize) -> PathBuf {
    folder.join(format!("{}-memory-{rank}-of-{ranks}.bin", role.name()))
}

/// Loads the [`warm_start_file`] of a rank, an archive of `kind`, and validates it by `check`; `None` where there is no
/// such file: the state was written by another number of ranks.
///
/// # Errors
/// [`archive::Error`]: a damaged file, another version, contents that do not match.
pub fn load_warm_start<T: DeserializeOwned>(
    path: &Path,
    kind: [u8; 8],
    version: u32,
    check: impl FnOnce(&T) -> Result<(), String>,
) -> Result<Option<T>, archive::Error> {
    let memory = archive::if_present(archive::load(path, kind, version))?;
    memory.as_ref().map_or(Ok(()), check).map_err(|reason| archive::Error::content(path, reason))?;
    Ok(memory)
}

/// From now on a file that grows beyond the limit of this process (`RLIMIT_FSIZE`) is an error that can be reported,
/// instead of a signal that ends the process.
pub fn ignore_sigxfsz() {
    // SAFETY: sets a disposition of this process; no memory is involved.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}
