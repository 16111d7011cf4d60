//! Prescribed motions of nodes.

use case::NodeMotion;

use crate::dynamics::{Dynamics, Interval, blend};
use crate::loops::FaceLoad;
use crate::newton::{NewtonError, NewtonInfo};

/// A motion of some components of some nodes.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Components that move, as local numbers `3 node + component`.
    pub(crate) dofs: Vec<u32>,
    /// Where they are at the start, m.
    pub(crate) start: Vec<f64>,
    /// Positions of their nodes at the start, m.
    places: Vec<[f64; 3]>,
    by_time: NodeMotion,
}

impl Motion {
    /// Of `dofs`, now displaced by `start` (m), of nodes that are now at `places` (m).
    pub(crate) fn new(dofs: Vec<u32>, start: Vec<f64>, places: Vec<[f64; 3]>, by_time: NodeMotion) -> Self {
        debug_assert!(dofs.len() == start.len() && dofs.len() == places.len());
        Self { dofs, start, places, by_time }
    }

    /// Displacement of each of the components at time `t` (s), from the unstressed
    /// positions, m. At infinity the last one of tables.
    pub(crate) fn values(&self, t: f64) -> impl Iterator<Item = (u32, f64)> {
        let (pose, rotates) = (self.by_time.at(t), self.by_time.rotates());
        self.dofs.iter().zip(&self.start).zip(&self.places).map(move |((&i, s), x)| {
            let c = i as usize % 3;
            let moved = if rotates { pose.apply(*x)[c] - x[c] } else { pose.displacement[c] };
            (i, s + moved)
        })
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
        self.prescribe_motion(nodes, components, NodeMotion::table(time, displacement));
    }

    /// Moves `components` of the mesh's `nodes` from where they are now. Collective.
    pub fn prescribe_motion(&mut self, nodes: &[u32], components: [bool; 3], motion: NodeMotion) {
        let local = nodes.iter().filter_map(|&n| self.system.model.numbering.local(u64::from(n)));
        let dofs: Vec<u32> =
            local.flat_map(|i| (0..3).filter(|&c| components[c]).map(move |c| (3 * i + c) as u32)).collect();
        let (reference, u) = (&self.system.model.reference, &self.accepted.u);
        let start = dofs.iter().map(|&i| u[i as usize]).collect();
        let node = |i: &u32| (*i as usize / 3) * 3;
        let places =
            dofs.iter().map(|i| [0, 1, 2].map(|c| reference[node(i) + c] + u[node(i) + c])).collect();
        self.system.fix(&dofs);
        self.motions.push(Motion::new(dofs, start, places, motion));
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
        let table = NodeMotion::table(&[1.0, 3.0], &[[0.0; 3], [0.0, 0.0, 2.0]]);
        let m = Motion::new(vec![5], vec![0.1], vec![[0.0; 3]], table);
        let at = |t: f64| m.values(t).collect::<Vec<_>>();
        assert_eq!((at(0.0), at(1.5)), (vec![(5, 0.1)], vec![(5, 0.6)]));
        assert_eq!((at(2.0), at(f64::INFINITY)), (vec![(5, 1.1)], vec![(5, 2.1)]));
    }
}
