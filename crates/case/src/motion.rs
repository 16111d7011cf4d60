//! Tables over time.

use crate::{Clock, Motion, Scene, StageTimes};

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
