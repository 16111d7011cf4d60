//! Windows of time steps: substeps, cuts, and what they cost.

use crate::energy::Works;
use crate::explicit::{Explicit, ExplicitError};
use crate::failure_site::{self, FailureSite};
use crate::linear::LinearSolver;
use crate::loops::{Configuration, FaceLoad};
use crate::motion::Motion;
use crate::newton::{Newton, NewtonError, NewtonInfo, NewtonParams, State, StepEquation};
use crate::payload::Payload;
use crate::reactions::Reactions;
use crate::scheme::Scheme;
use crate::system::System;
use mesh::geometry::Vec3;

/// A load that runs linearly from the start to the end of a window.
#[derive(Clone, Copy, Debug)]
pub struct LoadPath<'a> {
    /// Pressure jumps at the start, Pa, `[faces]`.
    pub pressure: [&'a [f64]; 2],
    /// Tractions at start and end, Pa, `[faces][3]`; empty where there are none.
    pub traction: [&'a [f64]; 2],
}

/// A part of a window that one step covers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Interval<'a> {
    /// Shares of the window at its start and end.
    pub(crate) span: [f64; 2],
    /// Length of the window, s.
    pub(crate) window: f64,
    /// Load over the window.
    pub(crate) load: LoadPath<'a>,
    /// Acceleration on every mass, m/s2.
    pub(crate) body: [f64; 3],
}

impl Interval<'_> {
    /// Length, s.
    pub(crate) fn dt(&self) -> f64 {
        (self.span[1] - self.span[0]) * self.window
    }

    /// Both halves.
    fn halves(&self) -> [Self; 2] {
        let [start, end] = self.span;
        let middle = 0.5 * (start + end);
        [Self { span: [start, middle], ..*self }, Self { span: [middle, end], ..*self }]
    }
}

/// A window that could not be computed.
#[derive(Clone, Debug, thiserror::Error)]
#[error(
    "the structure failed {time:.6} s into the window, at a step of {dt:.3e} s after {cuts} halvings: {cause}{}; \
     smaller steps (stage.substeps), more damping or a smaller pressure may help",
    place(element)
)]
pub struct StepFailure {
    /// Time since the start of the window, s.
    pub time: f64,
    /// The step that failed last, s.
    pub dt: f64,
    /// Halvings that were tried.
    pub cuts: u32,
    /// Why.
    pub cause: NewtonError,
    /// The most strained element at the node that the cause names, in the last attempt.
    pub element: Option<FailureSite>,
}

/// Where a failure is, as the end of a sentence.
pub(crate) fn place(element: &Option<FailureSite>) -> String {
    element.map_or_else(String::new, |e| format!(", {e}"))
}

/// What a window cost.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WindowInfo {
    /// Newton steps.
    pub newton_steps: u64,
    /// Time steps that were halved.
    pub cuts: u64,
    /// Largest final residual relative to the load.
    pub residual: f64,
    /// Residual at which a step counts as converged; 0 where nothing is iterated.
    pub target: f64,
    /// Steps that ended above it: their last correction was rounding, or no correction was found.
    pub unconverged: u64,
    /// Work of the load, J.
    pub load_work: f64,
    /// Energy that mass- and stiffness-proportional damping and friction took, J.
    pub damping_work: f64,
    /// Work on the structure by kind.
    pub works: Works,
    /// Impulse of the external forces (loads on faces, on nodes, drag; no weight), N s.
    pub applied_impulse: Vec3,
}

/// Equations, time integration and solvers of one rank.
pub struct Dynamics {
    /// Equations of motion.
    pub system: System,
    /// Linear solver.
    pub linear: LinearSolver,
    /// Newton's method.
    pub newton: Newton,
    pub(crate) scheme: Scheme,
    pub(crate) damping: f64,
    max_cuts: u32,
    /// State of the last accepted window.
    pub accepted: State,
    /// State at the end of the last computed window.
    pub current: State,
    pub(crate) next: State,
    pub(crate) pressure: Vec<f64>,
    pub(crate) traction: Vec<f64>,
    pub(crate) force: [Vec<f64>; 2],
    pub(crate) x: Vec<f64>,
    /// Displacements over a substep, m.
    pub(crate) du: Vec<f64>,
    /// Force that residuals of the window are measured against, N.
    scale: f64,
    /// Displacements after each substep of the last computed window: they start
    /// the next coupling iteration.
    path: Vec<Vec<f64>>,
    /// Reactions of groups of nodes; `None` where none are asked for.
    pub(crate) reactions: Option<Reactions>,
    /// Prescribed motions; empty where there are none.
    pub(crate) motions: Vec<Motion>,
    /// Time since the start of the stage at the start of the next window, s.
    pub time: f64,
    /// Length of the last computed window, s.
    window: f64,
    /// A rigid payload; `None` where there is none.
    pub(crate) payload: Option<Payload>,
    /// Explicit steps, where they take the place of the scheme.
    pub(crate) explicit: Option<Explicit>,
}

/// Choices of a scene.
#[derive(Clone, Copy, Debug)]
pub struct DynamicsParams {
    /// Time integration.
    pub scheme: Scheme,
    /// Mass-proportional damping, 1/s.
    pub damping: f64,
    /// Newton's limits.
    pub newton: NewtonParams,
    /// Relative tolerance of linear solves.
    pub linear_tolerance: f64,
    /// Halvings of a step.
    pub max_cuts: u32,
}

impl Dynamics {
    /// From rest.
    pub fn new(system: System, p: DynamicsParams) -> Self {
        let n = system.model.n_local();
        let linear = LinearSolver::new(system.comm(), p.linear_tolerance);
        let newton = Newton::new(&system, p.newton);
        let zero = || vec![0.0; 3 * n];
        let n_faces = system.model.n_faces;
        Self {
            linear,
            newton,
            scheme: p.scheme,
            damping: p.damping,
            max_cuts: p.max_cuts,
            accepted: State::rest(n),
            current: State::rest(n),
            next: State::rest(n),
            pressure: vec![0.0; n_faces],
            traction: Vec::new(),
            force: [zero(), zero()],
            x: zero(),
            du: zero(),
            scale: 1.0,
            path: Vec::new(),
            reactions: None,
            motions: Vec::new(),
            time: 0.0,
            window: 0.0,
            payload: None,
            explicit: None,
            system,
        }
    }

    /// Integrates explicitly from now on, with the share `safety` of the largest stable
    /// step; the system's mass is lumped, and constraints do not change any more.
    /// Collective.
    ///
    /// # Errors
    /// [`ExplicitError`].
    pub fn integrate_explicitly(&mut self, safety: f64) -> Result<&Explicit, ExplicitError> {
        self.path = Vec::new();
        Ok(self.explicit.insert(Explicit::new(&mut self.system, safety)?))
    }

    /// What explicit steps keep, where they are taken.
    pub fn explicit(&self) -> Option<&Explicit> {
        self.explicit.as_ref()
    }

    /// Forces (N) that hold the constrained components of the accepted state under a
    /// load and the acceleration `body` (m/s2), shape `[n_local][3]`: zero elsewhere,
    /// and on ghosts.
    pub fn reactions(&mut self, load: FaceLoad<'_>, body: [f64; 3]) -> Vec<f64> {
        let State { u, v, a, .. } = &self.accepted;
        for i in 0..self.x.len() {
            self.x[i] = self.system.model.reference[i] + u[i];
            self.next.u[i] = a[i] + self.damping * v[i] - body[i % 3];
        }
        self.system.set_step(f64::INFINITY);
        let mut f = vec![0.0; self.x.len()];
        self.system.forces(Configuration::only(&self.x), load, &mut f);
        self.system.add_mass_product(&self.next.u, &mut f);
        let owned = 3 * self.system.model.n_owned();
        for (i, f) in f.iter_mut().enumerate() {
            if i >= owned || !self.system.model.fixed[i] {
                *f = 0.0;
            }
        }
        f
    }

    /// Sets the accelerations of the accepted state in balance with a load. For the
    /// start of a motion whose accelerations are not known.
    pub fn balance_start(&mut self, load: FaceLoad<'_>, body: [f64; 3]) -> Result<(), linalg::KrylovError> {
        let (u, v) = (&self.accepted.u, &self.accepted.v);
        for i in 0..self.x.len() {
            self.x[i] = self.system.model.reference[i] + u[i];
            self.next.u[i] = body[i % 3] - self.damping * v[i];
        }
        self.system.set_step(f64::INFINITY);
        let f = &mut self.force[0];
        self.system.forces(Configuration::only(&self.x), load, f);
        f.iter_mut().for_each(|f| *f = -*f);
        self.system.add_mass_product(&self.next.u, f);
        self.system.constrain(f);
        self.system.accelerations(f, &mut self.accepted.a)
    }

    /// Computes a window of `substeps` equal steps from the accepted state into
    /// `current`. `iterated`: the same window was computed before, so its path
    /// is a good start.
    pub fn window(
        &mut self,
        dt: f64,
        substeps: u64,
        load: LoadPath<'_>,
        body: [f64; 3],
        iterated: bool,
    ) -> Result<WindowInfo, StepFailure> {
        self.current.copy_from(&self.accepted);
        self.system.rewind();
        self.clear_reactions();
        self.window = dt;
        let mut info = WindowInfo::default();
        if self.explicit.is_none() {
            info.target = self.newton.tolerance();
        }
        let n = self.current.u.len();
        let known = iterated && self.path.len() == substeps as usize;
        if let Some(e) = &mut self.explicit {
            e.forget();
        } else if !known {
            self.path.resize_with(substeps as usize, || vec![0.0; n]);
        }
        self.system.set_step(f64::INFINITY);
        self.system.set_time(self.time);
        if self.explicit.is_none() {
            let form = self.scheme.step(dt / substeps as f64, self.damping);
            let end = FaceLoad { pressure: load.pressure[1], traction: load.traction[1] };
            let balance = StepEquation { from: &self.current, form, load: end, body };
            self.scale = self.newton.load_scale(&self.system, &balance);
        }
        self.load_on(0.0, load, false);
        if self.payload.is_some() {
            let first = FaceLoad { pressure: load.pressure[0], traction: load.traction[0] };
            self.balance_payload(first, body.into());
        }
        for k in 0..substeps {
            let share = |k: u64| k as f64 / substeps as f64;
            let part = Interval { span: [share(k), share(k + 1)], window: dt, load, body };
            self.interval(part, known.then_some(k as usize), 0, &mut info)?;
            if self.explicit.is_none() {
                self.path[k as usize].copy_from_slice(&self.current.u);
            }
        }
        let mut sums = [0.0; 5 + Works::KINDS];
        sums[..2].copy_from_slice(&[info.load_work, info.damping_work]);
        sums[2..5].copy_from_slice(info.applied_impulse.as_slice());
        sums[5..].copy_from_slice(&info.works.0);
        self.system.comm().sum_slice(&mut sums);
        [info.load_work, info.damping_work] = [sums[0], sums[1]];
        info.applied_impulse = Vec3::from_column_slice(&sums[2..5]);
        info.works.0.copy_from_slice(&sums[5..]);
        self.finish_reactions(dt);
        Ok(info)
    }

    /// Advances `current` over a share of the window, halving the step where it fails.
    fn interval(
        &mut self,
        part: Interval<'_>,
        known: Option<usize>,
        cuts: u32,
        info: &mut WindowInfo,
    ) -> Result<(), StepFailure> {
        let dt = part.dt();
        let step = match self.explicit {
            Some(_) => self.explicit_step(part),
            None => self.step_with_motion(part, known),
        };
        match step {
            Ok(step) => {
                info.newton_steps += u64::from(step.steps);
                info.residual = info.residual.max(step.residual);
                info.unconverged += u64::from(info.target > 0.0 && step.residual > info.target);
                info.applied_impulse += match &self.explicit {
                    Some(e) => e.applied_impulse,
                    None => self.newton.applied * dt,
                };
                let (load_work, damping_work) = (self.load_work(part), self.damping_work());
                info.load_work += load_work;
                info.damping_work += damping_work;
                self.add_works(part, [load_work, damping_work], &mut info.works);
                std::mem::swap(&mut self.current, &mut self.next);
                Ok(())
            }
            Err(cause) if cuts < self.max_cuts => {
                info.cuts += 1;
                // What slipped in the step that failed is no part of the answer.
                self.system.dissipated();
                info.newton_steps += u64::from(cause.steps());
                self.linear.renew();
                let [first, second] = part.halves();
                self.interval(first, None, cuts + 1, info)?;
                self.interval(second, None, cuts + 1, info)
            }
            Err(cause) => {
                let element = self.failure_site(&cause);
                Err(StepFailure { time: part.span[1] * part.window, dt, cuts, cause, element })
            }
        }
    }

    /// One implicit step from `current` to `next`; `known`: the substep whose path is a good start.
    pub(crate) fn step(
        &mut self,
        part: Interval<'_>,
        known: Option<usize>,
    ) -> Result<NewtonInfo, NewtonError> {
        let Interval { span, load, body, .. } = part;
        let dt = part.dt();
        self.system.set_time(self.time + span[1] * self.window);
        if self.system.depends_on_rate() || self.system.has_history() {
            self.system.set_step(dt);
            for i in 0..self.x.len() {
                self.x[i] = self.system.model.reference[i] + self.current.u[i];
            }
            self.system.anchor_rates(&self.x);
            self.system.advance_history(&self.x);
        }
        let form = self.scheme.step(dt, self.damping);
        let at = span[0] + form.force_weight * (span[1] - span[0]);
        blend(load, at, &mut self.pressure, &mut self.traction);
        let balance = StepEquation {
            from: &self.current,
            form,
            load: FaceLoad { pressure: &self.pressure, traction: &self.traction },
            body,
        };
        let guess: Option<&[f64]> = known.map(|k| self.path[k].as_slice());
        let guesses = guess.as_slice();
        let step = self.newton.step(
            &mut self.system,
            &mut self.linear,
            &balance,
            guesses,
            self.scale,
            &mut self.next,
        );
        if let (Some(r), Ok(_)) = (&mut self.reactions, &step) {
            let place = self.newton.forces_with_inertia(&self.system, &balance, &mut self.force[1]);
            r.add(&self.force[1], place, &self.system.model.fixed, dt);
        }
        step
    }

    /// Trapezoidal work of the load on owned nodes from `current` to `next`, J. The
    /// load on `current` is left from the step before.
    fn load_work(&mut self, part: Interval<'_>) -> f64 {
        self.load_on(part.span[1], part.load, true);
        let n = 3 * self.system.model.n_owned();
        let [before, after] = &self.force;
        let work = (0..n).map(|i| 0.5 * (before[i] + after[i]) * (self.next.u[i] - self.current.u[i])).sum();
        self.force.swap(0, 1);
        work
    }

    /// Energy that damping and friction take from `current` to `next` on owned nodes, J.
    fn damping_work(&mut self) -> f64 {
        let mut work = 0.0;
        let (from, to) = (&self.current, &self.next);
        if self.damping > 0.0 {
            for i in 0..self.x.len() {
                self.x[i] = 0.5 * self.damping * (from.v[i] + to.v[i]);
            }
            let f = &mut self.force[1];
            f.fill(0.0);
            self.system.add_mass_product(&self.x, f);
            let n = 3 * self.system.model.n_owned();
            work += (0..n).map(|i| f[i] * (to.u[i] - from.u[i])).sum::<f64>();
        }
        if self.system.depends_on_rate() {
            let [_, y] = &mut self.force;
            for i in 0..self.x.len() {
                self.x[i] = self.system.model.reference[i] + from.u[i];
                y[i] = self.system.model.reference[i] + to.u[i];
            }
            let taken = self.explicit.as_ref().and_then(Explicit::taken);
            work += taken.unwrap_or_else(|| self.system.dissipation(&self.x, y));
        }
        if self.system.has_dissipation() {
            for (x, (reference, u)) in self.x.iter_mut().zip(self.system.model.reference.iter().zip(&to.u)) {
                *x = reference + u;
            }
            self.system.advance_history(&self.x);
            work += self.system.dissipated();
        }
        work
    }

    /// The element that a failed step is about. Collective.
    pub(crate) fn failure_site(&mut self, cause: &NewtonError) -> Option<FailureSite> {
        for (i, u) in self.newton.trial().iter().enumerate() {
            self.x[i] = self.system.model.reference[i] + u;
        }
        failure_site::at_node(&self.system.model, cause.node(), &self.x)
    }

    /// External forces at a share of the window: on `next` into `force[1]`, or on
    /// `current` into `force[0]`.
    fn load_on(&mut self, share: f64, load: LoadPath<'_>, next: bool) {
        blend(load, share, &mut self.pressure, &mut self.traction);
        // An explicit step ends with its positions.
        if !(next && self.explicit.is_some()) {
            let state = if next { &self.next } else { &self.current };
            for ((x, reference), u) in self.x.iter_mut().zip(&self.system.model.reference).zip(&state.u) {
                *x = reference + u;
            }
        }
        let face_load = FaceLoad { pressure: &self.pressure, traction: &self.traction };
        self.system.pressed(&self.x, face_load, &mut self.force[usize::from(next)]);
    }

    /// The last computed window is final.
    pub fn accept(&mut self) {
        self.accepted.copy_from(&self.current);
        self.system.keep();
        self.time += self.window;
        self.window = 0.0;
    }
}

/// The load at a share of the window.
pub(crate) fn blend(load: LoadPath<'_>, share: f64, pressure: &mut [f64], traction: &mut Vec<f64>) {
    let mix = |a: f64, b: f64| a + share * (b - a);
    for ((p, a), b) in pressure.iter_mut().zip(load.pressure[0]).zip(load.pressure[1]) {
        *p = mix(*a, *b);
    }
    traction.resize(load.traction[0].len(), 0.0);
    for ((t, a), b) in traction.iter_mut().zip(load.traction[0]).zip(load.traction[1]) {
        *t = mix(*a, *b);
    }
}
