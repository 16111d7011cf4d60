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

use std::collections::VecDeque;

use channel::LOAD_WIDTH;
use mesh::Vec3;
use serde::{Deserialize, Serialize};

use super::Unknowns;
use super::inverse::{Inverse, factors};
use super::lattice::{Lattice, distinct, dot};
use super::least_squares::{Columns, axpy, norm};
use super::memory::{pack, unpack};
use super::relaxation::MOST_FACES;
use crate::error::RunError;

/// Secants kept.
const MOST_SECANTS: usize = 40;
/// A secant is dropped when less than this share of its motion is new.
const FILTER: f64 = 3e-2;

/// The canopy at the end of a window: displacement and velocity relative to the ground, `[nodes][3]`.
#[derive(Serialize, Deserialize)]
struct Wall {
    displacement: Vec<f64>,
    velocity: Vec<f64>,
}

/// The model of the flow's answer: loads `[faces][LOAD_WIDTH]`, then the vertical force.
pub struct FlowModel {
    unknowns: Unknowns,
    faces: Vec<[u32; 4]>,
    normals: Vec<Vec3>,
    /// Vertical areas of the faces, m2.
    areas: Vec<f64>,
    density: f64,
    /// Of the influence.
    inverse: Inverse,
    /// Newest first.
    walls: VecDeque<Wall>,
    /// Length of the last window, s; 0 before it.
    dt: f64,
    secants: VecDeque<[Vec<f64>; 2]>,
    columns: Columns,
}

impl FlowModel {
    /// For a canopy at `positions` (m) at rest in a frame that moves with `velocity` (m/s), in air of
    /// `density` (kg/m3). `None` where the faces are too many or make no sensible matrix.
    pub fn new(
        unknowns: Unknowns,
        positions: &[Vec3],
        displacement: &[f64],
        velocity: f64,
        faces: &[[u32; 4]],
        density: f64,
    ) -> Option<Self> {
        if faces.is_empty() || faces.len() > MOST_FACES {
            return None;
        }
        let Lattice { areas, normals, influence } = Lattice::new(positions, faces);
        let inverse = Inverse::of(&factors(&influence))?;
        let at_rest = [0.0, 0.0, velocity].repeat(positions.len());
        let walls = VecDeque::from([Wall { displacement: displacement.to_vec(), velocity: at_rest }]);
        Some(Self {
            unknowns,
            faces: faces.to_vec(),
            normals,
            areas: areas.iter().map(|a| a[2]).collect(),
            density,
            inverse,
            walls,
            dt: 0.0,
            secants: VecDeque::new(),
            columns: Columns::default(),
        })
    }

    /// The same with another density: more air makes schemes that rely on the model alone safer.
    pub fn with_density(self, density: f64) -> Self {
        Self { density, ..self }
    }

    /// Numbers in an answer.
    pub fn answers(&self) -> usize {
        self.faces.len() * LOAD_WIDTH + 1
    }

    /// Coefficients of the backward difference in a window of length `dt`, as the flow takes it; `None`: first
    /// order.
    fn difference(&self, dt: f64) -> Option<[f64; 3]> {
        if self.walls.len() < 2 { None } else { backward(dt / self.dt) }
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
        let v = self.velocities(x, dt);
        let past = |k: usize| &self.walls[k].velocity;
        let difference = self.difference(dt);
        let rate = |i: usize| match difference {
            Some([a, b, c]) => (a * v[i] + b * past(0)[i] + c * past(1)[i]) / dt,
            None => (v[i] - past(0)[i]) / dt,
        };
        let accelerations = self.faces.iter().zip(&self.normals).map(|(face, normal)| {
            let nodes = distinct(face);
            let sum: f64 =
                nodes.iter().map(|&n| dot(std::array::from_fn(|i| rate(3 * n as usize + i)), *normal)).sum();
            sum / nodes.len() as f64
        });
        let jump = self.inverse.apply(&accelerations.collect::<Vec<f64>>());
        answer.fill(0.0);
        let mut force = 0.0;
        for ((row, jump), area) in answer.chunks_exact_mut(LOAD_WIDTH).zip(&jump).zip(&self.areas) {
            row[0] = -self.density * jump;
            force += area * row[0];
        }
        answer[self.faces.len() * LOAD_WIDTH] = force;
    }

    /// Learns that where [`FlowModel::inertia`] changed by `step` within a window, the remainder of the flow's
    /// answer changed by `change`: what the model gets wrong, as a function of its own load. That
    /// load knows nothing of what moves no air, and is to the flow's own as one to nearly one.
    pub fn learn(&mut self, step: Vec<f64>, change: Vec<f64>) {
        if norm(&step) == 0.0 {
            return;
        }
        self.secants.push_front([step, change]);
        self.secants.truncate(MOST_SECANTS);
        self.refactor();
    }

    /// Adds to `answer` how the secants change the remainder where the inertia changes by `step`.
    pub fn correct(&self, step: &[f64], answer: &mut [f64]) {
        let mut rest = step.to_vec();
        for (c, [_, change]) in self.columns.remove(&mut rest).iter().zip(&self.secants) {
            axpy(-c, change, answer);
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

    /// What later windows depend on.
    pub fn memory(&self) -> Vec<u8> {
        pack(&(&self.walls, self.dt, &self.secants))
    }

    /// Goes on from a [`FlowModel::memory`] of the same canopy.
    ///
    /// # Errors
    /// A memory of something else.
    pub fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        (self.walls, self.dt, self.secants) = unpack(memory)?;
        // What was kept before is kept again, and gives the same factors.
        self.refactor();
        Ok(())
    }

    fn refactor(&mut self) {
        self.columns = Columns::default();
        let columns = &mut self.columns;
        self.secants.retain(|[step, _]| columns.push(step, FILTER));
    }
}

/// Coefficients $(1 + 2r)/(1 + r)$, $-(1 + r)$, $r^2/(1 + r)$ of the second-order backward difference for a window
/// `ratio` times as long as the one before it; `None` beyond 2.4, as flow and mesh have it.
fn backward(ratio: f64) -> Option<[f64; 3]> {
    let share = ratio / (1.0 + ratio);
    let (a, c) = (1.0 + share, ratio * share);
    (ratio > 0.0 && ratio <= 2.4).then_some([a, -(a + c), c])
}
