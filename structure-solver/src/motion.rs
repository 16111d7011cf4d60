//! Prescribed motions of nodes.

use crate::dynamics::{Dynamics, Interval, blend};
use crate::loops::FaceLoad;
use crate::newton::{NewtonError, NewtonInfo};

/// A displacement history of some components of some nodes.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Components that move, as local numbers `3 node + component`.
    pub(crate) dofs: Vec<u32>,
    /// Where they are at the start, m.
    pub(crate) start: Vec<f64>,
    time: Vec<f64>,
    displacement: Vec<[f64; 3]>,
}

impl Motion {
    /// Of `dofs`, now displaced by `start` (m): `displacement` (m) from there at each
    /// `time` (s), ascending and as many, at least one.
    pub(crate) fn new(dofs: Vec<u32>, start: Vec<f64>, time: Vec<f64>, displacement: Vec<[f64; 3]>) -> Self {
        debug_assert!(!time.is_empty() && time.len() == displacement.len());
        Self { dofs, start, time, displacement }
    }

    /// Displacement from the start at time `t` (s): linear between the given times,
    /// constant before and after them. At infinity the last one.
    pub fn at(&self, t: f64) -> [f64; 3] {
        case::interpolate(&self.time, &self.displacement, t)
    }

    /// Displacement of each of the components at time `t` (s), from the unstressed
    /// positions, m.
    pub(crate) fn values(&self, t: f64) -> impl Iterator<Item = (u32, f64)> {
        let d = self.at(t);
        self.dofs.iter().zip(&self.start).map(move |(&i, s)| (i, s + d[i as usize % 3]))
    }
}

impl Dynamics {
    /// Moves `components` of the mesh's `nodes` by a history from where they are now:
    /// `displacement` (m) at each `time` (s since the start of the stage, ascending, at
    /// least one), linear in between. Collective.
    pub fn prescribe(
        &mut self,
        nodes: &[u32],
        components: [bool; 3],
        time: &[f64],
        displacement: &[[f64; 3]],
    ) {
        let local = nodes.iter().filter_map(|&n| self.system.model.numbering.local(u64::from(n)));
        let dofs: Vec<u32> =
            local.flat_map(|i| (0..3).filter(|&c| components[c]).map(move |c| (3 * i + c) as u32)).collect();
        let start = dofs.iter().map(|&i| self.accepted.u[i as usize]).collect();
        self.system.fix(&dofs);
        self.motions.push(Motion::new(dofs, start, time.to_vec(), displacement.to_vec()));
    }

    /// A step in which prescribed components move.
    ///
    /// They have the velocity of a uniform motion over the step and count with their
    /// change of velocity as inertia of their neighbours.
    pub(crate) fn step_with_motion(
        &mut self,
        part: Interval<'_>,
        known: Option<usize>,
    ) -> Result<NewtonInfo, NewtonError> {
        if self.motions.is_empty() && self.payload.is_none() {
            return self.step(part, known);
        }
        let Interval { span, window, load, body } = part;
        let dt = part.dt();
        let end = self.time + span[1] * window;
        self.system.prescribed.clear();
        self.system.prescribed.extend(self.motions.iter().flat_map(|m| m.values(end)));
        let mut body_state = self.current.body;
        if let (Some(p), Some(s)) = (&self.payload, &mut body_state) {
            p.advance(s, body.into(), dt);
            for (n, x) in p.places(s) {
                let reference = &self.system.model.reference[3 * n..3 * n + 3];
                self.system.prescribed.extend((0..3).map(|c| ((3 * n + c) as u32, x[c] - reference[c])));
            }
        }
        let form = self.scheme.step(dt, self.damping);
        let mut before = Vec::with_capacity(self.system.prescribed.len());
        for &(i, u) in &self.system.prescribed {
            let i = i as usize;
            let (du, v0, a0) = (u - self.current.u[i], self.current.v[i], self.current.a[i]);
            let v1 = du / dt;
            before.push((i, v0, a0, v1));
            // The old velocity with which the scheme finds this inertia.
            let inertia = (v1 - v0) / dt + self.damping * v1;
            self.current.v[i] = (inertia - form.mass_factor * du) / form.from_v;
            self.current.a[i] = 0.0;
        }
        let result = self.step(part, known);
        for (i, v0, a0, v1) in before {
            self.current.v[i] = v0;
            self.current.a[i] = a0;
            if result.is_ok() {
                self.next.v[i] = v1;
                self.next.a[i] = 0.0;
            }
        }
        if let (Ok(_), Some(s)) = (&result, body_state) {
            blend(load, span[1], &mut self.pressure, &mut self.traction);
            let (pressure, traction) =
                (std::mem::take(&mut self.pressure), std::mem::take(&mut self.traction));
            self.finish_payload(s, FaceLoad { pressure: &pressure, traction: &traction }, body.into(), dt);
            (self.pressure, self.traction) = (pressure, traction);
        }
        result
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histories_are_linear_between_their_times() {
        let m = Motion::new(vec![5], vec![0.1], vec![1.0, 3.0], vec![[0.0; 3], [0.0, 0.0, 2.0]]);
        assert_eq!(m.at(0.0), [0.0; 3]);
        assert_eq!(m.at(2.0), [0.0, 0.0, 1.0]);
        assert_eq!(m.at(f64::INFINITY), [0.0, 0.0, 2.0]);
        assert_eq!(m.values(1.5).collect::<Vec<_>>(), [(5, 0.6)]);
    }
}
