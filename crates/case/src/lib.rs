//! Scenes: TOML cases as typed, validated values.

mod layout;
mod scene;

pub use layout::*;
pub use scene::*;
