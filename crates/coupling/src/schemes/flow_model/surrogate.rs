//! What the flow will answer to a motion of the canopy, between two calls of it.
//!
//! The flow's load is the pressure that accelerates the air with the canopy, and a remainder that
//! hardly knows the motion within a window:
//!
//! $$ p(x) = q - \rho A^{-1} a_n(x), $$
//!
//! $a_n$ the normal acceleration of the faces by the same backward differences as mesh-mover and
//! flow-solver use, $A$ the influence of the vortex lattice ([`super::lattice`]). The remainder is
//! extrapolated from past windows before the flow is asked, and measured afterwards. What the
//! model misses, secants learn: differences of answers within a window, corrected for the model.
//!
//! A canopy of very many faces acts in groups of neighbours ([`super::groups`]): the matrix takes their
//! mean accelerations, and what a face moves beside its group gets the added mass of short waves.
//!
//! The canopy breathes, and windows become shorter where they are given back: the lattice is made anew when
//! it has turned or the air's screening is another one.

use std::collections::VecDeque;

use channel::LOAD_WIDTH;
use serde::{Deserialize, Serialize};

use super::groups::Groups;
use super::inverse::{Inverse, factors};
use super::lattice::{Air, Lattice};
use crate::error::RunError;
use crate::geometry::{Vec3, at, direction, distinct, quad_area_vector};
use crate::schemes::codec::{pack, unpack};
use crate::schemes::least_squares::{Columns, axpy, norm};
use crate::schemes::unknowns::Unknowns;

/// Secants kept.
const MOST_SECANTS: usize = 40;
/// A secant is dropped when less than this share of its motion is new.
/// (Much of what secants hold is noise: with 0.03 the descent below takes 6.2 iterations in each of its first ten
/// windows, with 0.1 it takes 4.9.)
const FILTER: f64 = 0.1;
/// Or when what is new is below this share of the load: divided by so little, what the flow's tolerance leaves
/// of an answer would be taken for a law. ATPS descent with 10 cells across, tolerance 1e-4, 100 windows, and a lattice
/// without screening: 5.5 iterations a window without, 4.9, 4.8, 5.1, 5.2 with 3e-5, 1e-4, 2e-4, 1e-3.
const NOISE: f64 = 1e-4;
/// The step is known exactly, the change has the noise of the flow's tolerance. Where the change is so many times the step,
/// it is the change that has to stand out of the noise: air in a closed volume answers a step of 1e-5 of the load with 1e-3 of it. Judged by
/// their steps such secants were dropped, and three of six runs of `closed-box` stalled at 2 to 7 times the tolerance; now
/// none of 22 does (`residual_drop` 1e-5; 10.4 iterations a window in those six, 8.3 in the 22).
const STEEP: f64 = 4.0;

/// The lattice is made anew when normals have turned by so much (root of the mean square, radians). The same descent
/// takes 3.7 iterations with 0.02 and 3.85 with 0.01, in 16 and 31 lattices; with 0.05 an eighth of an iteration more than with 0.02.
const TURNED: f64 = 0.02;
/// Or when windows are so much longer or shorter than those it is made for.
const LENGTHENED: f64 = 0.1;

/// The canopy at the end of a window: displacement and velocity relative to the ground, `[nodes][3]`.
#[derive(Serialize, Deserialize)]
struct Wall {
    displacement: Vec<f64>,
    velocity: Vec<f64>,
}

/// What the remainder changed by where the model's load changed by a step.
#[derive(Serialize, Deserialize)]
struct Secant {
    step: Vec<f64>,
    change: Vec<f64>,
    /// Share of the step that has to be new.
    filter: f64,
}

/// The model of the flow's answer: loads `[faces][LOAD_WIDTH]`, then the vertical force.
pub struct FlowModel {
    unknowns: Unknowns,
    faces: Vec<[u32; 4]>,
    air: Air,
    /// Groups at most.
    most: usize,
    /// Unstressed positions, m.
    reference: Vec<Vec3>,
    /// What the lattice is made for: displacement, `[nodes][3]`, m, and length of windows, s.
    made_for: (Vec<f64>, f64),
    normals: Vec<Vec3>,
    /// Vertical areas of the faces, m2.
    areas: Vec<f64>,
    groups: Groups,
    /// Of the influence.
    inverse: Inverse,
    /// Newest first.
    walls: VecDeque<Wall>,
    /// Length of the last window, s; 0 before it.
    dt: f64,
    secants: VecDeque<Secant>,
    columns: Columns,
}

impl FlowModel {
    /// For a canopy with these faces at the shape that the `lattice` is made for, at rest in a frame that moves with
    /// `velocity` (m/s), `displacement` from its unstressed shape, in `air`. Later lattices have `most` groups at most.
    /// `None` where this one gives no sensible matrix.
    pub fn new(
        unknowns: Unknowns,
        lattice: &Lattice,
        displacement: &[f64],
        velocity: f64,
        faces: &[[u32; 4]],
        air: Air,
        most: usize,
    ) -> Option<Self> {
        if faces.is_empty() {
            return None;
        }
        let inverse = Inverse::of(&factors(&lattice.influence))?;
        let moved = displacement.chunks_exact(3);
        let reference = lattice.positions.iter().zip(moved).map(|(x, d)| x - Vec3::from_column_slice(d));
        let at_rest = [0.0, 0.0, velocity].repeat(lattice.positions.len());
        let walls = VecDeque::from([Wall { displacement: displacement.to_vec(), velocity: at_rest }]);
        Some(Self {
            unknowns,
            faces: faces.to_vec(),
            air,
            most,
            reference: reference.collect(),
            made_for: (displacement.to_vec(), unknowns.window_s()),
            normals: lattice.normals.clone(),
            areas: lattice.areas.iter().map(|a| a[2]).collect(),
            groups: lattice.groups.clone(),
            inverse,
            walls,
            dt: 0.0,
            secants: VecDeque::new(),
            columns: Columns::default(),
        })
    }

    /// Makes the lattice anew where the canopy has turned since it was made, or windows have another length than
    /// `dt`. What was learnt about the old one is forgotten. `None` where it still serves, or where there is no better.
    pub fn follow(&mut self, dt: f64) -> Option<Lattice> {
        let at = self.positions(&self.walls[0].displacement);
        let normal = |face: &[u32; 4]| direction(&quad_area_vector(face.map(|n| at[n as usize])));
        let turns: Vec<Vec3> =
            self.faces.iter().zip(&self.normals).map(|(face, old)| normal(face) - old).collect();
        // Faces that flutter within a group turn nothing.
        let turned: f64 = (0..3)
            .map(|i| self.groups.means(&turns.iter().map(|turn| turn[i]).collect::<Vec<_>>()))
            .map(|means| means.iter().map(|m| m * m).sum::<f64>())
            .sum();
        let longer = (dt / self.made_for.1 - 1.0).abs() > LENGTHENED && self.air.screening(dt) > 0.0;
        if longer || turned > TURNED * TURNED * self.groups.len() as f64 {
            let shape = self.walls[0].displacement.clone();
            self.remake(shape, dt)
        } else {
            None
        }
    }

    /// Makes the lattice for a displacement of the canopy and a length of windows.
    fn remake(&mut self, displacement: Vec<f64>, dt: f64) -> Option<Lattice> {
        let _part = timing::part("added mass assembly");
        let at: Vec<mesh::Point> = self.positions(&displacement).into_iter().map(Into::into).collect();
        let lattice = Lattice::new(&at, &self.faces, self.most, self.air.screening(dt))?;
        self.inverse = Inverse::of(&factors(&lattice.influence))?;
        self.normals.clone_from(&lattice.normals);
        self.areas = lattice.areas.iter().map(|a| a[2]).collect();
        self.groups = lattice.groups.clone();
        self.made_for = (displacement, dt);
        self.forget();
        Some(lattice)
    }

    fn positions(&self, displacement: &[f64]) -> Vec<Vec3> {
        let moved = self.reference.iter().zip(displacement.chunks_exact(3));
        moved.map(|(x, d)| x + Vec3::from_column_slice(d)).collect()
    }

    /// The same with another density: more air makes schemes that rely on the model alone safer.
    pub fn with_density(self, density: f64) -> Self {
        Self { air: Air { density, ..self.air }, ..self }
    }

    /// Numbers in an answer.
    pub fn answers(&self) -> usize {
        self.faces.len() * LOAD_WIDTH + 1
    }

    /// Coefficients of the backward difference in a window of length `dt`, as the flow takes it; `None`: first
    /// order.
    fn difference(&self, dt: f64) -> Option<[f64; 3]> {
        if self.walls.len() < 2 { None } else { channel::bdf2(dt / self.dt) }
    }

    /// Velocity of the nodes relative to the ground at the end of a window to the unknowns `x`.
    fn velocities(&self, x: &[f64], dt: f64) -> Vec<f64> {
        let frame = self.unknowns.velocity(x, self.walls[0].velocity[2]);
        let at = self.unknowns.displacement(x);
        let past = |k: usize| &self.walls[k].displacement;
        let mut v: Vec<f64> = match self.difference(dt) {
            Some([a, b, c]) => {
                let differences = at.iter().zip(past(0)).zip(past(1));
                differences.map(|((x, x1), x2)| (a * x + b * x1 + c * x2) / dt).collect()
            }
            None => at.iter().zip(past(0)).map(|(x, x1)| (x - x1) / dt).collect(),
        };
        if self.unknowns.descends() {
            v.chunks_exact_mut(3).for_each(|v| v[2] += frame);
        }
        v
    }

    /// The part of the answer that accelerates air with the canopy, to the unknowns `x` at the end of
    /// a window of length `dt`.
    pub fn inertia(&self, x: &[f64], dt: f64, answer: &mut [f64]) {
        self.inertia_of(&self.acceleration(x, dt), answer);
    }

    /// Acceleration of the nodes to the unknowns `x` at the end of a window of length `dt`, `[nodes][3]`, m/s2.
    pub fn acceleration(&self, x: &[f64], dt: f64) -> Vec<f64> {
        let v = self.velocities(x, dt);
        let past = |k: usize| &self.walls[k].velocity;
        let difference = self.difference(dt);
        let rate = |i: usize| match difference {
            Some([a, b, c]) => (a * v[i] + b * past(0)[i] + c * past(1)[i]) / dt,
            None => (v[i] - past(0)[i]) / dt,
        };
        (0..v.len()).map(rate).collect()
    }

    /// The part of the answer that belongs to a [`FlowModel::acceleration`].
    pub fn inertia_of(&self, rate: &[f64], answer: &mut [f64]) {
        let accelerations = self.faces.iter().zip(&self.normals).map(|(face, normal)| {
            let nodes = distinct(face);
            let sum: f64 = nodes.iter().map(|&n| at(rate, n).dot(normal)).sum();
            sum / nodes.len() as f64
        });
        let accelerations: Vec<f64> = accelerations.collect();
        let means = self.groups.means(&accelerations);
        let jump = self.inverse.apply(&means);
        answer.fill(0.0);
        let mut force = 0.0;
        let faces = accelerations.iter().zip(&self.groups.of).zip(&self.areas);
        for (row, ((acceleration, &g), area)) in answer.chunks_exact_mut(LOAD_WIDTH).zip(faces) {
            let g = g as usize;
            row[0] = -self.air.density * (jump[g] + self.groups.fine[g] * (acceleration - means[g]));
            force += area * row[0];
        }
        answer[self.faces.len() * LOAD_WIDTH] = force;
    }

    /// Learns that where [`FlowModel::inertia`] changed by `step` within a window, the remainder of the flow's
    /// answer, of length `load`, changed by `change`: what the model gets wrong, as a function of its own load. That
    /// load knows nothing of what moves no air, and is to the flow's own as one to nearly one. A step below the share
    /// `least` of the load teaches nothing, unless the answer to it is steep.
    pub fn learn(&mut self, step: Vec<f64>, change: Vec<f64>, least: f64, load: f64) {
        let (length, changed) = (norm(&step), norm(&change));
        let steep = changed > STEEP * length;
        if length == 0.0 || !(steep || length > least * load) {
            return;
        }
        let signal = if steep { changed } else { length };
        let filter = FILTER.max(NOISE * load / signal);
        self.secants.push_front(Secant { step, change, filter });
        self.secants.truncate(MOST_SECANTS);
        self.refactor();
    }

    /// Adds to `answer` how the secants change the remainder where the inertia changes by `step`.
    pub fn correct(&self, step: &[f64], answer: &mut [f64]) {
        let mut rest = step.to_vec();
        for (c, secant) in self.columns.remove(&mut rest).iter().zip(&self.secants) {
            axpy(-c, &secant.change, answer);
        }
    }

    /// Forgets all secants.
    pub fn forget(&mut self) {
        self.secants.clear();
        self.columns = Columns::default();
    }

    /// Secants at hand.
    pub fn secants(&self) -> usize {
        self.secants.len()
    }

    /// A window of length `dt` ended with the grid at the unknowns `x`.
    pub fn accept(&mut self, x: &[f64], dt: f64) {
        let velocity = self.velocities(x, dt);
        let displacement = self.unknowns.displacement(x).to_vec();
        self.walls.push_front(Wall { displacement, velocity });
        self.walls.truncate(2);
        self.dt = dt;
    }

    /// State that later windows depend on.
    pub fn save_state(&self) -> Vec<u8> {
        pack(&(&self.walls, self.dt, &self.secants, &self.made_for))
    }

    /// Restores a [`FlowModel::save_state`] of the same canopy. The lattice, where it is another one.
    ///
    /// # Errors
    /// A state of something else.
    pub fn restore_state(&mut self, saved: &[u8]) -> Result<Option<Lattice>, RunError> {
        let (walls, dt, secants, (shape, length)): (_, f64, VecDeque<Secant>, (Vec<f64>, f64)) =
            unpack(saved)?;
        let lattice = if (&shape, length) == (&self.made_for.0, self.made_for.1) {
            None
        } else {
            self.remake(shape, length)
        };
        (self.walls, self.dt, self.secants) = (walls, dt, secants);
        // What was kept before is kept again, and gives the same factors.
        self.refactor();
        Ok(lattice)
    }

    fn refactor(&mut self) {
        self.columns = Columns::default();
        let columns = &mut self.columns;
        self.secants.retain(|secant| columns.push(&secant.step, secant.filter));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schemes::test_support::plate;

    const CELLS: usize = 24;

    /// Loads and force on a plate of side 1 that is thrown from rest with the velocity `motion` (m/s, upwards) of
    /// each point.
    fn thrown(most: usize, motion: impl Fn(&mesh::Point) -> f64) -> Vec<f64> {
        let (positions, faces) = plate(CELLS);
        let unknowns = Unknowns::new(positions.len(), 1.0, false);
        let rest = vec![0.0; 3 * positions.len()];
        let lattice = Lattice::new(&positions, &faces, most, 0.0).expect("a plate");
        let air = Air::incompressible(1.0);
        let model = FlowModel::new(unknowns, &lattice, &rest, 0.0, &faces, air, most).expect("a plate");
        let x: Vec<f64> = positions.iter().flat_map(|p| [0.0, 0.0, motion(p)]).collect();
        let mut answer = vec![0.0; model.answers()];
        model.inertia(&x, 1.0, &mut answer);
        answer
    }

    /// Distance of two answers' pressures, as a share of the second's.
    fn apart(a: &[f64], b: &[f64]) -> f64 {
        let of = |x: &[f64]| -> Vec<f64> { x.chunks_exact(LOAD_WIDTH).map(|row| row[0]).collect() };
        let (a, b) = (of(a), of(b));
        let difference: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a - b).collect();
        norm(&difference) / norm(&b)
    }

    #[test]
    fn groups_of_one_change_nothing() {
        let motion = |p: &mesh::Point| (9.0 * p[0]).sin() * p[1];
        assert_eq!(thrown(CELLS * CELLS, motion), thrown(usize::MAX, motion));
    }

    #[test]
    fn groups_feel_the_air_of_rigid_motions() {
        let last = CELLS * CELLS * LOAD_WIDTH;
        for (name, motion) in [
            ("plunge", (|_: &mesh::Point| 1.0) as fn(&mesh::Point) -> f64),
            ("tilt", |p: &mesh::Point| p[0] - 0.5),
        ] {
            let exact = thrown(usize::MAX, motion);
            for most in [CELLS * CELLS / 2, CELLS * CELLS / 4, CELLS * CELLS / 8] {
                let grouped = thrown(most, motion);
                let (force, apart) = (grouped[last] / exact[last] - 1.0, apart(&grouped, &exact));
                println!("{name}, {most} groups: force {force:+.3}, pressures {apart:.3}");
                // Pressures change like a root at the edges, over a part of a group there.
                assert!(apart < 0.2, "{name}, {most} groups: {apart}");
                assert!(name == "tilt" || force.abs() < 0.12, "{most} groups: {force}");
            }
        }
    }

    #[test]
    fn what_groups_do_not_see_has_the_mass_of_short_waves() {
        // Neighbours to and fro: groups of four see nothing of it, and their faces feel the air of a wave of
        // twice their own length, 2 rho / k = H / pi, where it is truly sqrt(2) shorter.
        let checks = |p: &mesh::Point| ((p[0] + p[1]) * CELLS as f64 * std::f64::consts::FRAC_PI_2).sin();
        let (exact, grouped) = (thrown(usize::MAX, checks), thrown(CELLS * CELLS / 4, checks));
        let apart = apart(&grouped, &exact);
        println!("short waves: {apart:.3}");
        assert!(apart < 0.6, "{apart}");
    }

    /// Air in a closed volume answers a tiny step steeply: that is learnt, where it stands out of the flow's noise. What a
    /// tiny step leaves of a gentle answer is not.
    #[test]
    fn of_tiny_steps_only_steep_answers_are_learnt() {
        let (positions, faces) = plate(4);
        let unknowns = Unknowns::new(positions.len(), 1.0, false);
        let rest = vec![0.0; 3 * positions.len()];
        let lattice = Lattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let air = Air::incompressible(1.0);
        let (least, load, step) = (1e-3, 10.0, 1e-4);
        for (slope, learnt) in [(0.5, 0), (0.9 * STEEP, 0), (1.1 * STEEP, 0), (50.0, 1)] {
            let mut model =
                FlowModel::new(unknowns, &lattice, &rest, 0.0, &faces, air, usize::MAX).expect("a plate");
            let along = |length: f64| {
                let mut vector = vec![0.0; model.answers()];
                vector[0] = length;
                vector
            };
            let (once, twice, changed) = (along(step), along(2.0 * step), along(slope * step));
            model.learn(once, changed, least, load);
            assert_eq!(model.secants(), learnt, "slope {slope}");
            let mut answer = vec![0.0; model.answers()];
            model.correct(&twice, &mut answer);
            let wanted = if learnt == 1 { 2.0 * slope * step } else { 0.0 };
            assert!((answer[0] - wanted).abs() < 1e-12, "slope {slope}: {}", answer[0]);
        }
    }

    /// The first window has the first difference; from then on parabolas are exact over unequal windows.
    #[test]
    fn velocities_of_a_parabola_and_positions_from_a_bent_start() {
        let (positions, faces) = plate(4);
        let unknowns = Unknowns::new(positions.len(), 1.0, false);
        let start: Vec<f64> = (0..3 * positions.len()).map(|i| 0.1 * (i as f64).sin()).collect();
        let lattice = Lattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let air = Air::incompressible(1.0);
        let mut model =
            FlowModel::new(unknowns, &lattice, &start, 0.0, &faces, air, usize::MAX).expect("a plate");
        let at = |t: f64| -> Vec<f64> {
            start.iter().enumerate().map(|(i, s)| s + (1.0 + i as f64) * t - 2.0 * t * t).collect()
        };
        let compare = |found: Vec<f64>, wanted: &dyn Fn(usize) -> f64| {
            for (i, f) in found.iter().enumerate() {
                assert!((f - wanted(i)).abs() < 1e-11, "{i}: {f} {}", wanted(i));
            }
        };
        compare(model.velocities(&at(0.5), 0.5), &|i| 1.0 + i as f64 - 2.0 * 0.5);
        model.accept(&at(0.5), 0.5);
        compare(model.velocities(&at(0.9), 0.4), &|i| 1.0 + i as f64 - 4.0 * 0.9);
        compare(model.velocities(&at(1.4), 0.9), &|i| 1.0 + i as f64 - 4.0 * 1.4);
        let moved = model.positions(&at(0.5));
        compare(moved.iter().flatten().copied().collect(), &|i| {
            positions[i / 3][i % 3] + 0.5 * (1.0 + i as f64) - 0.5
        });
    }
}
