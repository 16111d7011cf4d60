//! `[stage.steady]`: the march to a steady state.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::Check;
use crate::{Flow, Scene, Stage, StageKind, Turbulence};

/// A flow-only stage that marches to a steady state instead of through time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Steady {
    /// The state is steady once the residual of the steady equations has fallen by this
    /// factor.
    pub residual_drop: f64,
    /// Or once the force of `flow.forces.watch`, by default that on the canopy, has changed by less than this share
    /// of itself over the last ten steps.
    pub force_change: f64,
    /// Steps at most; a flow that is not steady by then ends the run.
    pub max_steps: u32,
    /// Courant number of a cell of mean size in the last, longest steps.
    pub max_courant: f64,
}

impl Default for Steady {
    fn default() -> Self {
        Self { residual_drop: 1e-4, force_change: 1e-5, max_steps: 500, max_courant: 1e3 }
    }
}

/// Refuses marches that never end, and flows that are never steady.
pub(super) fn check(scene: &Scene, stage: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let (Some(s), Some(flow)) = (&stage.steady, &scene.flow) else { return };
    let path = at("steady");
    if stage.kind != StageKind::FlowOnly {
        c.refuse(
            &path,
            format!("stage \"{}\" moves in time", stage.name),
            "only a stage of kind \"flow-only\" can be steady",
        );
    }
    ends(s, &path, c);
    never_steady(flow, scene, &path, c);
}

fn ends(s: &Steady, at: &str, c: &mut Check) {
    let (drop, change) = ("a factor; 0 never stops", "a share of the force; 0 never stops");
    c.range(&format!("{at}.residual_drop"), s.residual_drop, 0.0..=0.5, drop);
    c.range(&format!("{at}.force_change"), s.force_change, 0.0..=0.5, change);
    if s.residual_drop == 0.0 && s.force_change == 0.0 {
        c.refuse(at, "neither the residual nor the force ends the march", "set one of them above 0");
    }
    c.count(&format!("{at}.max_steps"), s.max_steps, 1..=1_000_000, "steps");
    c.range(&format!("{at}.max_courant"), s.max_courant, 1.0..=1e9, "a Courant number");
}

fn never_steady(flow: &Flow, scene: &Scene, at: &str, c: &mut Check) {
    let falls = scene.resolved().initial_speed_m_s != 0.0;
    if flow.shear.is_some() && falls {
        c.refuse(
            at,
            "a frame that falls through sheared wind meets another wind at every height",
            "remove [flow.shear], or give the stage a duration instead",
        );
    }
    if let Some(t) = scene.viscosity().and_then(|v| v.turbulence)
        && t != Turbulence::SpalartAllmaras
    {
        c.refuse(
            at,
            "resolved eddies are never steady",
            "use turbulence = \"spalart-allmaras\", or give the stage a duration instead",
        );
    }
}
