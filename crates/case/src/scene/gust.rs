//! Gusts: changes of the undisturbed wind in time.

use std::f64::consts::{PI, TAU};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::dryden::{Dryden, DrydenTurbulence, SMALL};
use super::wind::Clock;
use crate::check::Check;

/// A change of the wind in time, the same at all places: `velocity_m_s` times a factor of time, or turbulence.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gust {
    /// What the gust adds to the wind at its height where the factor of `shape` is 1, m/s. In `"dryden"` the root mean square of each component.
    pub velocity_m_s: [f64; 3],
    /// Factor of the velocity over time.
    #[serde(default)]
    pub shape: GustShape,
    /// When it begins, s on its clock.
    #[serde(default)]
    pub start_s: f64,
    /// How long one pulse of `"one-minus-cosine"`, the rise of `"ramp"` or that of the turbulence of `"dryden"` lasts, s.
    pub duration_s: Option<f64>,
    /// Period of `"sine"`, s. In `"one-minus-cosine"` and `"table"` the time from one start to the next. Absent: once.
    pub period_s: Option<f64>,
    /// How many periods there are. Absent: without end.
    pub cycles: Option<u32>,
    /// Strictly increasing times of `"table"`, s from `start_s`.
    #[serde(default)]
    pub time_s: Vec<f64>,
    /// Factor at each time of `"table"`; linear in between, constant beyond.
    #[serde(default)]
    pub factor: Vec<f64>,
    /// Length scale of the x, y and z components of `"dryden"`, m. MIL-F-8785C has 533 m for all three above 610 m. Below 305 m it has the
    /// height for the vertical one and `h / (0.177 + 0.0027 h)^1.2` for the horizontal ones, with h and length in m.
    pub length_m: Option<[f64; 3]>,
    /// Speed at which the frame passes through the frozen turbulence of `"dryden"`, m/s: about that of the descent.
    pub speed_m_s: Option<f64>,
    /// Axis of that passage: the component along it has the longitudinal spectrum, the others the transverse one. Absent: z.
    pub passage: Option<GustAxis>,
    /// Chooses the frequencies and phases of `"dryden"`: each seed another signal, the same in each run. Absent: 1.
    pub seed: Option<u32>,
    /// What `start_s` counts from. Absent: the release in `[flow.gust]`, the start of the stage in
    /// `[stage.gust]`.
    pub clock: Option<Clock>,
}

/// Factor of a gust's velocity over `t`, the time since its start; 0 before the start except in a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GustShape {
    /// `(1 - cos(2 pi t / duration))/2`, a pulse, CS-25.341; with `period_s` a train of pulses.
    #[default]
    OneMinusCosine,
    /// `(1 - cos(pi t / duration))/2`, then 1: the wind rises and stays.
    Ramp,
    /// `sin(2 pi t / period)`.
    Sine,
    /// From `time_s` and `factor`; with `period_s` it repeats.
    Table,
    /// Turbulence with the Dryden spectra of MIL-F-8785C: a sum of 120 cosines for each component, whose frequencies reach from 0.001 to 1000
    /// `speed_m_s / length_m` (rad/s) and hold 99.87 % of the variance. It grows from nothing over `duration_s` as `"ramp"` does, and stays.
    Dryden,
}

/// An axis of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum GustAxis {
    /// The x axis.
    X,
    /// The y axis.
    Y,
    /// The z axis, upwards.
    #[default]
    Z,
}

impl GustShape {
    /// As a scene writes it.
    fn name(self) -> &'static str {
        match self {
            Self::OneMinusCosine => "one-minus-cosine",
            Self::Ramp => "ramp",
            Self::Sine => "sine",
            Self::Table => "table",
            Self::Dryden => "dryden",
        }
    }
}

/// Intervals of a smooth change whose ends are evaluated for its largest value.
const INTERVALS: u32 = 64;
/// Evaluations in the shortest period of turbulence for the largest value, and evaluations of a stage at most.
const SAMPLES: [f64; 2] = [8.0, 4096.0];
/// Largest speed of turbulence in units of its root mean square: a component of a normal distribution is beyond it 0.006 % of the time.
const LARGEST: f64 = 4.0;
/// Seed where a scene has none.
const SEED: u32 = 1;
/// Most periods whose values are evaluated for the largest: the steady part changes once at most.
const PERIODS: f64 = 256.0;

impl Gust {
    /// One pulse of the shape `1 - cos`, in m/s and s on its clock.
    pub fn pulse(velocity_m_s: [f64; 3], start_s: f64, duration_s: f64) -> Self {
        Self { velocity_m_s, start_s, duration_s: Some(duration_s), ..Self::default() }
    }

    /// What the gust adds to the wind at `t` (s on its clock), m/s. [`crate::Wind`] has the cosines of turbulence; here they are made for each call.
    pub fn at(&self, t: f64) -> [f64; 3] {
        self.with(self.turbulence().as_ref(), t)
    }

    /// As [`Self::at`], with the `turbulence` of this gust.
    pub(crate) fn with(&self, turbulence: Option<&DrydenTurbulence>, t: f64) -> [f64; 3] {
        let factor = self.factor_at(t);
        match turbulence {
            Some(_) if factor == 0.0 => [0.0; 3],
            Some(air) => air.at(t - self.start_s).map(|v| factor * v),
            None => self.velocity_m_s.map(|v| factor * v),
        }
    }

    /// The cosines of its turbulence. `None` in another shape.
    pub(crate) fn turbulence(&self) -> Option<DrydenTurbulence> {
        let (GustShape::Dryden, Some(lengths), Some(speed)) = (self.shape, self.length_m, self.speed_m_s)
        else {
            return None;
        };
        let along = self.passage.unwrap_or_default() as usize;
        let seed = self.seed.unwrap_or(SEED);
        Some(DrydenTurbulence::new(&Dryden { rms: self.velocity_m_s, lengths, speed, along, seed }))
    }

    /// Factor of the velocity at `t` (s on its clock); of the root mean square in turbulence.
    pub fn factor_at(&self, t: f64) -> f64 {
        let since = t - self.start_s;
        if self.shape == GustShape::Table {
            return self.in_table(self.in_period(since).unwrap_or(f64::INFINITY));
        }
        let (Some(time), Some(length)) = (self.in_period(since), self.length()) else { return 0.0 };
        let phase = time / length;
        match self.shape {
            _ if phase < 0.0 => 0.0,
            GustShape::Sine => (TAU * phase).sin(),
            GustShape::Ramp | GustShape::Dryden if phase < 1.0 => 0.5 * (1.0 - (PI * phase).cos()),
            GustShape::Ramp | GustShape::Dryden => 1.0,
            _ if phase <= 1.0 => 0.5 * (1.0 - (TAU * phase).cos()),
            _ => 0.0,
        }
    }

    /// Time that scales the shape, s: the period of a sine, the duration of a pulse or rise.
    fn length(&self) -> Option<f64> {
        if self.shape == GustShape::Sine { self.period_s } else { self.duration_s }
    }

    /// Time since the start of its period, `since` (s) after the start of the gust. `None` after the last period.
    fn in_period(&self, since: f64) -> Option<f64> {
        let Some(period) = self.period_s.filter(|_| since >= 0.0) else { return Some(since) };
        let count = (since / period).floor();
        self.cycles.is_none_or(|n| count < f64::from(n)).then_some(since - count * period)
    }

    fn in_table(&self, time: f64) -> f64 {
        let after = self.time_s.partition_point(|t| *t <= time);
        match (after.checked_sub(1), self.time_s.get(after)) {
            (None, _) => self.factor.first().copied().unwrap_or(0.0),
            (Some(_), None) => self.factor.last().copied().unwrap_or(0.0),
            (Some(before), Some(end)) => {
                let start = self.time_s[before];
                let share = (time - start) / (end - start);
                self.factor[before] + share * (self.factor[after] - self.factor[before])
            }
        }
    }

    /// Largest absolute value of the factor. In turbulence 4, which a component exceeds 0.006 % of the time.
    pub fn largest_factor(&self) -> f64 {
        match self.shape {
            GustShape::Table => self.factor.iter().fold(0.0, |most, f| most.max(f.abs())),
            GustShape::Dryden => LARGEST,
            _ => 1.0,
        }
    }

    /// Largest speed that the gust adds, m/s.
    pub fn largest_speed(&self) -> f64 {
        self.largest_factor() * self.velocity_m_s.iter().map(|v| v * v).sum::<f64>().sqrt()
    }

    /// Start and end of the time in which the factor differs from zero, s on its clock. Either may be infinite.
    pub fn acts(&self) -> [f64; 2] {
        let own = match self.shape {
            GustShape::Table => [self.time_s.first(), self.time_s.last()].map(|t| t.copied().unwrap_or(0.0)),
            GustShape::Ramp | GustShape::Dryden => [0.0, f64::INFINITY],
            _ => [0.0, self.length().unwrap_or(0.0)],
        };
        let stays = |end: Option<&f64>| self.shape == GustShape::Table && end.is_some_and(|f| *f != 0.0);
        let repeats = self
            .period_s
            .map_or(0.0, |p| self.cycles.map_or(f64::INFINITY, |n| f64::from(n.saturating_sub(1)) * p));
        let start = if stays(self.factor.first()) { f64::NEG_INFINITY } else { self.start_s + own[0] };
        let end = if stays(self.factor.last()) { f64::INFINITY } else { self.start_s + own[1] + repeats };
        [start, end]
    }

    /// Period of a gust that repeats, s: of the sine, of a table, or of the cosine of a train of pulses. In turbulence the period below which lies 1 %
    /// of the variance of a component across the passage, and less along it: the shortest of the components.
    pub fn shortest_period(&self) -> Option<f64> {
        if let (GustShape::Dryden, Some(lengths), Some(speed)) = (self.shape, self.length_m, self.speed_m_s) {
            let moving = lengths.iter().zip(self.velocity_m_s).filter(|(_, rms)| *rms > 0.0);
            let shortest = moving.map(|(length, _)| *length).reduce(f64::min)?;
            return Some(TAU * shortest / (SMALL * speed));
        }
        let period = self.period_s?;
        Some(if self.shape == GustShape::OneMinusCosine { self.duration_s.unwrap_or(period) } else { period })
    }

    /// Whether it is more than one pulse of the shape `1 - cos`.
    pub fn is_general(&self) -> bool {
        self.shape != GustShape::OneMinusCosine || self.period_s.is_some()
    }

    /// Times at which its largest values in a stage are found, s since the start of the stage, at which its clock shows
    /// `origin`: those of one change, or of at most 256 periods within `duration` (s); of turbulence 8 in its shortest period, at most 4096.
    pub(crate) fn samples(&self, origin: f64, duration: f64) -> Vec<f64> {
        let start = self.start_s - origin;
        if self.shape == GustShape::Dryden {
            let period = self.shortest_period().unwrap_or(duration);
            let count =
                (SAMPLES[0] * duration / period).ceil().clamp(f64::from(INTERVALS), SAMPLES[1]) as u32;
            return (0..=count).map(|k| duration * f64::from(k) / f64::from(count)).collect();
        }
        let (mut first, mut count, mut step) = (start, 0, 0.0);
        if let Some(period) = self.period_s {
            let begin = (-start / period).floor().max(0.0);
            let last = ((duration - start) / period).floor();
            let last = self.cycles.map_or(last, |n| last.min(f64::from(n) - 1.0)).max(begin);
            let stride = ((last - begin) / PERIODS).ceil().max(1.0);
            (first, count, step) =
                (start + begin * period, ((last - begin) / stride) as u32, stride * period);
        }
        (0..=count).flat_map(|k| self.changes(first + f64::from(k) * step)).collect()
    }

    /// Times of one change that begins at `start`, s.
    fn changes(&self, start: f64) -> Vec<f64> {
        if self.shape == GustShape::Table {
            return self.time_s.iter().map(|t| start + t).collect();
        }
        let end = start + self.length().unwrap_or(0.0);
        let share = |k: u32| f64::from(k) / f64::from(INTERVALS);
        (0..=INTERVALS).map(|k| start + (end - start) * share(k)).collect()
    }
}

pub(super) const THREE_SPEEDS: &str = "three numbers in m/s";

/// Refuses gusts without a time, keys that their shape does not have, and invalid tables.
pub(super) fn check(g: &Gust, path: &str, c: &mut Check) {
    c.range(&format!("{path}.start_s"), g.start_s, 0.0..=1e6, "in s");
    c.finite(&format!("{path}.velocity_m_s"), &g.velocity_m_s, "a velocity", THREE_SPEEDS);
    for (key, value) in [("duration_s", g.duration_s), ("period_s", g.period_s)] {
        if let Some(value) = value {
            c.positive(&format!("{path}.{key}"), value, 1e6, "a time in s");
        }
    }
    if let Some(cycles) = g.cycles {
        c.count(&format!("{path}.cycles"), cycles, 1..=1_000_000_000, "whole periods");
    }
    keys(g, path, c);
    match g.shape {
        GustShape::Table => table(g, path, c),
        GustShape::Dryden => turbulence(g, path, c),
        _ => {}
    }
    if let (Some(duration), Some(period)) = (g.duration_s, g.period_s)
        && duration > period
    {
        c.refuse(
            &format!("{path}.period_s"),
            format!("the next pulse starts after {period} s, `period_s`, but a pulse lasts {duration} s"),
            "set period_s to duration_s or more",
        );
    }
}

/// A key of some shapes.
struct Key {
    name: &'static str,
    given: bool,
    needed: bool,
    allowed: bool,
    /// What it is.
    meaning: &'static str,
    /// Shapes that have it.
    shapes: &'static str,
}

/// The keys of `g` that not all shapes have.
fn keys_of(g: &Gust) -> [Key; 8] {
    use GustShape::{Dryden, OneMinusCosine, Ramp, Sine, Table};
    let key = |name, given, [needed, allowed]: [bool; 2], meaning, shapes| Key {
        name,
        given,
        needed,
        allowed,
        meaning,
        shapes,
    };
    let (pulse, dryden) = (matches!(g.shape, OneMinusCosine | Ramp | Dryden), g.shape == Dryden);
    let repeats = matches!(g.shape, OneMinusCosine | Sine | Table);
    let rows = !g.time_s.is_empty() || !g.factor.is_empty();
    let periodic = "\"one-minus-cosine\", \"sine\" or \"table\"";
    let time = "the time of the pulse or rise, s";
    let lengths = "the length scales of the x, y and z components, m";
    let speed = "the speed at which the frame passes through the turbulence, m/s";
    [
        key(
            "duration_s",
            g.duration_s.is_some(),
            [pulse; 2],
            time,
            "\"one-minus-cosine\", \"ramp\" or \"dryden\"",
        ),
        key("period_s", g.period_s.is_some(), [g.shape == Sine, repeats], "the period, s", periodic),
        key(
            "cycles",
            g.cycles.is_some(),
            [false, g.period_s.is_some() && repeats],
            "the number of periods",
            periodic,
        ),
        key("time_s", rows, [g.shape == Table; 2], "times, s, and as many values of `factor`", "\"table\""),
        key("length_m", g.length_m.is_some(), [dryden; 2], lengths, "\"dryden\""),
        key("speed_m_s", g.speed_m_s.is_some(), [dryden; 2], speed, "\"dryden\""),
        key("passage", g.passage.is_some(), [false, dryden], "the axis of the passage", "\"dryden\""),
        key("seed", g.seed.is_some(), [false, dryden], "a whole number", "\"dryden\""),
    ]
}

/// Keys that the shape needs, and keys that it does not have.
fn keys(g: &Gust, path: &str, c: &mut Check) {
    let shape = g.shape.name();
    for Key { name, given, needed, allowed, meaning, shapes } in keys_of(g) {
        let at = format!("{path}.{name}");
        if needed && !given {
            c.refuse(
                &at,
                format!("a gust of shape \"{shape}\" has no `{name}`"),
                format!("set {name}: {meaning}"),
            );
        } else if given && !allowed {
            let (what, help) = if name == "cycles" && !matches!(g.shape, GustShape::Ramp | GustShape::Dryden)
            {
                (
                    format!("a gust without `period_s` has no `{name}`"),
                    "set period_s, or remove cycles".into(),
                )
            } else {
                (
                    format!("a gust of shape \"{shape}\" does not use `{name}`"),
                    format!("remove {name}, or set shape = {shapes}"),
                )
            };
            c.refuse(&at, what, help);
        }
    }
}

/// Refuses turbulence without a size.
fn turbulence(g: &Gust, path: &str, c: &mut Check) {
    let at = |key: &str| format!("{path}.{key}");
    if let Some(k) = g.velocity_m_s.iter().position(|v| *v < 0.0) {
        c.refuse(
            &at("velocity_m_s"),
            format!("the root mean square of component {} is {} m/s", ["x", "y", "z"][k], g.velocity_m_s[k]),
            "set three numbers of zero or more, in m/s",
        );
    }
    for length in g.length_m.iter().flatten() {
        c.positive(&at("length_m"), *length, 1e5, "a length in m");
    }
    if let Some(speed) = g.speed_m_s {
        c.positive(&at("speed_m_s"), speed, 1000.0, "a speed in m/s");
    }
}

/// Refuses a table that is no function of time, or that jumps where it repeats.
fn table(g: &Gust, path: &str, c: &mut Check) {
    let at = |key: &str| format!("{path}.{key}");
    c.finite(&at("time_s"), &g.time_s, "a time", "numbers in s");
    c.finite(&at("factor"), &g.factor, "a factor", "numbers");
    if g.time_s.len() != g.factor.len() {
        c.refuse(
            &at("factor"),
            format!("the table has {} values of `time_s` and {} of `factor`", g.time_s.len(), g.factor.len()),
            "list as many factors as times",
        );
    }
    if let Some(k) = g.time_s.windows(2).position(|w| w[0] >= w[1]) {
        c.refuse(
            &at(&format!("time_s[{}]", k + 1)),
            format!("`time_s[{}]` is {} s, after {} s", k + 1, g.time_s[k + 1], g.time_s[k]),
            "list the times of the table in strictly increasing order",
        );
    }
    let (Some(period), Some(first), Some(last)) = (g.period_s, g.time_s.first(), g.time_s.last()) else {
        return;
    };
    if *first < 0.0 || *last > period {
        c.refuse(
            &at("period_s"),
            format!("the table reaches from {first} to {last} s, but a period from 0 to {period} s"),
            "set period_s to the last time or more, and a first time of 0 or more",
        );
    }
    let ends = [g.factor.first(), g.factor.last()].map(|f| f.copied().unwrap_or(0.0));
    if ends[0] != ends[1] {
        c.refuse(
            &at("factor"),
            format!("`factor` jumps from {} to {} where the table repeats", ends[1], ends[0]),
            "begin and end a table that repeats with the same factor",
        );
    }
}
