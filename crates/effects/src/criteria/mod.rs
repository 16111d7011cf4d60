//! What each effect changes in a scene: one function for each, with its formula and source.
//!
//! All give the change at a fixed speed of the air (of the canopy's drag area, or of the force in the
//! lines); [`super::fall`] turns it into the change of descent speed, drag and line tension of the scene.
//! Each names the factor within which it promises to be right.

mod air;
mod descent;
mod structure;

pub use air::{
    energy, gust, limiter, permeability, permeable_groups, perturbation, shear, steady, turbulence, viscosity,
};
use case::Scene;
pub use descent::{body, descent, frame_motion, line_drag, payload_drag, typical_drag_area};
pub use structure::{
    bending, cable_groups, contact, contact_friction, fabric_gravity, fabric_groups, fabric_hysteresis,
    hysteresis, immersed, integration, law, lines, mass_damping, moving_grid, orthotropic, prescribed,
    prestress, reefing, reinforcements, retardation, risers, stiffness_damping, tapes, wrinkling,
};

use super::estimate::Certainty;

/// Whether any stage has a value above zero.
pub fn any_stage(scene: &Scene, value: impl Fn(&case::Stage) -> f64) -> bool {
    scene.stages.iter().any(|s| value(s) > 0.0)
}

/// Right within `factor`, with its direction.
fn signed(factor: f64) -> Certainty {
    Certainty { factor, signed: true }
}

/// Right within `factor`; its direction is not known.
fn unsigned(factor: f64) -> Certainty {
    Certainty { factor, signed: false }
}
