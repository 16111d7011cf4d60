//! Scenes: TOML cases as typed, validated values.
//!
//! A scene is read in two stages. What the user wrote ([`load`]) is checked
//! against the schema for its keys and types, then for physical sense; only
//! then do programs see it, as a [`Scene`] they may rely on. [`Scene::resolved`]
//! fills in the defaults.

mod air_motion;
mod atmosphere;
mod boundaries;
mod check;
mod error;
mod formula;
pub mod materials;
mod overrides;
pub mod pattern;
mod place;
mod renamed;
mod scene;
mod wind;

pub use air_motion::{AirByHeight, AirMotion};
pub use atmosphere::{ALTITUDES, StandardAir};
pub use boundaries::{Jump, jumps};
pub use check::Allowed;
pub use error::{Problem, SceneError};
pub use formula::{Formula, FormulaError};
pub use materials::{FabricMaterial, LineMaterial, RiserMaterial, TapeMaterial};
pub use overrides::{NotATable, Override, parse_overridden, set_value};
pub use place::{place_of, with_absolute_paths};
pub use renamed::{Renamed, current_path, current_value, renamed, replacement};
pub use scene::*;
pub use wind::Wind;
