//! Scenes: TOML cases as typed, validated values.
//!
//! A scene is read in two stages. What the user wrote ([`load`]) is checked
//! against the schema for its keys and types, then for physical sense; only
//! then do programs see it, as a [`Scene`] they may rely on.

mod accuracy;
mod adaptive;
mod boundaries;
mod coupling;
mod descent;
mod effects;
mod error;
mod flow_effects;
mod grid_file;
mod integration;
mod layout;
mod load;
mod mesh_motion;
mod monitors;
mod motion;
mod overrides;
mod panel_box;
mod scene;
mod schema;
mod times;
mod validate;
mod validate_effects;
mod validate_flow;
mod validate_wind;
mod wind;
mod wind_profile;

pub use accuracy::{Accuracy, Measured, Parameter, Quantity, Take};
pub use adaptive::AdaptiveWindow;
pub use boundaries::{Jump, jumps};
pub use coupling::*;
pub use descent::DescentEquation;
pub use effects::{Contact, LineDrag, PayloadBody, PayloadDrag, Reefing};
pub use error::{Problem, SceneError};
pub use flow_effects::*;
pub use grid_file::{Condition, GridFile};
pub use integration::Integration;
pub use layout::*;
pub use load::{load, parse, place_of};
pub use mesh_motion::*;
pub use monitors::{Forces, Probe, Slice, Statistics, SurfacePressure};
pub use motion::interpolate;
pub use overrides::{NotATable, Override, parse_overridden, set_value};
pub use panel_box::{BoxSides, FlowBox, PanelCanopy, PanelEdges};
pub use scene::*;
pub use schema::schema;
pub use times::{StageTimes, save_time};
pub use wind::{Clock, Gust, StageWind, Wind};
pub use wind_profile::WindProfile;
