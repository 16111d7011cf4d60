//! `[[reefing]]`: lines through the skirt that hold the canopy closed.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::check::Check;
use crate::{Role, Scene, Solve, Stage, StageKind};

/// A reefing line: a closed line through the skirt, where the suspension lines are attached,
/// of the material of `[lines]`; it pulls only. It has no inertia.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reefing {
    /// Its whole length, m.
    pub length_m: f64,
    /// Time over which it is drawn in from the length of the unstressed skirt, s from the
    /// start of the first stage.
    #[serde(default)]
    pub draw_in_s: f64,
    /// Stage in which it is cut. Absent: it holds to the end.
    pub release_stage: Option<String>,
    /// When it is cut, s from the start of that stage.
    #[serde(default)]
    pub release_s: f64,
    /// Time over which its force fades when it is cut, s.
    #[serde(default)]
    pub release_ramp_s: f64,
}

/// Share of the dynamic pressure below which a pre-inflation does not inflate: a canopy carries about 0.7 to 1.8 times the dynamic pressure.
const GATHERED_PRESSURE: f64 = 0.05;

impl Scene {
    /// Whether the canopy opens from a gathered skirt: a reefing line is cut in the first coupled stage, and the stages before it inflate the canopy by less than
    /// 5 % of the dynamic pressure of the stream there, of the descent or of a wind on a held payload. A canopy that was inflated reefed does not.
    pub fn opens_gathered(&self) -> bool {
        let first = self.stages.iter().position(|s| s.kind == StageKind::Coupled);
        let stream = first.map_or([0.0; 3], |k| self.steady_stream(&self.stages[k]));
        let squared: f64 = stream.iter().map(|v| v * v).sum();
        let dynamic = self.flow.as_ref().map_or(0.0, |f| 0.5 * f.density_kg_m3 * squared);
        let gathers = |s: &Stage| s.pressure_pa.is_some_and(|p| p.abs() < GATHERED_PRESSURE * dynamic);
        let inflations = |k: usize| self.stages[..k].iter().filter(|s| s.kind == StageKind::PreInflation);
        let gathered = |k: usize| inflations(k).count() > 0 && inflations(k).all(gathers);
        first.filter(|k| gathered(*k)).is_some_and(|k| {
            self.reefing.iter().any(|r| r.release_stage.as_ref() == Some(&self.stages[k].name))
        })
    }
}

/// Refuses lines that run nowhere or are cut at no time.
pub(crate) fn check(scene: &Scene, c: &mut Check) {
    for (k, r) in scene.reefing.iter().enumerate() {
        let at = format!("reefing[{k}]");
        magnitudes(r, &at, c);
        if scene.lines.is_none() {
            c.refuse(&at, "the reefing line has no material", "add [lines]: it is made of them");
        }
        if !scene.may_have_cables() {
            c.refuse(&at, "a reefing line runs where lines are attached, and there are none", "remove it");
        }
        release(r, &at, scene, c);
    }
}

fn magnitudes(r: &Reefing, at: &str, c: &mut Check) {
    c.positive(&format!("{at}.length_m"), r.length_m, 1e4, "a length in metres");
    c.range(&format!("{at}.draw_in_s"), r.draw_in_s, 0.0..=1e6, "in seconds");
    c.range(&format!("{at}.release_s"), r.release_s, 0.0..=1e6, "in seconds from the start of the stage");
    c.range(&format!("{at}.release_ramp_s"), r.release_ramp_s, 0.0..=1e6, "in seconds");
}

/// The line is cut within a stage that moves the structure in time.
fn release(r: &Reefing, at: &str, scene: &Scene, c: &mut Check) {
    let Some(name) = &r.release_stage else {
        if r.release_s != 0.0 || r.release_ramp_s != 0.0 {
            c.refuse(
                &format!("{at}.release_s"),
                "the time of release belongs to no stage",
                "add `release_stage = \"...\"`",
            );
        }
        return;
    };
    match scene.stages.iter().find(|s| &s.name == name) {
        Some(s) if s.kind.roles().contains(&Role::Structure) && s.solve == Solve::Dynamic => {
            if r.release_s > s.duration_s {
                c.refuse(
                    &format!("{at}.release_s"),
                    format!(
                        "stage \"{name}\" ends at {} s, before the release at {} s",
                        s.duration_s, r.release_s
                    ),
                    "release earlier, or name a later stage",
                );
            }
        }
        Some(_) => c.refuse(
            &format!("{at}.release_stage"),
            format!("stage \"{name}\" does not move the structure in time"),
            "name a stage of kind \"pre-inflation\" or \"coupled\" with a duration",
        ),
        None => c.refuse(
            &format!("{at}.release_stage"),
            format!("the scene has no stage \"{name}\""),
            "name one of its stages",
        ),
    }
}
