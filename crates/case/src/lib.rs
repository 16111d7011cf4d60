//! Scenes: TOML cases as typed, validated values.
//!
//! A scene is read in two stages. What the user wrote ([`load`]) is checked
//! against the schema for its keys and types, then for physical sense; only
//! then do programs see it, as a [`Scene`] they may rely on. [`Scene::resolved`]
//! fills in what it leaves out.

mod boundaries;
mod check;
mod error;
mod layout;
mod overrides;
mod place;
mod resolved;
mod scene;
mod schema;
mod times;
mod wind;

pub use boundaries::{Jump, jumps};
pub use error::{Problem, SceneError};
pub use layout::*;
pub use overrides::{NotATable, Override, parse_overridden, set_value};
pub use place::place_of;
pub use resolved::{CanopyAir, Resolved, UndisturbedAir};
pub use scene::*;
pub use schema::schema;
pub use times::{StageTimes, save_time};
pub use wind::Wind;
