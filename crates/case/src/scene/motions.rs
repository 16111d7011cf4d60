//! `[[stage.motion]]`: prescribed motions of nodes, and tables over time.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::body_motion::{distance_from_axis, sample_times};
use super::nodes::selection;
use crate::check::Check;
use crate::{Clock, Formula, FormulaError, Pose, Scene, StageTimes};

/// A prescribed motion of nodes: a rotation, then a displacement.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Name of a node set: `held`, `rim`, `canopy`, an edge of a panel (`left` and `right` at low and high x, `front` and `back` at low and high y), or a
    /// physical group of the mesh file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Components that move as prescribed.
    #[serde(default = "all_components")]
    pub components: String,
    /// Ascending times of the tables, s on the clock. A static stage ends at the last one.
    #[serde(default)]
    pub time_s: Vec<f64>,
    /// Displacement at each time from where the nodes are at the start of the stage,
    /// m; linear in between, constant before and after. On another clock than that of the stage only what the
    /// table changes from the start of the stage on counts, so that one table continues over several stages. May be absent where the nodes rotate.
    #[serde(default)]
    pub displacement_m: Vec<[f64; 3]>,
    /// Rotation of the nodes about an axis. Absent: none.
    pub rotation: Option<NodeRotation>,
    /// What `time_s` counts from. Absent: the start of the stage.
    pub clock: Option<Clock>,
}

/// Rotation of nodes about an axis that is displaced with them. The angle is a table or a formula.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NodeRotation {
    /// Direction of the axis, of any length.
    pub axis: [f64; 3],
    /// A point of the axis at the start of the stage, m.
    pub point_m: [f64; 3],
    /// Angle at each of `time_s`, degrees, right-handed about the axis; linear in between, constant before and after.
    #[serde(default)]
    pub angle_deg: Vec<f64>,
    /// In place of `angle_deg`: angle, rad, as a formula of `t`, s on the clock. On another clock than that of the stage only what it changes from the
    /// start of the stage on counts.
    pub angle_rad: Option<String>,
}

/// A motion of nodes as a function of the time since the start of its stage.
#[derive(Clone, Debug)]
pub struct NodeMotion {
    time: Vec<f64>,
    displacement: Vec<[f64; 3]>,
    rotation: Option<Turn>,
}

/// Angle of a rotation about an axis.
#[derive(Clone, Debug)]
struct Turn {
    axis: [f64; 3],
    point: [f64; 3],
    angle: Angle,
    /// Angle at the start of the stage, rad: what counts is the change since.
    start: f64,
}

/// Angle over time, rad.
#[derive(Clone, Debug)]
enum Angle {
    /// At the times of the motion.
    Table(Vec<f64>),
    /// By a formula, of the time since the start of the stage plus a shift, s.
    Formula(Formula, f64),
}

/// Interval of a one-sided difference quotient of second order, s.
const SHORT: f64 = 1e-4;
/// Distance from a time at which the velocity just before or after it is taken, s.
const BESIDE: f64 = 1e-9;

/// Slope of a table just after (`forward`) or just before `t`; zero outside of it.
fn slope(times: &[f64], values: &[[f64; 3]], t: f64, forward: bool) -> [f64; 3] {
    let t = if forward { t + BESIDE } else { t - BESIDE };
    let after = times.partition_point(|s| *s <= t);
    if values.is_empty() || after == 0 || after == times.len() {
        return [0.0; 3];
    }
    let span = times[after] - times[after - 1];
    std::array::from_fn(|i| (values[after][i] - values[after - 1][i]) / span)
}

impl NodeMotion {
    /// By a table of displacements (m) at ascending times (s), as many and at least one.
    pub fn table(time: &[f64], displacement: &[[f64; 3]]) -> Self {
        debug_assert!(!time.is_empty() && time.len() == displacement.len());
        Self { time: time.to_vec(), displacement: displacement.to_vec(), rotation: None }
    }

    /// Whether the nodes rotate.
    pub fn rotates(&self) -> bool {
        self.rotation.is_some()
    }

    /// Rotation and displacement at `t`, s since the start of the stage. At infinity the last ones of tables.
    pub fn at(&self, t: f64) -> Pose {
        let displacement = if self.displacement.is_empty() {
            [0.0; 3]
        } else {
            interpolate(&self.time, &self.displacement, t)
        };
        let Some(turn) = &self.rotation else { return Pose::displaced(displacement) };
        let angle = match &turn.angle {
            Angle::Table(values) => {
                let rows: Vec<[f64; 3]> = values.iter().map(|a| [*a, 0.0, 0.0]).collect();
                interpolate(&self.time, &rows, t)[0]
            }
            Angle::Formula(formula, shift) => formula.at(&[t + shift]),
        };
        Pose::new(displacement, angle - turn.start, turn.axis, turn.point)
    }

    /// Rate of the displacement, m/s, and of the angle, rad/s, just after (`forward`) or just before `t`, s since the start of the stage.
    pub fn rates(&self, t: f64, forward: bool) -> ([f64; 3], f64) {
        let slope = |rows: &[[f64; 3]]| slope(&self.time, rows, t, forward);
        let angle = match self.rotation.as_ref().map(|r| &r.angle) {
            None => 0.0,
            Some(Angle::Table(values)) => {
                slope(&values.iter().map(|a| [*a, 0.0, 0.0]).collect::<Vec<_>>())[0]
            }
            Some(Angle::Formula(formula, shift)) => {
                let h = if forward { SHORT } else { -SHORT };
                let f = |k: f64| formula.at(&[t + shift + k * h]);
                // Without the sign of a zero.
                (4.0 * f(1.0) - 3.0 * f(0.0) - f(2.0)) / (2.0 * h) + 0.0
            }
        };
        (slope(&self.displacement), angle)
    }

    /// Largest rate of the angle, rad/s, as the mean over each of `windows` windows of `window_s` seconds.
    pub fn largest_rate(&self, windows: u64, window_s: f64) -> f64 {
        let (mut before, mut fastest) = (self.at(0.0).angle, 0.0f64);
        for t in sample_times(windows, window_s) {
            let now = self.at(t).angle;
            fastest = fastest.max((now - before).abs());
            before = now;
        }
        fastest / window_s
    }

    /// Distance of a point from the axis of the rotation at the start of the stage, m; 0 without rotation.
    pub fn reach(&self, x: [f64; 3]) -> f64 {
        self.rotation.as_ref().map_or(0.0, |r| distance_from_axis(x, r.axis, r.point))
    }
}

fn all_components() -> String {
    "xyz".into()
}

/// Value at time `t` of a table of `values` at ascending `times`, as many and at least one: linear between
/// the times, constant before and after them. At infinity the last one.
pub fn interpolate(times: &[f64], values: &[[f64; 3]], t: f64) -> [f64; 3] {
    let after = times.partition_point(|s| *s <= t);
    if after == 0 {
        return values[0];
    }
    if after == times.len() {
        return values[after - 1];
    }
    let share = (t - times[after - 1]) / (times[after] - times[after - 1]);
    let (a, b) = (values[after - 1], values[after]);
    std::array::from_fn(|i| a[i] + share * (b[i] - a[i]))
}

impl Motion {
    /// Displacement at `t` (s on the clock of the table) without the rotation, m.
    pub fn at(&self, t: f64) -> [f64; 3] {
        if self.displacement_m.is_empty() {
            [0.0; 3]
        } else {
            interpolate(&self.time_s, &self.displacement_m, t)
        }
    }

    /// The motion since the start of `stage`, in which it is, by the clock of that stage.
    ///
    /// # Errors
    /// The text of the angle is not a formula.
    pub fn in_stage(
        &self,
        scene: &Scene,
        stage: usize,
        times: &StageTimes,
    ) -> Result<NodeMotion, FormulaError> {
        let clock = self.clock.unwrap_or(Clock::Stage);
        let own = clock == Clock::Stage;
        let origin = if own { 0.0 } else { times.clock(scene, stage, clock) };
        let start = if own { [0.0; 3] } else { self.at(origin) };
        let from_start = |d: &[f64; 3]| std::array::from_fn(|i| d[i] - start[i]);
        let mut motion = NodeMotion {
            time: self.time_s.iter().map(|t| t - origin).collect(),
            displacement: self.displacement_m.iter().map(from_start).collect(),
            rotation: self.rotation.as_ref().map(|r| r.compiled(origin)).transpose()?,
        };
        let angle = if own { 0.0 } else { motion.at(0.0).angle };
        motion.rotation.iter_mut().for_each(|r| r.start = angle);
        Ok(motion)
    }
}

impl NodeRotation {
    /// As a function of time on a clock that shows `origin` (s) at the start of the stage.
    fn compiled(&self, origin: f64) -> Result<Turn, FormulaError> {
        let length = self.axis.iter().map(|x| x * x).sum::<f64>().sqrt();
        let angle = match &self.angle_rad {
            Some(text) => Angle::Formula(Formula::parse(text, &["t"])?, origin),
            None => Angle::Table(self.angle_deg.iter().map(|a| a.to_radians()).collect()),
        };
        Ok(Turn { axis: self.axis.map(|x| x / length), point: self.point_m, angle, start: 0.0 })
    }
}

impl Motion {
    /// Refuses motions without nodes or components, and invalid tables and rotations. `fixed`: the stage is static; `span`: its length, s.
    pub(crate) fn check(&self, path: &str, fixed: bool, span: f64, c: &mut Check) {
        selection(path, &self.nodes, &self.at_m, c);
        if self.components.is_empty() || !self.components.chars().all(|c| "xyz".contains(c)) {
            c.refuse(
                &format!("{path}.components"),
                format!("`components` is \"{}\"", self.components),
                "name some of x, y and z, as \"xyz\" or \"z\"",
            );
        }
        let turned = self.rotation.as_ref();
        let absent = turned.is_some() && self.displacement_m.is_empty();
        if !absent && (self.time_s.is_empty() || self.time_s.len() != self.displacement_m.len()) {
            c.refuse(
                &format!("{path}.displacement_m"),
                format!("{} times, but {} displacements", self.time_s.len(), self.displacement_m.len()),
                "give one displacement for each time, at least one",
            );
        }
        let ascending = self.time_s.windows(2).all(|w| w[0] < w[1]);
        let mut values = self.time_s.iter().chain(self.displacement_m.iter().flatten());
        if !ascending || !values.all(|v| v.is_finite()) {
            c.refuse(
                &format!("{path}.time_s"),
                "the times do not ascend, or a value is not a number",
                "list times in ascending order",
            );
        }
        if let Some(r) = turned {
            r.check(&format!("{path}.rotation"), self.time_s.len(), fixed, span, c);
        }
    }
}

impl NodeRotation {
    /// Refuses an axis without direction, and an angle that is neither a table at the `times` nor a formula.
    fn check(&self, path: &str, times: usize, fixed: bool, span: f64, c: &mut Check) {
        c.finite(&format!("{path}.point_m"), &self.point_m, "a point", "three numbers in m");
        let length = self.axis.iter().map(|x| x * x).sum::<f64>();
        if !(length.is_finite() && length > 0.0) {
            c.refuse(&format!("{path}.axis"), "the axis has no direction", "name a vector, as [0, 0, 1]");
        }
        if self.angle_deg.is_empty() == self.angle_rad.is_none() {
            return c.refuse(
                path,
                format!(
                    "the rotation has {} angle",
                    if self.angle_rad.is_some() { "two kinds of" } else { "no" }
                ),
                "give either `angle_deg`, one for each of `time_s`, or a formula `angle_rad`",
            );
        }
        match &self.angle_rad {
            None => self.check_table(path, times, c),
            Some(text) => check_formula(text, &format!("{path}.angle_rad"), fixed, span, c),
        }
    }

    fn check_table(&self, path: &str, times: usize, c: &mut Check) {
        let path = format!("{path}.angle_deg");
        if self.angle_deg.len() != times {
            c.refuse(
                &path,
                format!("{times} times, but {} angles", self.angle_deg.len()),
                "give one angle for each of `time_s`",
            );
        }
        c.finite(&path, &self.angle_deg, "an angle", "numbers in degrees");
    }
}

/// Refuses a formula of an angle that cannot be evaluated within `span` seconds, or that belongs to a static stage.
fn check_formula(text: &str, path: &str, fixed: bool, span: f64, c: &mut Check) {
    if fixed {
        return c.refuse(
            path,
            "the stage is static: its time does not run",
            "give `angle_deg`, whose last angle counts, with `time_s`",
        );
    }
    match Formula::parse(text, &["t"]) {
        Err(e) => c.refuse(path, e.to_string(), "write a formula of t, as \"0.5*sin(2*t)\""),
        Ok(f) if !(0..=16).all(|k| f.at(&[span * f64::from(k) / 16.0]).is_finite()) => c.refuse(
            path,
            format!("\"{text}\" is not a number at all times of the stage"),
            "write a formula that is finite from the start to the end of the stage",
        ),
        Ok(_) => {}
    }
}
