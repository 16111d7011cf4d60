//! Gusts: changes of the undisturbed wind in time.

use std::f64::consts::{PI, TAU};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::wind::Clock;
use crate::check::Check;

/// A change of the wind in time: `velocity_m_s` times a factor of time, the same at all places.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Gust {
    /// What the gust adds to the wind at its height where the factor of `shape` is 1, m/s.
    pub velocity_m_s: [f64; 3],
    /// Factor of the velocity over time.
    #[serde(default)]
    pub shape: GustShape,
    /// When it begins, s on its clock.
    #[serde(default)]
    pub start_s: f64,
    /// How long one pulse of `"one-minus-cosine"` or the rise of `"ramp"` lasts, s.
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
}

impl GustShape {
    /// As a scene writes it.
    fn name(self) -> &'static str {
        match self {
            Self::OneMinusCosine => "one-minus-cosine",
            Self::Ramp => "ramp",
            Self::Sine => "sine",
            Self::Table => "table",
        }
    }
}

/// Intervals of a smooth change whose ends are evaluated for its largest value.
const INTERVALS: u32 = 64;
/// Most periods whose values are evaluated for the largest: the steady part changes once at most.
const PERIODS: f64 = 256.0;

impl Gust {
    /// One pulse of the shape `1 - cos`, in m/s and s on its clock.
    pub fn pulse(velocity_m_s: [f64; 3], start_s: f64, duration_s: f64) -> Self {
        Self { velocity_m_s, start_s, duration_s: Some(duration_s), ..Self::default() }
    }

    /// What the gust adds to the wind at `t` (s on its clock), m/s.
    pub fn at(&self, t: f64) -> [f64; 3] {
        let factor = self.factor_at(t);
        self.velocity_m_s.map(|v| factor * v)
    }

    /// Factor of the velocity at `t` (s on its clock).
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
            GustShape::Ramp if phase < 1.0 => 0.5 * (1.0 - (PI * phase).cos()),
            GustShape::Ramp => 1.0,
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

    /// Largest absolute value of the factor.
    pub fn largest_factor(&self) -> f64 {
        if self.shape == GustShape::Table {
            self.factor.iter().fold(0.0, |most, f| most.max(f.abs()))
        } else {
            1.0
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
            GustShape::Ramp => [0.0, f64::INFINITY],
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

    /// Period of a gust that repeats, s: of the sine, of a table, or of the cosine of a train of pulses.
    pub fn shortest_period(&self) -> Option<f64> {
        let period = self.period_s?;
        Some(if self.shape == GustShape::OneMinusCosine { self.duration_s.unwrap_or(period) } else { period })
    }

    /// Whether it is more than one pulse of the shape `1 - cos`.
    pub fn is_general(&self) -> bool {
        self.shape != GustShape::OneMinusCosine || self.period_s.is_some()
    }

    /// Times at which its largest values in a stage are found, s since the start of the stage, at which its clock shows
    /// `origin`: those of one change, or of at most 256 periods within `duration` (s).
    pub(crate) fn samples(&self, origin: f64, duration: f64) -> Vec<f64> {
        let start = self.start_s - origin;
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
    if g.shape == GustShape::Table {
        table(g, path, c);
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

/// Keys that the shape needs, and keys that it does not have.
fn keys(g: &Gust, path: &str, c: &mut Check) {
    use GustShape::{OneMinusCosine, Ramp, Sine, Table};
    let pulse = matches!(g.shape, OneMinusCosine | Ramp);
    let rows = !g.time_s.is_empty() || !g.factor.is_empty();
    // Key, whether it is given, needed, allowed, and what it is.
    let all = [
        ("duration_s", g.duration_s.is_some(), pulse, pulse, "the time of the pulse or rise, s"),
        ("period_s", g.period_s.is_some(), g.shape == Sine, g.shape != Ramp, "the period, s"),
        (
            "cycles",
            g.cycles.is_some(),
            false,
            g.period_s.is_some() && g.shape != Ramp,
            "the number of periods",
        ),
        ("time_s", rows, g.shape == Table, g.shape == Table, "times, s, and as many values of `factor`"),
    ];
    for (key, given, needed, allowed, meaning) in all {
        let at = format!("{path}.{key}");
        let name = g.shape.name();
        if needed && !given {
            c.refuse(
                &at,
                format!("a gust of shape \"{name}\" has no `{key}`"),
                format!("set {key}: {meaning}"),
            );
        } else if given && !allowed {
            let (what, help) = if key == "cycles" && g.shape != Ramp {
                (format!("a gust without `period_s` has no `{key}`"), "set period_s, or remove cycles".into())
            } else {
                let others = match key {
                    "duration_s" => "\"one-minus-cosine\" or \"ramp\"",
                    "time_s" => "\"table\"",
                    _ => "\"one-minus-cosine\", \"sine\" or \"table\"",
                };
                (
                    format!("a gust of shape \"{name}\" does not use `{key}`"),
                    format!("remove {key}, or set shape = {others}"),
                )
            };
            c.refuse(&at, what, help);
        }
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
