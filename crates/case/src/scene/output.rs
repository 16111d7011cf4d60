//! `[output]`: snapshots, checkpoints and the folder of results.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Snapshots and checkpoints.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Output {
    /// Windows between ParaView snapshots of the canopy. 0: none.
    pub surface_every_windows: u32,
    /// Windows between ParaView snapshots of the flow. 0: none.
    pub volume_every_windows: u32,
    /// Windows between saved states within a stage, from which `ripstop run --resume` continues. 0: none
    /// but at the end of a stage and at Ctrl-C. Default: as often as costs 1 % of the time, at
    /// most twice a minute.
    pub checkpoint_every_windows: Option<u32>,
    /// Result folder. Default: `runs/<name>`.
    pub folder: Option<PathBuf>,
}

impl Default for Output {
    fn default() -> Self {
        Self {
            surface_every_windows: 4,
            volume_every_windows: 20,
            checkpoint_every_windows: None,
            folder: None,
        }
    }
}
