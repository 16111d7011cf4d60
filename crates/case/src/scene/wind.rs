//! Winds of stages, and the clocks that winds and gusts follow.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::Check;
use crate::{Flow, Scene, Stage};

use super::gust::{self, THREE_SPEEDS};

/// What a time in a scene counts from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Clock {
    /// The start of the stage.
    Stage,
    /// The release: the start of the first `coupled` or `prescribed` stage. Stages before it have negative
    /// times. In a scene without such a stage: the start of the first stage with the flow.
    Release,
    /// The start of the first stage.
    Run,
}

/// Steady wind of one stage, instead of `flow.wind_m_s`. It is the same at all heights and so refused together with
/// `[flow.shear]`, whose law the flow keeps through all stages; a gust changes a sheared wind in time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StageWind {
    /// Wind in the frame of the ground, m/s.
    pub velocity_m_s: [f64; 3],
    /// Time over which the wind changes to this one, s from the start of the stage, along half a cosine. It
    /// changes from the steady wind at the end of the last stage with the flow; in the first one from
    /// `flow.wind_m_s`. 0: at once.
    #[serde(default)]
    pub ramp_s: f64,
}

/// Refuses wind and gust of one stage that its flow cannot have.
pub(super) fn of_stage(scene: &Scene, stage: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let Some(flow) = &scene.flow else {
        for (key, given) in [("wind", stage.wind.is_some()), ("gust", stage.gust.is_some())] {
            if given {
                c.refuse(&at(key), "the wind needs air, but the scene has none", "add a [flow] section");
            }
        }
        return;
    };
    if let Some(w) = &stage.wind {
        steady_wind(w, flow, stage, at, c);
    }
    if let Some(g) = &stage.gust {
        gust::check(g, &at("gust"), c);
    }
    let common = flow.gust.as_ref().is_some_and(|g| g.clock == Some(Clock::Stage));
    if !stage.in_time() && (stage.gust.is_some() || (common && stage.steady.is_some())) {
        c.refuse(
            &at(if stage.gust.is_some() { "gust" } else { "steady" }),
            "a gust changes in time",
            "remove the gust, let it count from the release, or give the stage a duration",
        );
    }
}

fn steady_wind(w: &StageWind, flow: &Flow, stage: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    c.range(&at("wind.ramp_s"), w.ramp_s, 0.0..=1e6, "in s");
    c.finite(&at("wind.velocity_m_s"), &w.velocity_m_s, "a velocity", THREE_SPEEDS);
    if flow.shear.is_some() {
        c.refuse(
            &at("wind"),
            "a stage has one wind for all heights, but the wind changes with height",
            "remove [flow.shear]; or remove [stage.wind] and give the stage its wind by height in [flow.shear], a change \
             in time as a gust, which adds the same to the wind at all heights",
        );
    }
    if w.ramp_s > 0.0 && !stage.in_time() {
        c.refuse(
            &at("wind.ramp_s"),
            format!("stage \"{}\" takes no time in which the wind could change", stage.name),
            "remove `ramp_s`, or give the stage a duration instead",
        );
    } else if stage.in_time() && w.ramp_s > stage.duration_s {
        c.refuse(
            &at("wind.ramp_s"),
            format!("the wind changes over {} s, but the stage ends after {} s", w.ramp_s, stage.duration_s),
            "a change of wind ends within its stage",
        );
    }
}
