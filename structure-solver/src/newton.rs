//! Newton's method with a line search for one implicit time step.

use mesh::geometry::Vec3;
use std::time::Instant;

use crate::elimination::Elimination;
use crate::linear::LinearSolver;
use crate::loops::{Configuration, FaceLoad};
use crate::rigid::BodyState;
use crate::scheme::StepForm;
use crate::system::System;

/// Displacements (m), velocities (m/s) and accelerations (m/s2) of a rank's
/// nodes, shape `[n_local][3]` with current ghosts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    /// Displacements from the unstressed positions.
    pub u: Vec<f64>,
    /// Velocities.
    pub v: Vec<f64>,
    /// Accelerations.
    pub a: Vec<f64>,
    /// A rigid payload; `None` where there is none.
    pub body: Option<BodyState>,
}

impl State {
    /// At rest in the unstressed positions.
    pub fn rest(n_local: usize) -> Self {
        let zero = || vec![0.0; 3 * n_local];
        Self { u: zero(), v: zero(), a: zero(), body: None }
    }

    /// Copies without allocating.
    pub fn copy_from(&mut self, other: &State) {
        self.copy_motion_from(other);
        self.a.copy_from_slice(&other.a);
    }

    /// As [`State::copy_from`], but for the accelerations.
    pub(crate) fn copy_motion_from(&mut self, other: &State) {
        self.u.copy_from_slice(&other.u);
        self.v.copy_from_slice(&other.v);
        self.body = other.body;
    }
}

/// Limits of Newton's method.
#[derive(Clone, Copy, Debug)]
pub struct NewtonParams {
    /// Stops when the residual is below this share of the load.
    pub tolerance: f64,
    /// Stops when no component of a correction exceeds this, m: rounding.
    pub smallest_correction: f64,
    /// Newton steps before the time step fails.
    pub max_steps: u32,
}

/// Which test ended the iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The residual fell below its share of the load.
    Residual,
    /// The correction vanished in rounding.
    Correction,
}

/// How a time step converged.
#[derive(Clone, Copy, Debug)]
pub struct NewtonInfo {
    /// Newton steps.
    pub steps: u32,
    /// Residual relative to the load.
    pub residual: f64,
    /// Which test ended the iteration.
    pub stop: Stop,
}

/// Why a time step failed.
#[derive(Clone, Debug, thiserror::Error)]
pub enum NewtonError {
    /// Too many Newton steps.
    #[error(
        "Newton's method did not converge in {steps} steps: residual {residual:.2e} relative to the load, largest at node {node}"
    )]
    NotConverged {
        /// Newton steps.
        steps: u32,
        /// Residual relative to the load.
        residual: f64,
        /// Node (global) with the largest residual.
        node: u64,
    },
    /// NaN or infinity.
    #[error("forces became NaN or infinite after {steps} Newton steps, first at node {node}")]
    NotFinite {
        /// Newton steps.
        steps: u32,
        /// Node (global) where it was seen.
        node: u64,
    },
    /// The linear solver failed.
    #[error(
        "the linear system of Newton step {steps} was not solved (largest residual at node {node}): {cause}"
    )]
    Linear {
        /// Newton steps.
        steps: u32,
        /// Node (global) with the largest residual.
        node: u64,
        /// Message of the solver.
        cause: String,
    },
}

impl NewtonError {
    /// Node (global) that it names.
    pub fn node(&self) -> u64 {
        match self {
            Self::NotConverged { node, .. } | Self::NotFinite { node, .. } | Self::Linear { node, .. } => {
                *node
            }
        }
    }

    /// Newton steps that were spent.
    pub fn steps(&self) -> u32 {
        match self {
            Self::NotConverged { steps, .. } | Self::NotFinite { steps, .. } | Self::Linear { steps, .. } => {
                *steps
            }
        }
    }
}

/// Residual evaluations in one line search at most.
const SEARCHES: usize = 6;
/// A line search ends when the slope has fallen to this share.
const SLOPE: f64 = 0.5;

/// Newton's method with its workspace.
pub struct Newton {
    params: NewtonParams,
    /// Unknown displacements.
    u: Vec<f64>,
    /// Positions at the point of balance.
    x: Vec<f64>,
    /// Positions at the end of the step.
    end: Vec<f64>,
    /// Inertia per mass.
    w: Vec<f64>,
    /// Part of `w` that the old state gives.
    w0: Vec<f64>,
    g: Vec<f64>,
    rhs: Vec<f64>,
    du: Vec<f64>,
    /// Start of a line search, and the best start of a step.
    base: Vec<f64>,
    elimination: Elimination,
    /// How much looser than their least tolerance linear solves may be.
    slack: f64,
    /// Evaluations of the residual in line searches.
    pub evaluations: u64,
    /// Seconds in element loops.
    pub assembly_s: f64,
    /// Seconds in solves for eliminated nodes.
    pub elimination_s: f64,
    /// Residuals of the last step relative to the load, for tests and reports.
    pub history: Vec<f64>,
    /// External force on the owned nodes at the last evaluation, N: internal forces cancel in the sum over all ranks.
    pub(crate) applied: Vec3,
}

/// The equation that a time step solves: balance of forces at a point of the step.
pub struct StepEquation<'a> {
    /// Old state.
    pub from: &'a State,
    /// Time integration.
    pub form: StepForm,
    /// Load at the point of balance.
    pub load: FaceLoad<'a>,
    /// Acceleration on every mass (gravity in the falling frame), m/s2.
    pub body: [f64; 3],
}

impl Newton {
    /// For the system's size.
    pub fn new(system: &System, params: NewtonParams) -> Self {
        let zero = || vec![0.0; 3 * system.model.n_local()];
        Self {
            params,
            u: zero(),
            x: zero(),
            end: zero(),
            w: zero(),
            w0: zero(),
            g: zero(),
            rhs: zero(),
            du: zero(),
            base: zero(),
            elimination: Elimination::new(system),
            slack: 10.0,
            evaluations: 0,
            assembly_s: 0.0,
            elimination_s: 0.0,
            history: Vec::new(),
            applied: Vec3::zeros(),
        }
    }

    /// Displacements (m) of the last attempt, with current ghosts.
    pub(crate) fn trial(&self) -> &[f64] {
        &self.u
    }

    /// Internal minus external forces with inertia, N, at the end of the last step, of constrained components too; the positions at which
    /// they balance, m.
    pub(crate) fn forces_with_inertia(
        &mut self,
        system: &System,
        balance: &StepEquation<'_>,
        out: &mut [f64],
    ) -> &[f64] {
        self.set_configuration(system, balance);
        let configuration = Configuration { at: &self.x, end: &self.end, weight: balance.form.force_weight };
        system.forces(configuration, balance.load, out);
        system.add_mass_product(&self.w, out);
        &self.x
    }

    /// Share of the load below which a residual ends the iteration.
    pub fn tolerance(&self) -> f64 {
        self.params.tolerance
    }

    /// Work of the residual forces of the last step over the displacements `du` (m) of
    /// owned nodes, J.
    pub(crate) fn unbalanced_work(&self, du: &[f64]) -> f64 {
        dot(&self.g, du)
    }

    /// Changes the share of the load below which a residual ends the iteration, and
    /// solves linear systems as tightly as they can be: without inertia a loose solve
    /// moves a structure far.
    pub(crate) fn set_static_tolerance(&mut self, tolerance: f64) {
        self.params.tolerance = tolerance;
        self.slack = 1.0;
    }

    /// Solves one time step into `to`. `guesses` are displacements to start from
    /// (with current ghosts) in addition to the extrapolated ones: the smallest residual is used.
    /// `scale` is the force (N) that residuals are measured against.
    pub fn step(
        &mut self,
        system: &mut System,
        linear: &mut LinearSolver,
        balance: &StepEquation<'_>,
        guesses: &[&[f64]],
        scale: f64,
        to: &mut State,
    ) -> Result<NewtonInfo, NewtonError> {
        let _part = timing::part("Newton step");
        self.start(system, balance);
        let mut norm = self.predict(system, balance, guesses);
        self.history.clear();
        let mut steps = 0;
        loop {
            self.history.push(norm / scale);
            if self.balanced(system, norm / scale, steps)? {
                self.finish(balance, to);
                return Ok(NewtonInfo { steps, residual: norm / scale, stop: Stop::Residual });
            }
            let rounds = self.elimination.rounds;
            norm = self.eliminate(system, balance, norm, scale);
            if norm <= self.params.tolerance * scale {
                continue;
            }
            // Elimination leaves the matrix with its own rows.
            let spoilt = self.elimination.rounds > rounds;
            let renew = steps == 0 || spoilt || self.outdated(norm / scale);
            if renew {
                self.tangent(system, balance);
            }
            if let Err(cause) = self.correct(system, linear, renew, norm / scale) {
                return Err(NewtonError::Linear { steps, node: self.worst_node(system), cause });
            }
            steps += 1;
            norm = self.search(system, balance, norm);
            if self.corrected_by_rounding(system) && norm.is_finite() {
                self.finish(balance, to);
                return Ok(NewtonInfo { steps, residual: norm / scale, stop: Stop::Correction });
            }
        }
    }

    /// The old state's part of the inertia, and the strains at the start of the step.
    fn start(&mut self, system: &mut System, balance: &StepEquation<'_>) {
        let StepEquation { from, form, .. } = balance;
        for i in 0..self.w0.len() {
            self.w0[i] = form.from_v * from.v[i] + form.from_a * from.a[i] - balance.body[i % 3];
        }
        if form.force_weight < 1.0 {
            for i in 0..self.x.len() {
                self.x[i] = system.model.reference[i] + from.u[i];
            }
            system.anchor(&self.x);
        }
    }

    /// Whether the residual `relative` to the load is small enough; an error where it is no
    /// number, or no step is left.
    fn balanced(&self, system: &System, relative: f64, steps: u32) -> Result<bool, NewtonError> {
        if !relative.is_finite() {
            return Err(NewtonError::NotFinite { steps, node: self.worst_node(system) });
        }
        if relative <= self.params.tolerance {
            return Ok(true);
        }
        if steps == self.params.max_steps {
            let node = self.worst_node(system);
            return Err(NewtonError::NotConverged { steps, residual: relative, node });
        }
        Ok(false)
    }

    /// Whether the matrix of the last step no longer serves. One that took the residual down by
    /// `fall` will about do so again: where that suffices, it serves once more.
    fn outdated(&self, relative: f64) -> bool {
        let fall = self.history.iter().rev().nth(1).map_or(1.0, |before| relative / before);
        fall * relative > 0.5 * self.params.tolerance
    }

    /// Solves for the correction `self.du`, with current ghosts.
    fn correct(
        &mut self,
        system: &System,
        linear: &mut LinearSolver,
        renew: bool,
        relative: f64,
    ) -> Result<(), String> {
        let n = 3 * system.model.n_owned();
        let forcing = forcing(self.params.tolerance / relative, linear.tolerance(), self.slack);
        for (r, g) in self.rhs[..n].iter_mut().zip(&self.g[..n]) {
            *r = -g;
        }
        linear.solve(&system.matrix, renew, &self.rhs, &mut self.du, forcing)?;
        system.model.halo.exchange(&mut self.du, 3);
        Ok(())
    }

    /// Whether no component of the last correction exceeds rounding. Collective.
    fn corrected_by_rounding(&self, system: &System) -> bool {
        let n = 3 * system.model.n_owned();
        let largest = self.du[..n].iter().fold(0.0f64, |m, d| m.max(d.abs()));
        system.comm().max(largest) <= self.params.smallest_correction
    }

    /// Rounds of elimination between two steps for the whole at most; 0: Newton's method
    /// alone.
    #[cfg(test)]
    pub(crate) fn set_most_rounds(&mut self, rounds: usize) {
        self.elimination.most_rounds = rounds;
    }

    /// Rounds of elimination so far.
    pub fn eliminations(&self) -> u64 {
        self.elimination.rounds
    }

    /// Brings the nodes with the largest imbalance to balance among themselves, see
    /// [`crate::elimination`]. Leaves the better of old and new displacements, with
    /// their residual in `g`; returns its norm.
    fn eliminate(&mut self, system: &mut System, balance: &StepEquation<'_>, norm: f64, scale: f64) -> f64 {
        let _part = timing::part("nonlinear elimination");
        let n = 3 * system.model.n_owned();
        let form = balance.form;
        let mut now = norm;
        let mut begun = false;
        for _ in 0..self.elimination.most_rounds {
            if !self.elimination.choose(system, &self.g[..n], now, scale) {
                break;
            }
            if !begun {
                self.base.copy_from_slice(&self.u);
                begun = true;
            }
            let start = Instant::now();
            let configuration = Configuration { at: &self.x, end: &self.end, weight: form.force_weight };
            let active = &self.elimination.active;
            let (k, m) = (form.force_weight, form.mass_factor);
            system.tangent_near(active, configuration, balance.load, k, m, &mut self.rhs);
            self.assembly_s += start.elapsed().as_secs_f64();
            for (r, g) in self.rhs[..n].iter_mut().zip(&self.g[..n]) {
                *r = -g;
            }
            let start = Instant::now();
            let solved = self.elimination.correct(system, &self.rhs, &mut self.du);
            self.elimination_s += start.elapsed().as_secs_f64();
            system.model.halo.exchange(&mut self.du, 3);
            for (u, d) in self.u.iter_mut().zip(&self.du) {
                *u += d;
            }
            self.elimination.rounds += 1;
            now = self.residual_near(system, balance);
            if !system.comm().all(solved && now.is_finite()) {
                break;
            }
        }
        if begun && (now >= norm || !now.is_finite()) {
            self.u.copy_from_slice(&self.base);
        }
        // What ends an iteration is never a residual that was put together from parts.
        if begun { self.residual(system, balance) } else { norm }
    }

    /// Norm of the applied load; without load, of the residual forces of the old
    /// state, so that a free motion has a scale too.
    pub fn load_scale(&mut self, system: &System, balance: &StepEquation<'_>) -> f64 {
        let n = 3 * system.model.n_owned();
        for i in 0..self.x.len() {
            self.x[i] = system.model.reference[i] + balance.from.u[i];
            self.w[i] = balance.body[i % 3];
        }
        system.external(&self.x, balance.load, &mut self.g);
        system.add_mass_product(&self.w, &mut self.g);
        system.constrain(&mut self.g);
        system.forces(Configuration::only(&self.x), balance.load, &mut self.rhs);
        system.constrain(&mut self.rhs);
        let mut sums = [dot(&self.g[..n], &self.g[..n]), 0.0];
        // R - F + F = R.
        sums[1] = self.g[..n].iter().zip(&self.rhs[..n]).map(|(f, r)| (f + r) * (f + r)).sum();
        system.comm().sum_slice(&mut sums);
        let scale = sums[0].sqrt().max(1e-2 * sums[1].sqrt());
        if scale > 0.0 { scale } else { 1.0 }
    }

    /// Leaves the best start in `self.u` and its residual in `self.g`; returns its norm.
    fn predict(&mut self, system: &System, balance: &StepEquation<'_>, guesses: &[&[f64]]) -> f64 {
        let State { u, v, a, .. } = balance.from;
        let dt = balance.form.dt;
        let (mut best, mut applied) = (f64::INFINITY, Vec3::zeros());
        for k in 0..2 + guesses.len() {
            for i in 0..u.len() {
                self.u[i] = match k {
                    _ if system.model.fixed[i] => u[i],
                    0 => u[i] + dt * v[i],
                    1 => u[i] + dt * (v[i] + 0.5 * dt * a[i]),
                    _ => guesses[k - 2][i],
                };
            }
            for &(i, u) in &system.prescribed {
                self.u[i as usize] = u;
            }
            let norm = self.residual(system, balance);
            if norm < best || k == 0 {
                (best, applied) = (norm, self.applied);
                self.base.copy_from_slice(&self.u);
            }
        }
        self.u.copy_from_slice(&self.base);
        self.applied = applied;
        best
    }

    /// Residual forces at `self.u` into `self.g`; returns their norm.
    fn residual(&mut self, system: &System, balance: &StepEquation<'_>) -> f64 {
        let _part = timing::part("residual");
        let start = Instant::now();
        let n = 3 * system.model.n_owned();
        self.set_configuration(system, balance);
        let configuration = Configuration { at: &self.x, end: &self.end, weight: balance.form.force_weight };
        system.forces(configuration, balance.load, &mut self.g);
        self.applied = -sum_of_nodes(&self.g[..n]);
        system.add_mass_product(&self.w, &mut self.g);
        system.constrain(&mut self.g);
        self.assembly_s += start.elapsed().as_secs_f64();
        system.comm().sum(dot(&self.g[..n], &self.g[..n])).sqrt()
    }

    /// As [`Newton::residual`] after the displacements moved by `self.du`, which leaves
    /// most nodes where they were.
    fn residual_near(&mut self, system: &System, balance: &StepEquation<'_>) -> f64 {
        let _part = timing::part("residual");
        let start = Instant::now();
        let n = 3 * system.model.n_owned();
        self.set_configuration(system, balance);
        let reached = self.elimination.reach(system, &self.du);
        let configuration = Configuration { at: &self.x, end: &self.end, weight: balance.form.force_weight };
        system.balance_near(reached, configuration, balance.load, &self.w, &mut self.rhs);
        let (g, rhs) = (self.g.as_chunks_mut::<3>().0, self.rhs.as_chunks::<3>().0);
        for ((g, r), _) in g.iter_mut().zip(rhs).zip(reached).filter(|(_, reached)| **reached) {
            *g = *r;
        }
        self.assembly_s += start.elapsed().as_secs_f64();
        system.comm().sum(dot(&self.g[..n], &self.g[..n])).sqrt()
    }

    /// Residual and matrix at `self.u`.
    fn tangent(&mut self, system: &mut System, balance: &StepEquation<'_>) {
        let _part = timing::part("tangent");
        let start = Instant::now();
        self.set_configuration(system, balance);
        let form = balance.form;
        let configuration = Configuration { at: &self.x, end: &self.end, weight: form.force_weight };
        system.tangent(configuration, balance.load, form.force_weight, form.mass_factor, &mut self.g);
        system.add_mass_product(&self.w, &mut self.g);
        system.constrain(&mut self.g);
        self.assembly_s += start.elapsed().as_secs_f64();
    }

    fn set_configuration(&mut self, system: &System, balance: &StepEquation<'_>) {
        let (u0, form) = (&balance.from.u, balance.form);
        for i in 0..self.u.len() {
            let du = self.u[i] - u0[i];
            let start = system.model.reference[i] + u0[i];
            self.x[i] = start + form.force_weight * du;
            self.end[i] = start + du;
            self.w[i] = form.mass_factor * du + self.w0[i];
        }
    }

    /// Moves along the correction `du` to where it no longer points downhill:
    /// a root of `phi(s) = du . g(u + s du)`. For a conservative load `g` is the
    /// gradient of the incremental energy, so this minimises it along the line.
    /// Leaves `u` there; returns the norm of the residual.
    fn search(&mut self, system: &System, balance: &StepEquation<'_>, before: f64) -> f64 {
        let _part = timing::part("line search");
        let n = 3 * system.model.n_owned();
        self.base.copy_from_slice(&self.u);
        let phi0 = system.comm().sum(dot(&self.du[..n], &self.g[..n]));
        let (mut low, mut phi_low, mut high, mut phi_high) = (0.0, phi0, f64::INFINITY, f64::NAN);
        let mut s = 1.0;
        let mut norm = f64::NAN;
        for trial in 0..SEARCHES {
            for i in 0..self.u.len() {
                self.u[i] = self.base[i] + s * self.du[i];
            }
            norm = self.residual(system, balance);
            let phi = system.comm().sum(dot(&self.du[..n], &self.g[..n]));
            self.evaluations += 1;
            if (trial == 0 && norm <= before) || phi.abs() <= SLOPE * phi0.abs() {
                break;
            }
            if phi.is_finite() && phi * phi0 > 0.0 {
                // Still downhill: the root lies further on.
                (low, phi_low) = (s, phi);
            } else {
                (high, phi_high) = (s, phi);
            }
            s = if high.is_infinite() {
                2.0 * s
            } else if phi_high.is_finite() {
                let secant = low + (high - low) * phi_low / (phi_low - phi_high);
                secant.clamp(low + 0.1 * (high - low), low + 0.9 * (high - low))
            } else {
                0.5 * (low + high)
            };
        }
        norm
    }

    fn finish(&self, balance: &StepEquation<'_>, to: &mut State) {
        let State { u, v, a, .. } = balance.from;
        for i in 0..u.len() {
            let a1 = balance.form.acceleration(self.u[i] - u[i], v[i], a[i]);
            to.u[i] = self.u[i];
            to.v[i] = balance.form.velocity(v[i], a[i], a1);
            to.a[i] = a1;
        }
    }

    fn worst_node(&self, system: &System) -> u64 {
        let n = system.model.n_owned();
        let size = |i: usize| {
            let s: f64 = self.g[3 * i..3 * i + 3].iter().map(|g| g * g).sum();
            if s.is_finite() { s } else { f64::INFINITY }
        };
        let worst = (0..n).max_by(|&i, &j| size(i).total_cmp(&size(j)));
        let value = worst.map_or(-1.0, size);
        let comm = system.comm();
        let largest = comm.max(value);
        // The rank that holds it gives the value; others 0.
        let here =
            if value == largest { worst.map_or(0, |i| system.model.numbering.global[i] + 1) } else { 0 };
        comm.max_u64(here).saturating_sub(1)
    }
}

/// Relative tolerance of the linear solve of a Newton step when the residual is to
/// fall to the share `goal`: the loosest that needs no more steps than `least` does, if
/// nothing but the linear solves limits them; at most `slack` times `least`.
fn forcing(goal: f64, least: f64, slack: f64) -> f64 {
    // Some margin below the goal.
    let goal = 0.3 * goal;
    let steps = (goal.ln() / least.ln()).ceil().max(1.0);
    goal.powf(1.0 / steps).clamp(least, slack * least)
}

/// Sum of `[nodes][3]` over the nodes.
pub(crate) fn sum_of_nodes(f: &[f64]) -> Vec3 {
    f.as_chunks::<3>().0.iter().fold(Vec3::zeros(), |sum, f| sum + Vec3::from(*f))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
