//! Reefing lines: closed tension-only lines through the skirt, drawn in and cut at a time.
//!
//! Segments of one line between neighbouring attachments share its length in the ratio of
//! their unstressed distances, so a segment is a cable whose rest length depends on time:
//! from the unstressed skirt to the reefed length over the time of drawing in. When the line is
//! cut, its force fades over a ramp. A line that is cut before the stage has no elements at all.

use super::cable::{self, AxialStress, TensionOnly};
use mesh::geometry::Vec3;

/// A reefing line in a stage.
#[derive(Clone, Copy, Debug)]
pub struct Schedule {
    /// Length of the reefed line, m.
    pub length: f64,
    /// Time over which it is drawn in from the start of this stage, s; zero: it is already.
    pub draw_in: f64,
    /// When it is cut in this stage, s; infinite: never.
    pub release: f64,
    /// Time over which its force fades then, s.
    pub ramp: f64,
}

impl Schedule {
    /// Length at time `t` (s) of a line through a skirt of unstressed length `skirt` (m).
    pub fn length_at(&self, t: f64, skirt: f64) -> f64 {
        let share = if t < self.draw_in { t.max(0.0) / self.draw_in } else { 1.0 };
        // Smooth at both ends.
        skirt + (self.length - skirt) * share * share * (3.0 - 2.0 * share)
    }

    /// Share of its force that the line has at time `t` (s).
    pub fn strength_at(&self, t: f64) -> f64 {
        let since = t - self.release;
        if since < 0.0 || t.is_infinite() {
            1.0
        } else if since < self.ramp {
            1.0 - since / self.ramp
        } else {
            0.0
        }
    }
}

/// One reefing line at an instant. The rest length of a segment is kept as its share of the line's length.
pub struct Reefing {
    law: TensionOnly,
    schedule: Schedule,
    /// Length of the unstressed skirt, m.
    skirt: f64,
    /// Length and strength now.
    length: f64,
    strength: f64,
}

impl Reefing {
    /// Of Young's modulus (Pa) through a skirt of unstressed length `skirt` (m), at the start of a stage.
    pub fn new(youngs_modulus: f64, schedule: Schedule, skirt: f64) -> Self {
        let mut line =
            Self { law: TensionOnly { youngs_modulus }, schedule, skirt, length: 0.0, strength: 0.0 };
        line.set_time(0.0);
        line
    }
}

impl AxialStress for Reefing {
    /// Vector between the ends: the rest length changes within the step.
    type Start = Vec3;
    const TIMED: bool = true;

    fn rest_length(&self, share: f64) -> f64 {
        share * self.length
    }

    fn start(&self, d: Vec3, _rest_length: f64) -> Vec3 {
        d
    }

    #[inline(always)]
    fn stress(&self, start: &Vec3, end: Vec3, rest_length: f64, w: f64) -> (f64, f64) {
        let (from, to) = (cable::strain(*start, rest_length), cable::strain(end, rest_length));
        let (s, y) = cable::step(&self.law, from, to, w);
        (self.strength * s, self.strength * y)
    }

    fn energy(&self, x: &[Vec3; 2], rest_length: f64, area: f64) -> f64 {
        self.strength * cable::energy(&self.law, x, rest_length, 0.0, area)
    }

    fn set_time(&mut self, t: f64) {
        self.length = self.schedule.length_at(t, self.skirt);
        self.strength = self.schedule.strength_at(t);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_drawn_in_held_and_cut() {
        let s = Schedule { length: 4.0, draw_in: 0.5, release: 2.0, ramp: 0.2 };
        assert_eq!([0.0, 0.25, 0.5, 3.0].map(|t| s.length_at(t, 10.0)), [10.0, 7.0, 4.0, 4.0]);
        assert_eq!([0.0, 1.999, 2.3, 9.0].map(|t| s.strength_at(t)), [1.0, 1.0, 0.0, 0.0]);
        assert!((s.strength_at(2.1) - 0.5).abs() < 1e-12);
        let held = Schedule { draw_in: 0.0, release: f64::INFINITY, ramp: 0.0, ..s };
        assert_eq!((held.length_at(0.0, 10.0), held.strength_at(1e9)), (4.0, 1.0));
        // A shape at rest is looked for with the line in place.
        assert_eq!(s.strength_at(f64::INFINITY), 1.0);
    }
}
