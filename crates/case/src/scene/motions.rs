//! `[[stage.motion]]`: prescribed motions of nodes, and tables over time.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::nodes::selection;
use crate::check::Check;
use crate::{Clock, Scene, StageTimes};

/// A prescribed motion of nodes.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Name of a node set: `held`, `rim`, `canopy`, or a physical group of the mesh
    /// file.
    pub nodes: Option<String>,
    /// In place of a name: the node nearest to this point of the unstressed shape, m.
    pub at_m: Option<[f64; 3]>,
    /// Components that move as prescribed.
    #[serde(default = "all_components")]
    pub components: String,
    /// Ascending times, s on the clock. A static stage ends at the last one.
    pub time_s: Vec<f64>,
    /// Displacement at each time from where the nodes are at the start of the stage,
    /// m; linear in between, constant before and after. On another clock than that of the stage only what the
    /// table changes from the start of the stage on counts, so that one table continues over several stages.
    pub displacement_m: Vec<[f64; 3]>,
    /// What `time_s` counts from. Absent: the start of the stage.
    pub clock: Option<Clock>,
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
    /// Displacement at `t` (s on the clock of the table), m.
    pub fn at(&self, t: f64) -> [f64; 3] {
        interpolate(&self.time_s, &self.displacement_m, t)
    }

    /// The same motion by the clock of `stage`, in which it is: displacements from the start of the stage.
    pub fn in_stage(&self, scene: &Scene, stage: usize, times: &StageTimes) -> Self {
        let clock = self.clock.unwrap_or(Clock::Stage);
        if clock == Clock::Stage {
            return self.clone();
        }
        let origin = times.clock(scene, stage, clock);
        let start = self.at(origin);
        let from_start = |d: &[f64; 3]| std::array::from_fn(|i| d[i] - start[i]);
        Self {
            time_s: self.time_s.iter().map(|t| t - origin).collect(),
            displacement_m: self.displacement_m.iter().map(from_start).collect(),
            clock: Some(Clock::Stage),
            ..self.clone()
        }
    }
}

impl Motion {
    /// Refuses motions without nodes or components, and invalid tables.
    pub(crate) fn check(&self, path: &str, c: &mut Check) {
        selection(path, &self.nodes, &self.at_m, c);
        if self.components.is_empty() || !self.components.chars().all(|c| "xyz".contains(c)) {
            c.refuse(
                &format!("{path}.components"),
                format!("`components` is \"{}\"", self.components),
                "name some of x, y and z, as \"xyz\" or \"z\"",
            );
        }
        if self.time_s.is_empty() || self.time_s.len() != self.displacement_m.len() {
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
    }
}
