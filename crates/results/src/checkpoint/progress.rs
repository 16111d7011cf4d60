//! The coupler's own part of a saved state: how far the stage has come, and all that its later
//! windows and its summary depend on.

use std::path::Path;

use coupling::energy::InterfaceEnergyBalance;
use coupling::error::RunError;
use coupling::flow_bounds::FlowBounds;
use serde::{Deserialize, Serialize};

use super::unusable;
use crate::summary::StageSummary;

const FILE: &str = "progress.bin";
const KIND: [u8; 8] = *b"ripprogr";
const VERSION: u32 = 2;

/// How far a stage has come.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Progress {
    /// Windows that are done.
    pub windows: u64,
    /// Time since the start of the stage, s.
    pub time_s: f64,
    /// Memory of the stage's stepper: scheme, acceleration, interface.
    pub stepper: Vec<u8>,
    /// Where the stage stands in time, and the length of its next window, packed.
    pub clock: Vec<u8>,
    /// Interface energy balance.
    pub interface_energy: InterfaceEnergyBalance,
    /// What bounds the flow; `None` for a scene without one.
    pub flow_bounds: Option<FlowBounds>,
    /// The summary so far.
    pub summary: StageSummary,
    /// Warnings so far.
    pub warnings: Vec<String>,
    /// What its means are taken of.
    pub speeds: Vec<(f64, f64)>,
}

impl Progress {
    /// Writes it below `folder`.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn save(&self, folder: &Path) -> Result<(), RunError> {
        archive::save(&folder.join(FILE), KIND, VERSION, self).map(|_| ()).map_err(unusable)
    }

    /// Reads what [`Progress::save`] wrote.
    ///
    /// # Errors
    /// A file that is missing, damaged or of another version.
    pub fn load(folder: &Path) -> Result<Self, RunError> {
        archive::load(&folder.join(FILE), KIND, VERSION).map_err(unusable)
    }
}
