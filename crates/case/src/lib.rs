//! Scenes: TOML cases as typed, validated values.
//!
//! A scene is read in two stages. What the user wrote ([`load`]) is checked
//! against the schema for its keys and types, then for physical sense; only
//! then do programs see it, as a [`Scene`] they may rely on.

mod accuracy;
mod adaptive;
mod coupling;
mod effects;
mod error;
mod flow_effects;
mod grid_file;
mod integration;
mod layout;
mod load;
mod mesh_motion;
mod monitors;
mod panel_box;
mod scene;
mod schema;
mod validate;
mod validate_effects;
mod validate_flow;

pub use accuracy::{Accuracy, Dial, Measured, Quantity, Take};
pub use adaptive::AdaptiveWindow;
pub use coupling::*;
pub use effects::{Contact, LineDrag, PayloadBody, PayloadDrag, Reefing};
pub use error::{Problem, SceneError};
pub use flow_effects::*;
pub use grid_file::{Condition, GridFile};
pub use integration::Integration;
pub use layout::*;
pub use load::{load, parse};
pub use mesh_motion::*;
pub use monitors::{Forces, Probe, Slice, Statistics, SurfacePressure};
pub use panel_box::{BoxSides, FlowBox, PanelCanopy, PanelEdges};
pub use scene::*;
pub use schema::schema;
