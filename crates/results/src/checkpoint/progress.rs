//! Part of the coupler in a saved state: progress of the stage and all data for its later windows and its summary.

use std::path::Path;

use coupling::energy::InterfaceEnergyBalance;
use coupling::error::RunError;
use coupling::flow_bounds::FlowBounds;
use serde::{Deserialize, Serialize};

use super::unusable;
use crate::summary::StageSummary;
use crate::wake::Sample;

const FILE: &str = "progress.bin";
const KIND: [u8; 8] = *b"ripprogr";
const VERSION: u32 = 9;

/// Progress of a stage.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Progress {
    /// Completed windows.
    pub windows: u64,
    /// Time since the start of the stage, s.
    pub time_s: f64,
    /// State of the coupling scheme, its acceleration and the interface, encoded.
    pub stepper: Vec<u8>,
    /// Time, next window length and its limit, encoded.
    pub clock: Vec<u8>,
    /// Interface energy balance.
    pub interface_energy: InterfaceEnergyBalance,
    /// Bounds of the flow; `None` without flow.
    pub flow_bounds: Option<FlowBounds>,
    /// The summary so far.
    pub summary: StageSummary,
    /// Warnings so far.
    pub warnings: Vec<String>,
    /// Descent speed (m/s) and drag (N) of each window, for means.
    pub speeds: Vec<(f64, f64)>,
    /// Wake at the end of each window, for its statistics.
    pub wake: Vec<Sample>,
}

impl Progress {
    /// Writes the progress to `folder`.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn save(&self, folder: &Path) -> Result<(), RunError> {
        archive::save(&folder.join(FILE), KIND, VERSION, self).map(|_| ()).map_err(unusable)
    }

    /// Reads the progress written by [`Progress::save`].
    ///
    /// # Errors
    /// The file is missing, damaged or of another version.
    pub fn load(folder: &Path) -> Result<Self, RunError> {
        archive::load(&folder.join(FILE), KIND, VERSION).map_err(unusable)
    }
}
