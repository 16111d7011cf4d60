//! The undisturbed air of each stage: a steady wind, a gust, and the clocks that they follow.
//!
//! [`Scene::wind`] is the only place that evaluates them: flow, structure and coupler all use it.

use std::f64::consts::PI;

use crate::scene::DrydenTurbulence;
use crate::{Clock, Gust, GustShape, Role, Scene, StageTimes};

/// Velocity of the undisturbed air of one stage relative to the ground, over the time of the stage.
///
/// At and before its start it is that of the stage before, so that time differences that reach back see the
/// air that was there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Wind {
    steady: [f64; 3],
    /// Steady wind that the stage starts from, m/s, and the time of the change, s.
    ramp: Option<([f64; 3], f64)>,
    /// A gust.
    gust: Option<Blowing>,
    /// Pulse of `[stage.perturbation]`; its clock is that of the stage.
    perturbation: Option<Gust>,
    /// A stage without time: the wind of its instant.
    held: bool,
    /// Wind of the last stage with the flow, and the time of its end, s since its start.
    before: Option<Box<(Wind, f64)>>,
}

/// A gust, and what it needs to be evaluated.
#[derive(Clone, Debug, PartialEq)]
struct Blowing {
    gust: Gust,
    /// Its cosines, made once.
    turbulence: Option<DrydenTurbulence>,
    /// Its clock at the start of the stage, s.
    origin: f64,
}

impl Blowing {
    fn new(gust: Gust, origin: f64) -> Self {
        Self { turbulence: gust.turbulence(), gust, origin }
    }

    /// What it adds to the wind at `t` (s since the start of the stage), m/s.
    fn at(&self, t: f64) -> [f64; 3] {
        self.gust.with(self.turbulence.as_ref(), self.origin + t)
    }
}

impl Wind {
    /// A steady wind, m/s.
    pub fn uniform(steady: [f64; 3]) -> Self {
        Self { steady, ..Self::default() }
    }

    /// With `gust`, whose clock shows `origin` (s) at the start of the stage.
    pub fn with_gust(self, gust: Gust, origin: f64) -> Self {
        Self { gust: Some(Blowing::new(gust, origin)), ..self }
    }

    /// With `pulse`, whose times count from the start of the stage.
    pub fn with_perturbation(self, pulse: Gust) -> Self {
        Self { perturbation: Some(pulse), ..self }
    }

    /// With `steady` (m/s) in place of the steady wind of this stage and of those before.
    pub fn with_steady(self, steady: [f64; 3]) -> Self {
        let before = self.before.map(|b| Box::new((b.0.with_steady(steady), b.1)));
        Self { steady, before, ..self }
    }

    /// Steady wind once it has changed, m/s.
    pub fn steady(&self) -> [f64; 3] {
        self.steady
    }

    /// Velocity at `t` (s since the start of the stage), m/s.
    pub fn at(&self, t: f64) -> [f64; 3] {
        match &self.before {
            Some(before) if t <= 0.0 && !self.held => before.0.at(before.1 + t),
            _ => self.own(t),
        }
    }

    /// Velocities at the start of the stage, m/s: at the end of the stage before, and just after. `None` in
    /// the first stage with the flow.
    pub fn start(&self) -> Option<([f64; 3], [f64; 3])> {
        self.before.as_ref().map(|before| (before.0.at(before.1), self.own(0.0)))
    }

    /// Velocity just after the start of the stage, m/s.
    pub fn released(&self) -> [f64; 3] {
        self.own(0.0)
    }

    /// Largest speed past a frame that moves with the velocity `frame` (m/s) in the first `duration` seconds of the stage, m/s:
    /// [steady wind alone, with the gust]. Smooth changes are a cosine or sine, so 64 intervals miss $`(\pi/128)^2/2`$ =
    /// 0.03 % of a change at most, and nothing where neither changes; a table has its largest values at its times. Turbulence is evaluated at 8 times in its
    /// shortest period, at most 4096 of a stage.
    pub fn fastest(&self, duration: f64, frame: [f64; 3]) -> [f64; 2] {
        let past = |w: [f64; 3]| (0..3).map(|i| (w[i] - frame[i]).powi(2)).sum::<f64>().sqrt();
        let whole = (0.0, duration);
        let gust = self.gust.as_ref().map_or(Vec::new(), |b| b.gust.samples(b.origin, duration));
        let pulse = self.perturbation.as_ref().map_or(Vec::new(), |p| p.samples(0.0, duration));
        let changes = [Some(whole), self.ramp.map(|(_, time)| (0.0, time))];
        let times = changes
            .into_iter()
            .flatten()
            .flat_map(|(from, to)| (0..=64).map(move |k| from + (to - from) * f64::from(k) / 64.0))
            .chain(gust)
            .chain(pulse);
        times.map(|t| t.clamp(0.0, duration)).fold([0.0f64; 2], |[steady, most], t| {
            [steady.max(past(self.ramped(t))), most.max(past(self.own(t)))]
        })
    }

    /// Velocity by this stage alone, m/s.
    fn own(&self, t: f64) -> [f64; 3] {
        let t = if self.held { 0.0 } else { t };
        let gust = self.gust.as_ref().map(|blowing| blowing.at(t));
        let pulse = self.perturbation.as_ref().map(|pulse| pulse.at(t));
        let add = |sum: [f64; 3], more: [f64; 3]| std::array::from_fn(|i| sum[i] + more[i]);
        [gust, pulse].into_iter().flatten().fold(self.ramped(t), add)
    }

    fn ramped(&self, t: f64) -> [f64; 3] {
        match self.ramp {
            Some((from, duration)) if t < duration => {
                let share = 0.5 * (1.0 - (PI * t.max(0.0) / duration).cos());
                std::array::from_fn(|i| from[i] + share * (self.steady[i] - from[i]))
            }
            _ => self.steady,
        }
    }

    /// Whether a gust blows at some time within `duration` (s) of the stage.
    pub fn gusts(&self, duration: f64) -> bool {
        let blows = |b: &Blowing| {
            let [start, end] = b.gust.acts();
            start < b.origin + duration && end > b.origin
        };
        self.gust.as_ref().is_some_and(blows)
    }
}

impl Scene {
    /// Velocity of the undisturbed air in `stage`, with the stages before it as long as `times` says.
    pub fn wind(&self, stage: usize, times: &StageTimes) -> Wind {
        let (Some(flow), Some(description)) = (&self.flow, self.stages.get(stage)) else {
            return Wind::default();
        };
        let before = self.source_stage(stage, Role::Flow);
        let before = before.map(|b| Box::new((self.wind(b, times), times.of(b))));
        let (steady, ramp) = match &description.wind {
            None => (flow.wind_m_s, None),
            Some(w) => {
                let from = before.as_ref().map_or(flow.wind_m_s, |b| b.0.ramped(b.1));
                (w.velocity_m_s, (w.ramp_s > 0.0).then_some((from, w.ramp_s)))
            }
        };
        let gust =
            self.gust(stage).map(|(gust, clock)| Blowing::new(gust.clone(), times.clock(self, stage, clock)));
        let held = !description.in_time();
        let perturbation = self.perturbation(stage);
        Wind { steady, ramp, gust, perturbation, held, before }
    }

    /// The gust that `stage` may meet, and its clock.
    pub fn gust(&self, stage: usize) -> Option<(&Gust, Clock)> {
        let own = self.stages.get(stage).and_then(|s| s.gust.as_ref()).map(|g| (g, Clock::Stage));
        let common = self.flow.as_ref().and_then(|f| f.gust.as_ref()).map(|g| (g, Clock::Release));
        own.or(common).map(|(gust, clock)| (gust, gust.clock.unwrap_or(clock)))
    }

    /// Whether any stage has a gust.
    pub fn has_gust(&self) -> bool {
        (0..self.stages.len()).any(|stage| self.gust(stage).is_some())
    }

    /// Whether any stage has a gust that is more than one pulse of the shape `1 - cos`.
    pub fn has_general_gust(&self) -> bool {
        (0..self.stages.len()).any(|stage| self.gust(stage).is_some_and(|(g, _)| g.is_general()))
    }

    /// Whether any stage has turbulence.
    pub fn has_turbulent_gust(&self) -> bool {
        let dryden = |stage| self.gust(stage).is_some_and(|(g, _)| g.shape == GustShape::Dryden);
        (0..self.stages.len()).any(dryden)
    }

    /// Whether parts of the structure meet the undisturbed air: lines with drag, a payload that moves.
    pub fn structure_meets_wind(&self) -> bool {
        let payload = self.payload_body().is_some() && self.payload_drag().is_some();
        payload || self.line_drag().is_some()
    }

    /// Whether the wind belongs to stages or clocks: a gust, a perturbation, or a wind of a stage.
    pub fn has_stage_wind(&self) -> bool {
        self.has_gust() || self.has_perturbation() || self.stages.iter().any(|s| s.wind.is_some())
    }
}
