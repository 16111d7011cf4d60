//! Reefing lines: closed tension-only lines through the skirt, drawn in and cut at a time.
//!
//! Segments of one line between neighbouring attachments share its length in the ratio of
//! their unstressed distances, so a segment is a cable whose rest length depends on time:
//! from the unstressed skirt to the reefed length over the time of drawing in. When the line is
//! cut, its force fades over a ramp. A line that is cut before the stage has no loop at all.

use super::axial::{self, Axial};
use super::stencil::Stencil;
use super::{ElementLoop, FaceLoad, Place};
use crate::elements::cable::{self, TensionOnly};
use crate::elements::mass::MassMatrix;
use crate::model::Model;
use crate::vec3::{Mat3, Vec3, norm};

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

struct Segment {
    stencil: Stencil<2>,
    /// Its share of the line's length.
    share: f64,
    /// Vector between its ends at the start of the step.
    start: Vec3,
}

/// One reefing line's segments on a rank.
pub struct ReefingLine {
    elements: Vec<Segment>,
    n_own: usize,
    law: TensionOnly,
    area: f64,
    schedule: Schedule,
    /// Length of the unstressed skirt, m.
    skirt: f64,
    /// Length and strength now.
    length: f64,
    strength: f64,
}

impl ReefingLine {
    /// Through the ties of `model`; `skirt` is their length in the whole unstressed structure, m.
    pub fn new(model: &Model, law: TensionOnly, area: f64, schedule: Schedule, skirt: f64) -> Self {
        let of = |t: &[u32; 2]| {
            let stencil = Stencil::new(*t);
            let d = stencil.between(&model.reference);
            Segment { stencil, share: norm(d) / skirt, start: d }
        };
        let elements = model.ties.iter().map(of).collect();
        let mut line = Self {
            elements,
            n_own: model.n_own_ties,
            law,
            area,
            schedule,
            skirt,
            length: 0.0,
            strength: 0.0,
        };
        line.set_time(0.0);
        line
    }

    /// Largest tension (N) of the segments counted here.
    pub fn tension(&self, x: &[f64]) -> f64 {
        let one = |e: &Segment| {
            let p = e.stencil.gather(x);
            self.strength * cable::tension(&self.law, &p, e.share * self.length, 0.0, self.area)
        };
        self.elements[..self.n_own].iter().map(one).fold(0.0, f64::max)
    }

    /// Each segment in a step.
    #[inline(always)]
    fn axial<'a>(&'a self, place: Place<'a>) -> impl Iterator<Item = (&'a Stencil<2>, Axial)> {
        self.elements.iter().map(move |e| {
            let (d, end) = (e.stencil.between(place.at), e.stencil.between(place.end));
            let rest_length = e.share * self.length;
            let (from, to) = (cable::strain(e.start, rest_length), cable::strain(end, rest_length));
            let (s, y) = cable::step(&self.law, from, to, place.weight);
            (&e.stencil, Axial { d, end, rest_length, s: self.strength * s, y: self.strength * y })
        })
    }
}

impl ElementLoop for ReefingLine {
    fn depends_on_time(&self) -> bool {
        true
    }

    fn set_time(&mut self, t: f64) {
        self.length = self.schedule.length_at(t, self.skirt);
        self.strength = self.schedule.strength_at(t);
    }

    fn anchor(&mut self, x: &[f64]) {
        for e in &mut self.elements {
            e.start = e.stencil.between(x);
        }
    }

    fn forces(&self, place: Place<'_>, _load: FaceLoad<'_>, out: &mut [f64]) {
        axial::add_forces(self.axial(place), self.area, out);
    }

    fn tangent(
        &self,
        place: Place<'_>,
        _load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Mat3],
    ) {
        axial::add_tangent(self.axial(place), self.area, factor, out, blocks);
    }

    fn energy(&self, x: &[f64]) -> f64 {
        let one = |e: &Segment| {
            let p = e.stencil.gather(x);
            self.strength * cable::energy(&self.law, &p, e.share * self.length, 0.0, self.area)
        };
        self.elements[..self.n_own].iter().map(one).sum()
    }

    /// Massless, but with blocks in the matrix.
    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        self.elements.iter().map(|e| (e.stencil.nodes.to_vec(), 0.0)).collect()
    }

    fn mass_shares(&self, _element: usize, _kind: MassMatrix) -> Vec<f64> {
        vec![0.0; 4]
    }

    fn place(&mut self, slot: &dyn Fn(u32, u32) -> u32) {
        self.elements.iter_mut().for_each(|e| e.stencil.place(slot));
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
