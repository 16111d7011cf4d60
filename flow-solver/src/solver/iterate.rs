//! Corrections until the residual of a step has dropped.

use super::*;
use crate::error::Finding;

/// Rank and finding (cell, place, density) of a state that is not physical.
type BadCell = (usize, Finding);

/// Backtracking gives up below this share of a correction.
const SMALLEST_SHARE: f64 = 1e-3;

/// Residual targets of a step, N.
struct Target {
    /// At which they end.
    residual: f64,
    /// At which the step counts as converged.
    tolerance: f64,
    /// Residual level of round-off.
    round_off: f64,
    /// Residual that the settings ask for, which may be below round-off.
    asked: f64,
}

impl Target {
    /// Whether the tolerances ask for less than round-off in a step that begins, at `start` (N), far above it. A flow that hardly changes begins
    /// near it.
    fn is_too_small(&self, start: f64) -> bool {
        self.asked < self.round_off && start > FAR_ABOVE_ROUND_OFF * self.round_off
    }

    fn is_met(&self, norm: f64) -> bool {
        norm <= self.residual
    }

    /// Whether the residual is that of round-off, which no cell can fall below.
    fn is_round_off(&self, norm: f64) -> bool {
        norm <= self.round_off
    }
}

/// Residual of a step on a moving grid that must drop, over that at its start.
const OF_THE_START: f64 = 0.1;
/// The same for a change of the input, over the residual that it causes.
const OF_A_CHANGE: f64 = 0.1;
/// Smallest change of the input that is resolved, by the residual that it causes over that at the start of the step.
const SMALLEST_CHANGE: f64 = 1e-3;
/// Solves of a window that may be no more precise than its tolerance, where these were enough for the window before: windows that need
/// more amplify errors of the flow.
pub(super) const LOOSE_SOLVES: usize = 2;

impl Settings {
    /// Residual, N, at which a solve ends that begins at `first`, in a step that began at `start`; `repetition`: solves of the same step
    /// before this one; `few`: the step before needed few solves.
    ///
    /// A solve on a moved grid answers a change of the input, whose effect must be larger than what the solve leaves; otherwise noise of the
    /// solver dominates the coupling iterations. No solve ends above the tolerance of the step, $`d \cdot 0.1\, r_\text{start}`$. The first of
    /// several solves resolves its change ten times less finely, because the next ones correct it, and the first two end at what suffices
    /// for the tolerance of the coupling; both only after a step of few solves.
    fn residual_to_reach(&self, repetition: usize, few: bool, moved: bool, first: f64, start: f64) -> f64 {
        let drop = match self.coupling {
            Some(c) if repetition > 0 => c.drop,
            _ => self.residual_drop,
        };
        if !moved {
            return drop * start;
        }
        let finest = drop * SMALLEST_CHANGE;
        let (change, least) = match self.coupling {
            Some(c) if few && repetition == 0 => (first, c.sufficient),
            Some(c) if few && repetition < LOOSE_SOLVES => (OF_A_CHANGE * first, c.sufficient),
            _ => (OF_A_CHANGE * first, finest),
        };
        let most = drop * OF_THE_START;
        (drop * change).clamp(least.clamp(finest, most) * start, most * start)
    }
}

/// Residual at the start of a step over that of round-off, from which on round-off limits the tolerance, not the start.
const FAR_ABOVE_ROUND_OFF: f64 = 1e6;

/// State of the nonlinear iteration of a step.
struct Iteration {
    /// Norms of the residual, N: of the initial guess, of the present state, the smallest so far.
    first: f64,
    norm: f64,
    best: f64,
    /// Whether the present state is the best one so far.
    at_best: bool,
    /// Largest error of a cell in the present state, where its residual is small enough.
    cell: CellError,
    /// Share of each correction that is taken.
    share: f64,
    /// Whether the matrices of the last correction are reused.
    assembled: bool,
    /// Corrections, and iterations of the linear solver in them.
    iterations: usize,
    linear_iterations: usize,
}

impl Iteration {
    fn new(first: f64) -> Self {
        Self {
            first,
            norm: first,
            best: first,
            at_best: true,
            cell: CellError::default(),
            share: 1.0,
            assembled: false,
            iterations: 0,
            linear_iterations: 0,
        }
    }

    /// Whether the last correction brought nothing.
    fn has_stalled(&self) -> bool {
        self.norm.is_nan() || self.best.is_nan() || self.norm >= self.best
    }

    /// Whether the last correction must be undone.
    fn has_diverged(&self) -> bool {
        !self.norm.is_finite() || self.norm > 10.0 * self.best
    }

    /// The correction is kept; `before`: residual before it, N.
    fn accept(&mut self, before: f64) {
        if self.norm < self.best {
            (self.best, self.at_best) = (self.norm, true);
            self.share = (2.0 * self.share).min(1.0);
        }
        // Keep the matrices while an iteration halves the residual.
        self.assembled = self.norm < 0.5 * before;
    }
}

impl<G: Gas<N>, const N: usize> Solver<G, N> {
    /// Residual of the step at `q`: primitive, weighted to N. Returns its norm.
    pub(super) fn evaluate(&mut self) -> f64 {
        let _part = timing::part("residual");
        let corrected = if self.spatial.upwind_share < 1.0 { self.topology.n_owned } else { 0 };
        self.gradient_correction.resize(corrected, [[0.0; N]; 3]);
        self.spatial.evaluate(
            &domain!(self),
            &self.scheme,
            &mut self.q,
            Slopes { gradient: &mut self.gradient, correction: &mut self.gradient_correction },
            &mut self.residual,
            &mut self.face_flux,
        );
        let gas = &self.spatial.gas;
        let push = self.wind_change.map(|a| a * self.settings.air.density);
        let mut sum = 0.0;
        for i in 0..self.topology.n_owned {
            let (q, r, h) = (&self.q[i], &mut self.residual[i], &self.history[i]);
            let m = self.scheme.rate * self.metrics.volume[i] * gas.density(q);
            let stored = gas.stored(q);
            for v in 0..N {
                r[v] += m * stored[v] + h[v];
            }
            *r = gas.primitive_residual(q, r);
            for d in 0..3 {
                r[1 + d] -= self.metrics.volume[i] * push[0][d];
            }
            for (level, push) in
                self.previous.iter().zip(&push[1..]).filter(|(level, _)| !level.volume.is_empty())
            {
                (0..3).for_each(|d| r[1 + d] -= level.volume[i] * push[d]);
            }
            r[0] *= mass_weight(self.metrics.size[i], &self.scheme);
            if N > 4 {
                r[N - 1] *= TEMPERATURE_WEIGHT;
            }
            sum += r.iter().map(|x| x * x).sum::<f64>();
        }
        self.halo.comm().sum(sum).sqrt()
    }

    /// As [`Solver::evaluate`] at the initial guess of a step, whose state sets the blending of the fluxes.
    fn evaluate_guess(&mut self) -> f64 {
        // Upwind everywhere: the blending never changes.
        self.scheme.renews_blending = self.spatial.upwind_share < 1.0;
        let norm = self.evaluate();
        self.scheme.renews_blending = false;
        norm
    }

    /// Corrects the state until the residual of the step has dropped to its target. Collective.
    pub(super) fn iterate(&mut self, step: &Step, order: Backward) -> Result<Report, FlowError> {
        let _part = timing::part("iteration");
        self.repetition = if step.repeat { self.repetition + 1 } else { 0 };
        let first = self.initial_guess(step, order);
        let target = self.target(step, first);
        let solved = self.solve(step, first, &target)?;
        self.accept_best(solved, &target)
    }

    /// The state to start from; returns the norm of its residual, N. Sets [`Solver::start`]. Collective.
    fn initial_guess(&mut self, step: &Step, order: Backward) -> f64 {
        if step.repeat {
            let norm = self.evaluate();
            // The first solve of the window may have had no grid motion, hence no reference residual.
            self.start = self.start.max(norm);
            return norm;
        }
        let ratio = step.dt / self.step_before(step.dt);
        let inertia = ratio * self.inertia();
        if order != Backward::FIRST {
            self.extrapolate(ratio);
            let norm = self.evaluate_guess();
            self.start = inertia;
            if !(norm.is_nan() || norm > inertia) {
                return norm;
            }
        }
        self.start_from_last();
        self.start = self.evaluate_guess();
        self.start
    }

    /// A smooth flow: extrapolated from the last two time levels; the step is `ratio` times as long as the one before it.
    fn extrapolate(&mut self, ratio: f64) {
        for ((q, a), b) in self.q.iter_mut().zip(&self.previous[0].q).zip(&self.previous[1].q) {
            for v in 0..N {
                q[v] = (1.0 + ratio) * a[v] - ratio * b[v];
            }
            for d in 0..3 {
                q[1 + d] += self.wind_gain[0][d] - ratio * self.wind_gain[1][d];
            }
        }
    }

    /// A flow that is not smooth starts from where it was, carried along by the wind.
    fn start_from_last(&mut self) {
        self.q.copy_from_slice(&self.previous[0].q);
        for q in &mut self.q {
            for d in 0..3 {
                q[1 + d] += self.wind_gain[0][d];
            }
        }
    }

    /// Residuals that the step is to reach from `first`, N. Collective.
    fn target(&self, step: &Step, first: f64) -> Target {
        // Below this the residual is round-off of the fluxes themselves.
        let round_off = self.round_off();
        let few = self.few_solves_before;
        let asked = self.settings.residual_to_reach(self.repetition, few, step.moved, first, self.start);
        let residual = asked.max(round_off);
        // Tolerance of the scene for the step, independent of the size of the last change.
        let least = if step.moved { OF_THE_START * self.start } else { self.start };
        Target { residual, tolerance: (self.settings.residual_drop * least).max(residual), round_off, asked }
    }

    /// Corrections from an initial guess with the residual `first`, N, with backtracking, until the target or
    /// the limit of iterations is reached. Collective.
    fn solve(&mut self, step: &Step, first: f64, target: &Target) -> Result<Iteration, FlowError> {
        if step.repeat {
            // The Jacobian is nearly the same: reuse the differences of the last solve.
            self.nonlinear_gmres.pause();
        } else {
            self.nonlinear_gmres.clear();
        }
        let mut at = Iteration::new(first);
        while !self.has_converged(&mut at, target) && at.iterations < self.settings.max_iterations {
            let before = at.norm;
            self.correct(&mut at);
            let bad = self.bad_cell();
            if bad.is_none() {
                at.norm = self.evaluate();
            }
            if bad.is_some() || at.has_stalled() {
                self.keep_best(&mut at);
            }
            if bad.is_some() || at.has_diverged() {
                match self.backtrack(&mut at, bad) {
                    // Single cells could not be improved further: they are reported.
                    Err(_) if target.is_met(at.best) => {
                        at.norm = self.evaluate();
                        at.cell = self.cell_error();
                        return Ok(at);
                    }
                    outcome => outcome?,
                }
            } else {
                at.accept(before);
            }
        }
        Ok(at)
    }

    /// Whether the residual has dropped to its target, and no cell is left behind. Collective.
    fn has_converged(&mut self, at: &mut Iteration, target: &Target) -> bool {
        if !target.is_met(at.norm) {
            return false;
        }
        at.cell = self.cell_error();
        at.cell.is_small() || target.is_round_off(at.norm)
    }

    /// One correction: matrices, the combination of the last corrections, the approximate inverse. Collective.
    fn correct(&mut self, at: &mut Iteration) {
        let _part = timing::part("correction");
        let n = self.topology.n_owned;
        if !at.assembled {
            let field = Field { q: &self.q, gradient: &self.gradient };
            let on = domain!(self);
            self.correction.assemble(&self.spatial, &on, &self.scheme, field, &self.face_flux, 1.0);
        }
        self.nonlinear_gmres.combine(
            self.halo.comm(),
            self.q[..n].as_flattened_mut(),
            self.residual[..n].as_flattened_mut(),
        );
        for (r, h) in self.residual[..n].iter_mut().zip(&self.metrics.size) {
            r[0] /= mass_weight(*h, &self.scheme);
            if N > 4 {
                r[N - 1] /= TEMPERATURE_WEIGHT;
            }
        }
        let linear = self.correction.apply(
            &self.spatial.gas,
            &domain!(self),
            &self.scheme,
            &self.residual,
            at.share,
            &mut self.q,
        );
        at.linear_iterations += linear.iterations;
        at.iterations += 1;
    }

    /// Keeps the state before the last correction if that was the best one so far.
    fn keep_best(&mut self, at: &mut Iteration) {
        if at.at_best {
            self.best.clear();
            self.best.extend_from_slice(self.nonlinear_gmres.last());
        }
        at.at_best = false;
    }

    /// Returns to the best state so far and halves the share of the next corrections;
    /// an error once it is too small. Collective.
    fn backtrack(&mut self, at: &mut Iteration, bad: Option<BadCell>) -> Result<(), FlowError> {
        self.nonlinear_gmres.clear();
        self.return_to_best();
        at.share *= 0.5;
        at.assembled = false;
        if at.share < SMALLEST_SHARE {
            return Err(match bad {
                Some((rank, (cell, at, density))) => FlowError::BadState { cell, at, rank, density },
                None => FlowError::Diverged { start: at.first, end: at.norm, iterations: at.iterations },
            });
        }
        at.norm = self.evaluate();
        Ok(())
    }

    fn return_to_best(&mut self) {
        self.q[..self.topology.n_owned].as_flattened_mut().copy_from_slice(&self.best);
    }

    /// Returns the best state if its residual is acceptable. Collective.
    fn accept_best(&mut self, at: Iteration, target: &Target) -> Result<Report, FlowError> {
        let mut end = at.norm;
        // A state within the target is not exchanged for one of a smaller residual, whose cells may be less converged.
        if end > at.best && !target.is_met(end) {
            self.return_to_best();
            end = self.evaluate();
        }
        let mut report = Report {
            start: self.start,
            end,
            target: target.tolerance,
            met: end <= target.residual && (at.cell.is_small() || target.is_round_off(end)),
            cell: at.cell,
            iterations: at.iterations,
            linear_iterations: at.linear_iterations,
            mass_defect: 0.0,
            round_off: target.is_too_small(self.start).then_some(target.round_off),
        };
        let halved = end <= 0.5 * self.start || end <= 1e3 * target.round_off;
        if !report.met && !halved {
            return Err(self.unsolved(at.first, &report));
        }
        report.mass_defect = self.mass_defect();
        Ok(report)
    }

    /// Sum of the continuity residual over all cells, kg/s. Collective.
    fn mass_defect(&self) -> f64 {
        let cells = self.residual[..self.topology.n_owned].iter().zip(&self.metrics.size);
        let defect: f64 = cells.map(|(r, h)| r[0] / mass_weight(*h, &self.scheme)).sum();
        self.halo.comm().sum(defect)
    }

    /// Error of a failed step; `first`: residual of the initial guess, N.
    fn unsolved(&self, first: f64, report: &Report) -> FlowError {
        let Report { end, target, iterations, .. } = *report;
        if end <= first.max(self.start) {
            FlowError::Unsolved { start: self.start, end, target, iterations }
        } else {
            FlowError::Diverged { start: first, end, iterations }
        }
    }

    /// Inertia scale of a step, N: norm of the momentum residual on a fixed grid if the state relative to the
    /// undisturbed air stayed constant. Collective.
    pub(super) fn inertia(&self) -> f64 {
        let (gas, still) = (&self.spatial.gas, self.wind_gain[1]);
        let previous = self.previous[0].q.iter().zip(&self.previous[1].q).zip(&self.metrics.volume);
        let sum: f64 = previous
            .take(self.topology.n_owned)
            .map(|((a, b), v)| {
                let m = self.scheme.rate * v * gas.density(a);
                (0..3).map(|d| (m * (a[1 + d] - b[1 + d] - still[d])).powi(2)).sum::<f64>()
            })
            .sum();
        self.halo.comm().sum(sum).sqrt()
    }

    /// Round-off level of the residual norm, N.
    pub(super) fn round_off(&self) -> f64 {
        let speed = 10.0 * self.settings.reference_speed + self.scheme.frame.norm();
        // Enthalpy of the undisturbed air over c_p, in the weight of the temperature residual.
        let Air { temperature, gamma, .. } = self.settings.air;
        let heat = if N > 4 { TEMPERATURE_WEIGHT * temperature * (1.0 - 1.0 / gamma) } else { 0.0 };
        let n = self.topology.n_owned;
        let cells = self.metrics.volume[..n].iter().zip(&self.metrics.size);
        let sum: f64 = cells
            .map(|(v, h)| {
                let w = mass_weight(*h, &self.scheme);
                // Momentum stored and passed, and mass in the weight of its row.
                let e = (self.scheme.rate * v + speed * h * h) * (speed + w + heat);
                e * e
            })
            .sum();
        4.0 * f64::EPSILON * self.settings.air.density * self.halo.comm().sum(sum).sqrt()
    }

    /// The first cell whose state is not physical, agreed on by all ranks.
    pub(super) fn bad_cell(&self) -> Option<BadCell> {
        let floor = 0.1 * self.settings.air.density;
        let ceiling = 10.0 * self.settings.air.density;
        let fine = |q: &[f64; N]| {
            let rho = self.spatial.gas.density(q);
            q.iter().all(|x| x.is_finite()) && rho > floor && rho < ceiling
        };
        let bad = self.q[..self.topology.n_owned].iter().position(|q| !fine(q));
        let finding = bad.map(|c| {
            let rho = self.spatial.gas.density(&self.q[c]);
            (self.topology.numbering.global[c], self.metrics.centre(c), rho)
        });
        agree(self.halo.comm(), finding)
    }
}

/// A defect of mass acts like the force that would have to undo it: m/s, for a cell of
/// size `h`.
#[inline(always)]
fn mass_weight(h: f64, scheme: &FluxParameters) -> f64 {
    h * scheme.rate + scheme.floor_squared.sqrt() + VISCOUS_WEIGHT * scheme.kinematic_viscosity / h
}

/// Viscous part of the weight, times $`\nu/h`$. Without it the first steps of a cavity stall from $`\nu\Delta t/h^2 = 1000`$ on; 1, 3 and 6 take
/// 54, 44 and 42 iterations there.
const VISCOUS_WEIGHT: f64 = 3.0;

/// Turns the temperature residual (kg K/s) into a force: c_p / c, m/(s K).
const TEMPERATURE_WEIGHT: f64 = 3.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::Air;

    /// Targets on a grid that has moved, by formulas of [`Settings::residual_to_reach`].
    #[test]
    fn residual_to_reach_follows_from_what_is_needed() {
        let coupling = |drop, sufficient| Some(CouplingIterations { drop, sufficient });
        let after = |few, coupling, repetition, moved, first: f64| {
            settings(coupling).residual_to_reach(repetition, few, moved, first, 200.0) / 200.0
        };
        let target = |coupling, repetition, moved, first| after(true, coupling, repetition, moved, first);
        let assert_is = |found: f64, expected: f64| {
            assert!((found / expected - 1.0).abs() < 1e-12, "{found:e}, not {expected:e}")
        };
        let changes = |coupling, repetition, cases: [(f64, f64); 3]| {
            for (first, expected) in cases {
                assert_is(target(coupling, repetition, true, first), expected);
            }
        };
        // A step that is solved once.
        changes(None, 0, [(0.4, 1e-5), (20.0, 1e-4), (500.0, 1e-3)]);
        // The first of several solves resolves a change ten times less finely. The first two end at what suffices.
        let usual = coupling(1e-2, 2.5e-4);
        changes(usual, 0, [(0.4, 2.5e-4), (10.0, 5e-4), (500.0, 1e-3)]);
        changes(usual, 1, [(0.4, 2.5e-4), (100.0, 5e-4), (500.0, 1e-3)]);
        changes(usual, 2, [(0.4, 1e-5), (100.0, 5e-4), (500.0, 1e-3)]);
        // After a step of many solves all of them are as fine as that of a step that is solved once.
        for repetition in 0..3 {
            for (first, expected) in [(0.4, 1e-5), (20.0, 1e-4), (500.0, 1e-3)] {
                assert_is(after(false, usual, repetition, true, first), expected);
            }
        }
        // Close coupling: repeated solves have a drop of their own.
        changes(coupling(1e-3, 5e-6), 1, [(0.4, 5e-6), (10.0, 5e-6), (100.0, 5e-5)]);
        // What suffices is never finer than the smallest change, nor above the tolerance of the step.
        changes(coupling(1e-2, 1e-9), 1, [(0.4, 1e-5), (20.0, 1e-4), (500.0, 1e-3)]);
        assert_is(target(coupling(1e-6, 2.5e-4), 1, true, 1.0), 1e-7);
        // A grid at rest: the drop from the start.
        assert_is(target(coupling(1e-3, 5e-6), 0, false, 1.0), 1e-2);
        assert_is(target(coupling(1e-3, 5e-6), 1, false, 1.0), 1e-3);
    }

    fn settings(coupling: Option<CouplingIterations>) -> Settings {
        Settings {
            air: Air::new(1.2, 288.0),
            wind: Vec3::zeros(),
            residual_drop: 1e-2,
            coupling,
            max_iterations: 60,
            method: Method::PressureCorrection { depth: 5 },
            reference_speed: 0.5,
            velocity_diffusion: 0.0,
            ambient_pressure: 0.0,
            moving: true,
        }
    }
}
