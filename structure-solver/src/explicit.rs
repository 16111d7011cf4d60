//! Explicit time integration: central differences on a lumped mass.
//!
//! Velocity form of the central differences, with mass damping $`c`$ and $`f`$ the forces
//! per mass (Belytschko, Liu and Moran, Nonlinear Finite Elements, section 6.2):
//!
//! ```math
//! v_{1/2} = \frac{v_0 + \frac h2 f_0}{1 + \frac h2 c},\quad u_1 = u_0 + h\,v_{1/2},\quad
//!   v_1 = (1 - \tfrac h2 c)\,v_{1/2} + \tfrac h2 f_1
//! ```
//!
//! Second order, no equations to solve, no numerical damping: where fabric snaps between
//! slack and taut nothing has to converge. Stable for $`h < 2/\omega`$ with $`\omega`$ the
//! highest circular frequency of the discrete structure.
//!
//! That frequency is computed, not estimated from edge lengths: power iteration on
//! $`M^{-1}K`$ with $`K`$ the assembled stiffness of the structure blown up a little in all
//! directions, where every membrane and line is taut. Fabric in wrinkles or slack is no
//! stiffer: the relaxed energy of a tension field is a minimum over the wrinkling strain of
//! the taut energy, and a minimum of functions has at most the curvature of the lowest of them.
//! Strain stiffens: a stretched element has $`K \le (1 + 3E)K_0`$ for the largest principal
//! Green strain $`E`$, as its gradient grows with $`1 + 2E`$ and its stress adds $`E`$; so the
//! step is estimated again for each window.
//!
//! Stresses by the rate of strains ([`crate::materials::Viscous`]) take the strains of the step before: stable for
//! $`h^2 \omega^2 + 2 h c < 4`$ with the largest eigenvalue $`c`$ of $`M^{-1}C`$, $`C`$ their tangent by the velocity. For a retardation time $`\tau`$ of
//! the stiffest part that is $`h < \sqrt{\tau^2 + 4 / \omega^2} - \tau`$.

use channel::first_not_finite;
use comm::Comm;
use linalg::Operator;
use mesh::geometry::Vec3;

use crate::dynamics::{Dynamics, Interval, LoadPath, blend};
use crate::elements::membrane;
use crate::failure_site::principal;
use crate::flat::at;
use crate::loops::{Configuration, FaceLoad};
use crate::model::Model;
use crate::newton::{NewtonError, NewtonInfo, State, Stop, sum_of_nodes};
use crate::payload::Payload;
use crate::rigid::BodyState;
use crate::system::System;

/// Expansion of the structure whose stiffness bounds the step.
const EXPANSION: f64 = 1e-6;
/// Green strain beyond which the motion has left all sense: no fabric is stretched tenfold.
const TORN: f64 = 50.0;
/// Step relative to the retardation time in which the elastic stiffness does not count.
const SHORT: f64 = 1e-3;
/// Rounds of the power iteration: it comes within a few percent from below, which
/// [`Explicit::safety`] covers together with growing strains.
const ROUNDS: usize = 60;

/// A structure that cannot be integrated explicitly.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ExplicitError {
    /// A node with no mass.
    #[error(
        "node {node} has no mass, so explicit time integration cannot move it: \
         give its elements a density, add a [[point_mass]], or use structure.integration = \"implicit\""
    )]
    Massless {
        /// Node (global).
        node: u64,
    },
    /// No stiffness at all, or NaN.
    #[error(
        "the estimated highest frequency of the structure is {0} rad/s, which is not valid: check moduli, thickness and mass"
    )]
    Frequency(f64),
}

/// What explicit steps keep.
pub struct Explicit {
    /// Inverse masses of owned components, 1/kg; zero where constrained.
    inverse_mass: Vec<f64>,
    /// Highest circular frequency of the taut structure without strain, rad/s.
    pub frequency: f64,
    /// Largest eigenvalue of the damping by rates of strains, 1/s.
    damping_rate: f64,
    /// Share of the largest stable step that is taken.
    pub safety: f64,
    /// Residual forces, N.
    force: Vec<f64>,
    /// Acceleration on every mass of owned components, m/s2; zero where constrained.
    body: Vec<f64>,
    /// That of free masses, m/s2.
    body_of: [f64; 3],
    /// Half-step velocities of local components, m/s.
    half: Vec<f64>,
    /// Positions at the start of a step, m; empty without stresses by rates.
    before: Vec<f64>,
    /// `force` belongs to the current state and the load there.
    known: bool,
    /// Largest stable step at the last check, s.
    stable: f64,
    /// Impulse of the external forces on the owned nodes in the last substep, N s.
    pub(crate) applied_impulse: Vec3,
    /// Energy that stresses by rates took in the last substep on this rank, J.
    taken: f64,
    /// Evaluations of the forces since the start.
    pub evaluations: u64,
}

impl Explicit {
    /// For `system`, whose mass is lumped and whose constraints do not change any more.
    /// Collective.
    ///
    /// # Errors
    /// [`ExplicitError`].
    pub fn new(system: &mut System, safety: f64) -> Result<Self, ExplicitError> {
        let model = &system.model;
        let inverse_mass: Vec<f64> = (0..3 * model.n_owned())
            .map(|i| if model.fixed[i] { 0.0 } else { 1.0 / system.lumped_mass(i / 3) })
            .collect();
        let massless = inverse_mass.iter().position(|m| !m.is_finite());
        if let Some(node) = first_node(&model.comm, massless.map(|i| model.numbering.owned()[i / 3])) {
            return Err(ExplicitError::Massless { node });
        }
        let frequency = highest_frequency(system, &inverse_mass);
        if !(frequency.is_finite() && frequency > 0.0) {
            return Err(ExplicitError::Frequency(frequency));
        }
        let damping_rate = damping_rate(system, &inverse_mass);
        let n = 3 * system.model.n_local();
        Ok(Self {
            body: vec![0.0; inverse_mass.len()],
            body_of: [0.0; 3],
            inverse_mass,
            frequency,
            damping_rate,
            safety,
            force: vec![0.0; n],
            half: vec![0.0; n],
            before: vec![0.0; if damping_rate > 0.0 { n } else { 0 }],
            known: false,
            stable: 0.0,
            applied_impulse: Vec3::zeros(),
            taken: 0.0,
            evaluations: 0,
        })
    }

    /// Largest stable step of the structure without strain, s.
    pub fn stable_step(&self) -> f64 {
        self.stable_step_at(0.0)
    }

    /// As [`Explicit::stable_step`] where the largest principal Green strain is `strain`.
    fn stable_step_at(&self, strain: f64) -> f64 {
        let stiffer = 1.0 + 3.0 * strain;
        let (square, rate) = (stiffer * self.frequency.powi(2), stiffer * self.damping_rate);
        4.0 / (rate + (rate * rate + 4.0 * square).sqrt())
    }

    /// Energy that stresses by rates took in the last substep on this rank, J; `None` where it is that of the mean rate.
    pub(crate) fn taken(&self) -> Option<f64> {
        (self.damping_rate > 0.0).then_some(self.taken)
    }

    /// The forces must be recomputed: the load or the state has changed.
    pub(crate) fn forget(&mut self) {
        self.known = false;
    }

    /// Keeps the acceleration `body` (m/s2) on every mass.
    fn set_body(&mut self, body: [f64; 3]) {
        if std::mem::replace(&mut self.body_of, body) == body {
            return;
        }
        let components = self.body.iter_mut().zip(&self.inverse_mass).enumerate();
        components.for_each(|(i, (b, m))| *b = if *m > 0.0 { body[i % 3] } else { 0.0 });
    }

    /// Accelerations of the owned components without damping, m/s2; zero where constrained.
    #[inline(always)]
    fn accelerations(&self) -> impl Iterator<Item = f64> {
        self.body.iter().zip(&self.inverse_mass).zip(&self.force).map(|((b, m), f)| b - m * f)
    }
}

/// The lowest of the nodes that ranks name.
fn first_node(comm: &Comm, node: Option<u64>) -> Option<u64> {
    let first = comm.min(node.map_or(f64::INFINITY, |n| n as f64));
    first.is_finite().then_some(first as u64)
}

/// Largest principal Green strain of membranes and lines with nodes at `x` (m); zero
/// where all is slack. Collective.
fn largest_strain(model: &Model, x: &[f64]) -> f64 {
    model.comm.max(strains(model, x).map(|(_, e)| finite(e)).fold(0.0, f64::max))
}

/// A node (global) of the most strained element. Collective.
fn most_strained(model: &Model, x: &[f64]) -> u64 {
    let largest = largest_strain(model, x);
    let here = strains(model, x).find(|(n, e)| finite(*e) >= largest && (*n as usize) < model.n_owned());
    first_node(&model.comm, here.map(|(n, _)| model.numbering.owned()[n as usize])).unwrap_or(0)
}

fn finite(strain: f64) -> f64 {
    if strain.is_nan() { f64::INFINITY } else { strain }
}

/// First node and largest principal Green strain of each membrane and line.
fn strains(model: &Model, x: &[f64]) -> impl Iterator<Item = (u32, f64)> {
    let fabric = model.triangles.iter().map(|t| {
        let p = t.nodes.map(|n| at(x, n as usize));
        (t.nodes[0], principal(membrane::deformation(&t.reference.gradient, &p).strain)[0])
    });
    let lines = model.cables.iter().map(|c| {
        let l = (at(x, c.nodes[1] as usize) - at(x, c.nodes[0] as usize)).norm() / c.rest_length;
        (c.nodes[0], 0.5 * (l * l - 1.0))
    });
    fabric.chain(lines)
}

/// Highest circular frequency, rad/s, of the taut structure. Collective.
fn highest_frequency(system: &mut System, inverse_mass: &[f64]) -> f64 {
    largest_eigenvalue(system, inverse_mass, f64::INFINITY).sqrt()
}

/// Largest eigenvalue of the damping by rates of strains, 1/s; 0 where there is none. Collective.
fn damping_rate(system: &mut System, inverse_mass: &[f64]) -> f64 {
    let time = system.retardation_time();
    if time == 0.0 {
        return 0.0;
    }
    // In so short a step the tangent is that of the rates alone.
    let dt = SHORT * time;
    dt * largest_eigenvalue(system, inverse_mass, dt)
}

/// Largest eigenvalue of $`M^{-1}K`$, 1/s2, of the taut structure in a step of `dt` seconds. Collective.
fn largest_eigenvalue(system: &mut System, inverse_mass: &[f64], dt: f64) -> f64 {
    let n = 3 * system.model.n_local();
    let x: Vec<f64> =
        system.model.reference.iter().map(|x| x * system.model.tautening * (1.0 + EXPANSION)).collect();
    let zero = vec![0.0; system.model.n_faces];
    let load = FaceLoad { pressure: &zero, traction: &[] };
    let mut work = vec![0.0; n];
    system.set_step(dt);
    // At rest there.
    system.anchor_rates(&x);
    // A reefing line is stiffest drawn in.
    system.set_time(f64::INFINITY);
    system.tangent(Configuration::only(&x), load, 1.0, 0.0, &mut work);
    // Any start with a share of the highest mode will do: alternating signs, which are
    // the same whatever the partition.
    let model = &system.model;
    let mut v = vec![0.0; n];
    for (row, &global) in v.as_chunks_mut::<3>().0.iter_mut().zip(model.numbering.owned()) {
        let mix = (global.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as f64 / f64::from(1u32 << 24) - 0.5;
        *row = [mix, 0.7 * mix.signum() - mix, 0.5 - mix * mix];
    }
    let comm = &model.comm;
    let mut square = 0.0;
    for _ in 0..ROUNDS {
        // In the norm of the mass: |v|^2 = v.M v, and M^{-1}K is symmetric in it.
        let norm: f64 = v.iter().zip(inverse_mass).filter(|(_, m)| **m > 0.0).map(|(v, m)| v * v / m).sum();
        let norm = comm.sum(norm).sqrt();
        for (v, m) in v.iter_mut().zip(inverse_mass) {
            *v = if *m > 0.0 { *v / norm } else { 0.0 };
        }
        system.matrix.apply(&mut v, &mut work);
        for (w, m) in work.iter_mut().zip(inverse_mass) {
            *w *= m;
        }
        let rayleigh: f64 =
            work.iter().zip(inverse_mass).filter(|(_, m)| **m > 0.0).map(|(w, m)| w * w / m).sum();
        square = comm.sum(rayleigh).sqrt();
        std::mem::swap(&mut v, &mut work);
    }
    square
}

/// One of the equal steps of a substep.
#[derive(Clone, Copy)]
struct CentralStep {
    /// Length, s.
    h: f64,
    /// `h c / 2` with the mass damping `c`.
    slowing: f64,
    /// Share of the window at its end.
    share: f64,
    /// Time at its end, s since the start of the stage.
    time: f64,
    /// Acceleration on every mass, m/s2.
    body: [f64; 3],
}

/// A rigid payload on its way, taken out of the dynamics.
type Carried = Option<(Payload, BodyState)>;

impl Dynamics {
    /// Advances `current` by `part` of the window into `next`, in as many equal explicit
    /// steps as stability asks for. Collective.
    pub(crate) fn explicit_step(&mut self, part: Interval<'_>) -> Result<NewtonInfo, NewtonError> {
        let _part = timing::part("explicit steps");
        let mut e = self.explicit.take().expect("the caller has seen it");
        let reactions = self.reactions.clone();
        let result = self.explicit_steps(&mut e, part);
        if result.is_err() {
            e.forget();
            self.reactions = reactions;
        }
        self.explicit = Some(e);
        result
    }

    fn explicit_steps(&mut self, e: &mut Explicit, part: Interval<'_>) -> Result<NewtonInfo, NewtonError> {
        self.next.copy_motion_from(&self.current);
        let Self { system, x, next, .. } = self;
        for ((x, reference), u) in x.iter_mut().zip(&system.model.reference).zip(&next.u) {
            *x = reference + u;
        }
        if !e.known {
            self.start_explicit(e, part)?;
        }
        let Interval { span, window, load, body } = part;
        let count = (part.dt() / (e.safety * e.stable)).ceil().clamp(1.0, 1e9);
        let (owned, h) = (e.inverse_mass.len(), part.dt() / count);
        let mut carried = self.payload.take().zip(self.next.body);
        self.system.set_step(h);
        e.set_body(body);
        (e.applied_impulse, e.taken) = (Vec3::zeros(), 0.0);
        let mut applied = -sum_of_nodes(&e.force[..owned]);
        for k in 1..=count as u64 {
            let share = span[0] + (span[1] - span[0]) * k as f64 / count;
            let time = self.time + share * window;
            let step = CentralStep { h, slowing: 0.5 * h * self.damping, share, time, body };
            self.begin_central_step(e, &step);
            self.add_reactions(e, h);
            self.move_nodes(e, &step, &mut carried);
            self.explicit_forces(e, step.share, load);
            self.add_reactions(e, h);
            self.add_taken(e);
            let before = std::mem::replace(&mut applied, -sum_of_nodes(&e.force[..owned]));
            e.applied_impulse += (before + applied) * (0.5 * h);
            self.kick_nodes(e, &step, &mut carried);
        }
        self.end_explicit(e, part, carried);
        self.add_explicit_inertia(part.dt(), body);
        self.finite(owned, count as u32)?;
        for field in [&mut self.next.u, &mut self.next.v, &mut self.next.a] {
            self.system.model.halo.exchange(field, 3);
        }
        e.known = true;
        Ok(NewtonInfo { steps: count as u32, residual: 0.0, stop: Stop::Residual })
    }

    /// Finds the largest stable step at the strains of the start, and the forces there.
    fn start_explicit(&mut self, e: &mut Explicit, part: Interval<'_>) -> Result<(), NewtonError> {
        let strain = largest_strain(&self.system.model, &self.x);
        if strain.is_nan() || strain > TORN {
            // The element is named with the failure, and the first node stands for it.
            let node = most_strained(&self.system.model, &self.x);
            return Err(NewtonError::NotFinite { steps: 0, node });
        }
        e.stable = e.stable_step_at(strain);
        if self.system.depends_on_rate() {
            // Where the nodes would come from at their velocities: in a step, where strains count.
            let dt = if e.damping_rate > 0.0 { part.dt().min(e.safety * e.stable) } else { part.dt() };
            self.system.set_step(dt);
            for i in 0..self.x.len() {
                e.half[i] = self.x[i] - dt * self.next.v[i];
            }
            self.system.anchor_rates(&e.half);
        }
        self.system.set_time(self.time + part.span[0] * part.window);
        self.system.advance_history(&self.x);
        self.explicit_forces(e, part.span[0], part.load);
        Ok(())
    }

    /// Sets place and time of the start of a step in the elements.
    fn begin_central_step(&mut self, e: &mut Explicit, step: &CentralStep) {
        if e.damping_rate > 0.0 {
            e.before.copy_from_slice(&self.x);
        }
        if self.system.depends_on_rate() {
            self.system.anchor_rates(&self.x);
        }
        self.system.set_time(step.time);
        self.system.advance_history(&self.x);
    }

    /// First half of a step: velocities in its middle into `e.half`, displacements and positions
    /// at its end; prescribed motions and the payload's attachments go where they must.
    fn move_nodes(&mut self, e: &mut Explicit, step: &CentralStep, carried: &mut Carried) {
        let CentralStep { h, slowing, body, .. } = *step;
        let owned = e.inverse_mass.len();
        let State { u, v, .. } = &mut self.next;
        let mut half = std::mem::take(&mut e.half);
        for (((half, u), v), a) in half.iter_mut().zip(&mut *u).zip(&*v).zip(e.accelerations()) {
            *half = (v + 0.5 * h * a) / (1.0 + slowing);
            *u += h * *half;
        }
        e.half = half;
        for (i, moved) in self.motions.iter().flat_map(|m| m.values(step.time)) {
            let i = i as usize;
            if i < owned {
                e.half[i] = (moved - (self.x[i] - self.system.model.reference[i])) / h;
                u[i] = moved;
            }
        }
        if let Some((p, s)) = carried {
            p.advance(s, body.into(), h);
            for (n, x) in p.places(s).filter(|(n, _)| 3 * n < owned) {
                for (i, x) in (3 * n..).zip(&x) {
                    e.half[i] = (x - self.x[i]) / h;
                    u[i] = x - self.system.model.reference[i];
                }
            }
        }
        for ((x, reference), u) in self.x[..owned].iter_mut().zip(&self.system.model.reference).zip(&*u) {
            *x = reference + u;
        }
        self.system.model.halo.exchange(&mut self.x, 3);
    }

    /// Adds the energy that stresses by rates took in a step.
    fn add_taken(&mut self, e: &mut Explicit) {
        if e.damping_rate > 0.0 {
            e.taken += self.system.dissipation(&e.before, &self.x);
        }
    }

    /// Adds half of a step of `h` seconds under the forces at the positions now to the reactions.
    fn add_reactions(&mut self, e: &Explicit, h: f64) {
        if let Some(r) = &mut self.reactions {
            r.add(&e.force, &self.x, &self.system.model.fixed, 0.5 * h);
        }
    }

    /// Second half of a step: the forces at its end give the velocities there.
    fn kick_nodes(&mut self, e: &Explicit, step: &CentralStep, carried: &mut Carried) {
        let CentralStep { h, slowing, body, .. } = *step;
        let owned = e.inverse_mass.len();
        if let Some((p, s)) = carried {
            let system = &self.system;
            let pull = |n: usize| {
                let m = system.diagonal_mass(n);
                Vec3::from_fn(|c, _| m * body[c] - e.force[3 * n + c])
            };
            p.finish(s, system.comm(), owned / 3, pull, body.into(), h);
        }
        for ((v, half), a) in self.next.v.iter_mut().zip(&e.half).zip(e.accelerations()) {
            *v = (1.0 - slowing) * half + 0.5 * h * a;
        }
    }

    /// Velocities of what moves as prescribed, the payload's state, rates over the whole substep
    /// and accelerations at its end.
    fn end_explicit(&mut self, e: &mut Explicit, part: Interval<'_>, carried: Carried) {
        let owned = e.inverse_mass.len();
        // What moves as prescribed has the velocity of its last step.
        for &i in self.motions.iter().flat_map(|m| &m.dofs).filter(|i| (**i as usize) < owned) {
            self.next.v[i as usize] = e.half[i as usize];
        }
        if let Some((p, s)) = carried {
            for (n, _) in p.places(&s).filter(|(n, _)| 3 * n < owned) {
                self.next.v[3 * n..3 * n + 3].copy_from_slice(&e.half[3 * n..3 * n + 3]);
            }
            self.next.body = Some(s);
            self.payload = Some(p);
        }
        if self.system.depends_on_rate() {
            // Dissipation and work of the whole substep are those of its mean velocity.
            self.system.set_step(part.dt());
            for i in 0..self.x.len() {
                e.half[i] = self.system.model.reference[i] + self.current.u[i];
            }
            self.system.anchor_rates(&e.half);
        }
        for ((a, v), free) in self.next.a.iter_mut().zip(&self.next.v).zip(e.accelerations()) {
            *a = free - self.damping * v;
        }
    }

    fn explicit_forces(&mut self, e: &mut Explicit, share: f64, load: LoadPath<'_>) {
        blend(load, share, &mut self.pressure, &mut self.traction);
        let load = FaceLoad { pressure: &self.pressure, traction: &self.traction };
        self.system.forces(Configuration::only(&self.x), load, &mut e.force);
        e.evaluations += 1;
    }

    /// NaN and infinity are noticed on all ranks.
    fn finite(&self, owned: usize, steps: u32) -> Result<(), NewtonError> {
        let model = &self.system.model;
        let bad = [&self.next.u, &self.next.v].map(|field| first_not_finite(&field[..owned]));
        let bad = bad.into_iter().flatten().min();
        match first_node(&model.comm, bad.map(|i| model.numbering.owned()[i / 3])) {
            Some(node) => Err(NewtonError::NotFinite { steps, node }),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use mesh::{Cable, CableKind, StructureMesh};

    use super::*;

    /// A triangle and a line twice as long as at rest: each has the largest strain of its own map.
    #[test]
    fn strains_have_their_closed_forms() {
        let mesh = StructureMesh {
            coords: vec![[0.0; 3], [2.0, 0.0, 0.0], [0.5, 1.5, 0.0], [0.0, 0.0, 3.0]],
            n_canopy: 3,
            faces: vec![[0, 1, 2, 2]],
            face_panel: vec![0],
            triangles: vec![[0, 1, 2]],
            triangle_face: vec![0],
            cables: vec![Cable {
                nodes: [3, 0],
                rest_length: 1.5,
                kind: CableKind::Riser,
                line: 0,
                share: 1.0,
                group: None,
            }],
            ..Default::default()
        };
        let model = Model::new(&Comm::solo(), &mesh, &[0; 4]).expect("a good mesh");
        let mut x = model.reference.clone();
        (0..3).for_each(|n| x[3 * n] *= 1.2);
        let found: Vec<_> = strains(&model, &x).collect();
        assert!(found[0].0 == 0 && (found[0].1 - 0.22).abs() < 1e-14, "{found:?}");
        assert!(found[1].0 == 3 && (found[1].1 - 1.5).abs() < 1e-14, "{found:?}");
        assert_eq!((largest_strain(&model, &x), most_strained(&model, &x)), (found[1].1, 3));
        // Slack lines do not count.
        x[11] = 0.1;
        assert_eq!((largest_strain(&model, &x), most_strained(&model, &x)), (found[0].1, 0));
    }
}
