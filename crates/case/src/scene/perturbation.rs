//! `[stage.perturbation]`: a short pulse of transverse wind that takes a wake out of its symmetric state.

use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::random::SplitMix;
use super::{BoxSides, Condition};
use crate::check::Check;
use crate::{Canopy, Gust, Role, Scene, Stage};

/// A pulse `(1 - cos(2 pi t / duration))/2` of wind across the stream, in the stage that has it. The wake of a bluff body in a
/// symmetric scene stays symmetric, with a drag that is too low, until a disturbance has grown: from round-off over 30 to 60
/// diameters of the stream. The pulse is such a disturbance of known size.
///
/// The stream is the steady wind of the stage relative to a canopy that falls with `descent.initial_speed_m_s`: speed U. D is
/// the diameter of a circle of `descent.reference_area_m2`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Perturbation {
    /// Largest speed of the pulse as a share of U. At the default of 0.1 the stream is inclined by 5.7 degrees and its dynamic
    /// pressure 1 % higher, during the pulse only. A disturbance that grows exponentially needs a tenth of the time that it
    /// needs from round-off.
    #[serde(default = "tenth")]
    pub speed_share: f64,
    /// When it begins, s from the start of the stage.
    #[serde(default)]
    pub start_s: f64,
    /// How long it lasts, s. Absent: D/U, in which the stream passes the canopy once.
    pub duration_s: Option<f64>,
    /// Chooses the direction: each seed another wake, the same in each run. The azimuth is 45 degrees times (k + 1/4 + f/2),
    /// with k from the highest 3 bits and f (0 to 1) from the 53 bits below of SplitMix64 of the seed, so that it is at
    /// least 11.25 degrees from each mirror plane of a square or cross. Absent: 1.
    pub seed: Option<u32>,
    /// Direction instead of a seed, degrees: in the plane across the stream, from the x axis (its part in that plane; the y
    /// axis for a stream along x), right-handed about the stream.
    pub azimuth_deg: Option<f64>,
}

fn tenth() -> f64 {
    0.1
}

impl Default for Perturbation {
    fn default() -> Self {
        Self { speed_share: tenth(), start_s: 0.0, duration_s: None, seed: None, azimuth_deg: None }
    }
}

/// Seed where a scene has none.
const SEED: u32 = 1;
/// Angle between mirror planes of a square or a cross, degrees.
const SECTOR_DEG: f64 = 45.0;
/// Fewest windows in a pulse: with fewer the values at their ends miss its shape, with one they are all zero.
const WINDOWS: f64 = 4.0;
/// Cosine of direction and normal of a wall below which the pulse is along the wall.
const ALONG: f64 = 1e-6;

impl Perturbation {
    /// Azimuth of the pulse, degrees: the given one, or that of the seed.
    pub fn azimuth_deg(&self) -> f64 {
        self.azimuth_deg.unwrap_or_else(|| {
            let hash = SplitMix::new(self.seed.unwrap_or(SEED)).bits();
            let sector = (hash >> 61) as f64;
            let share = ((hash << 3) >> 11) as f64 / (1u64 << 53) as f64;
            SECTOR_DEG * (sector + 0.25 + 0.5 * share)
        })
    }

    /// Direction of the pulse, a unit vector across `stream` (m/s, not zero).
    fn direction(&self, stream: [f64; 3]) -> [f64; 3] {
        let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        let unit = |v: [f64; 3]| v.map(|x| x / dot(v, v).sqrt());
        let s = unit(stream);
        // Nearly along the stream, the x axis has no direction across it.
        let axis = if s[0].abs() < 0.999 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
        let first: [f64; 3] = unit(std::array::from_fn(|i| axis[i] - dot(axis, s) * s[i]));
        let second: [f64; 3] = std::array::from_fn(|i| {
            s[(i + 1) % 3] * first[(i + 2) % 3] - s[(i + 2) % 3] * first[(i + 1) % 3]
        });
        let (sin, cos) = (self.azimuth_deg() * PI / 180.0).sin_cos();
        std::array::from_fn(|i| cos * first[i] + sin * second[i])
    }
}

impl Scene {
    /// Steady stream of a stage relative to a canopy that moves with the initial velocity, m/s.
    pub(super) fn steady_stream(&self, stage: &Stage) -> [f64; 3] {
        let resolved = self.resolved();
        let wind = stage.wind.as_ref().map_or(resolved.wind_m_s, |w| w.velocity_m_s);
        std::array::from_fn(|i| wind[i] - resolved.initial_velocity_m_s[i])
    }

    /// The pulse of wind of `[stage.perturbation]`, whose times count from the start of `stage`. `None` without one, and where
    /// there is no stream or no diameter to take its size from.
    pub fn perturbation(&self, stage: usize) -> Option<Gust> {
        let stage = self.stages.get(stage)?;
        let p = stage.perturbation.as_ref()?;
        let stream = self.steady_stream(stage);
        let speed = stream.iter().map(|v| v * v).sum::<f64>().sqrt();
        if speed == 0.0 {
            return None;
        }
        let passage = || self.descent.as_ref().map(|d| 2.0 * (d.reference_area_m2 / PI).sqrt() / speed);
        let duration = p.duration_s.or_else(passage)?;
        let velocity = p.direction(stream).map(|d| p.speed_share * speed * d);
        Some(Gust::pulse(velocity, p.start_s, duration))
    }

    /// Whether any stage has a perturbation.
    pub fn has_perturbation(&self) -> bool {
        self.stages.iter().any(|s| s.perturbation.is_some())
    }
}

/// Refuses a perturbation that its stage cannot have.
pub(super) fn check(scene: &Scene, k: usize, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let stage = &scene.stages[k];
    let Some(p) = &stage.perturbation else { return };
    let key = |name: &str| at(&format!("perturbation.{name}"));
    let share = "share of the speed of the stream; a larger one is a gust: [stage.gust]";
    c.positive(&key("speed_share"), p.speed_share, 0.5, share);
    c.range(&key("start_s"), p.start_s, 0.0..=1e6, "in s from the start of the stage");
    if let Some(duration) = p.duration_s {
        c.positive(&key("duration_s"), duration, 1e6, "a time in s");
    }
    if let Some(angle) = p.azimuth_deg {
        c.range(&key("azimuth_deg"), angle, -360.0..=360.0, "an angle in degrees");
        if p.seed.is_some() {
            c.refuse(
                &key("seed"),
                "the perturbation has a direction, `azimuth_deg`, and a seed that chooses one",
                "keep `seed` or `azimuth_deg`",
            );
        }
    }
    if !stage.kind.roles().contains(&Role::Flow) || !stage.in_time() {
        c.refuse(
            &at("perturbation"),
            format!("stage \"{}\" has no flow in time that could be perturbed", stage.name),
            "move [stage.perturbation] to a stage of kind \"flow-only\" or \"coupled\" with a duration",
        );
        return;
    }
    match scene.perturbation(k) {
        Some(pulse) => {
            times(&pulse, stage, at, c);
            symmetry(scene, &pulse, at, c);
        }
        None => size(scene, stage, at, c),
    }
}

/// What the size of the perturbation is taken from is missing.
fn size(scene: &Scene, stage: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    if scene.steady_stream(stage) == [0.0; 3] {
        c.refuse(
            &at("perturbation"),
            format!("the stream of stage \"{}\" has no velocity that a share could be taken of", stage.name),
            "set descent.initial_speed_m_s, flow.wind_m_s or [stage.wind]; in still air use [stage.gust]",
        );
    } else {
        c.refuse(
            &at("perturbation.duration_s"),
            "a scene without [descent] has no reference area, from whose diameter `duration_s` follows",
            "set duration_s to the diameter of the body over the speed of the stream, s",
        );
    }
}

/// The pulse ends within its stage and is resolved by its windows.
fn times(pulse: &Gust, stage: &Stage, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let [start, end] = pulse.acts();
    let duration = pulse.duration_s.unwrap_or(0.0);
    let path = at("perturbation.duration_s");
    if end > stage.planned_s() * (1.0 + 1e-9) {
        c.refuse(
            &path,
            format!(
                "the perturbation lasts {duration:.4} s from {start} s on, but stage \"{}\" ends after {} s",
                stage.name, stage.duration_s
            ),
            "shorten duration_s, or lengthen the stage: a wake needs more than ten diameters of the stream to develop after \
             it",
        );
    }
    if duration < WINDOWS * stage.window_s * (1.0 - 1e-9) {
        c.refuse(
            &path,
            format!(
                "the perturbation lasts {duration:.4} s, which are fewer than four windows of {} s",
                stage.window_s
            ),
            "lengthen duration_s, or shorten window_s of the stage",
        );
    }
}

/// A pulse across a plane of symmetry, or across the wall of a box, moves no air.
fn symmetry(scene: &Scene, pulse: &Gust, at: &dyn Fn(&str) -> String, c: &mut Check) {
    let path = at("perturbation");
    if matches!(scene.canopy, Canopy::AirBag(_)) {
        c.refuse(
            &path,
            "the canopy is an octant by symmetry: its wake has no other side to move to",
            "remove [stage.perturbation]",
        );
    }
    let Some(flow) = &scene.flow else { return };
    if !flow.inlets.is_empty() {
        c.refuse(
            &path,
            "the perturbation accelerates all of the air, but the inlet `flow.inlet[0]` has a velocity of its own",
            "remove [stage.perturbation] and give the inlet a `factor` of time, or remove [[flow.inlet]]",
        );
    }
    let speed = pulse.largest_speed();
    let crosses = |name: &str| {
        let side = BoxSides::NAMES.iter().position(|n| *n == name).filter(|_| flow.box_grid.is_some());
        side.is_some_and(|k| pulse.velocity_m_s[k / 2].abs() > ALONG * speed)
    };
    let barrier = |(name, condition): &(&str, Condition)| match condition {
        Condition::Symmetry => true,
        Condition::Slip | Condition::Wall => crosses(name),
        _ => false,
    };
    if let Some((name, condition)) = flow.patches().into_iter().find(barrier) {
        c.refuse(
            &path,
            format!("the wind of the perturbation crosses the patch \"{name}\" (\"{}\")", condition.name()),
            "remove [stage.perturbation]; or model both halves, with \"far-field\" at the sides",
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_of_seeds_differ_and_avoid_mirror_planes() {
        let azimuth = |seed| Perturbation { seed: Some(seed), ..Perturbation::default() }.azimuth_deg();
        let mut sectors = [0u32; 8];
        for seed in 0..4096 {
            let angle = azimuth(seed);
            let within = angle % SECTOR_DEG;
            assert!((0.0..360.0).contains(&angle) && (11.25..=33.75).contains(&within), "{seed}: {angle}");
            sectors[(angle / SECTOR_DEG) as usize] += 1;
        }
        assert!(sectors.iter().all(|n| (440..590).contains(n)), "{sectors:?}");
        assert_eq!(Perturbation::default().azimuth_deg(), azimuth(SEED));
        assert!((azimuth(1) - azimuth(2)).abs() > 1.0);
    }

    #[test]
    fn direction_is_a_unit_vector_across_any_stream() {
        for stream in [[0.0, 0.0, 4.8], [3.0, -1.0, 4.0], [7.0, 0.0, 0.0], [0.0, -2.0, 1e-3]] {
            for azimuth in [0.0, 30.0, 250.0] {
                let p = Perturbation { azimuth_deg: Some(azimuth), ..Perturbation::default() };
                let d = p.direction(stream);
                let dot: f64 = (0..3).map(|i| d[i] * stream[i]).sum();
                let length: f64 = d.iter().map(|x| x * x).sum();
                assert!(dot.abs() < 1e-14 * 8.0 && (length - 1.0).abs() < 1e-14, "{stream:?}: {d:?}");
            }
        }
        // About a stream upwards: from x towards y.
        let p = Perturbation { azimuth_deg: Some(90.0), ..Perturbation::default() };
        assert!((p.direction([0.0, 0.0, 2.0])[1] - 1.0).abs() < 1e-15);
    }
}
