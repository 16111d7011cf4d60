//! Corrections until the residual of a step has dropped.

use super::*;

impl<G: Gas<N>, V: Viscosity, const N: usize> Solver<G, V, N> {
    /// Residual of the step at `q`: primitive, weighted to N. Returns its norm.
    pub(super) fn evaluate(&mut self) -> f64 {
        self.spatial.evaluate(
            &domain!(self),
            &self.scheme,
            &mut self.q,
            &mut self.gradient,
            &mut self.residual,
            &mut self.through,
        );
        let gas = &self.spatial.gas;
        let push = self.wind_change.map(|a| self.settings.air.density * a);
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
                r[1 + d] -= self.metrics.volume[i] * push[d];
            }
            r[0] *= mass_weight(self.metrics.size[i], &self.scheme);
            if N > 4 {
                r[N - 1] *= TEMPERATURE_WEIGHT;
            }
            sum += r.iter().map(|x| x * x).sum::<f64>();
        }
        self.halo.comm().sum(sum).sqrt()
    }

    pub(super) fn iterate(&mut self, step: &Step, order: Backward) -> Result<Report, FlowError> {
        let n = self.topology.n_owned;
        let mut norm: f64;
        if step.again {
            norm = self.evaluate();
            // The first call of the window may have brought no motion at all, and so no measure.
            self.start = self.start.max(norm);
        } else {
            let ratio = step.dt / self.step_before(step.dt);
            let inertia = ratio * self.inertia();
            norm = f64::INFINITY;
            if order != Backward::FIRST {
                // A smooth flow goes on as it went.
                for ((q, a), b) in self.q.iter_mut().zip(&self.past[0].q).zip(&self.past[1].q) {
                    for v in 0..N {
                        q[v] = (1.0 + ratio) * a[v] - ratio * b[v];
                    }
                    for d in 0..3 {
                        q[1 + d] += self.wind_gain[0][d] - ratio * self.wind_gain[1][d];
                    }
                }
                norm = self.evaluate();
                self.start = inertia;
            }
            // Not a smooth flow: from where it was.
            if norm.is_nan() || norm > inertia {
                self.q.copy_from_slice(&self.past[0].q);
                for q in &mut self.q {
                    for d in 0..3 {
                        q[1 + d] += self.wind_gain[0][d];
                    }
                }
                self.start = self.evaluate();
                norm = self.start;
            }
        }
        let first = norm;
        // Below this the residual is round-off of the fluxes themselves.
        let Settings { residual_drop, repeated_drop, .. } = self.settings;
        let drop = if step.again { repeated_drop } else { residual_drop };
        // A coupled step answers changes of its input: what is left over must be small
        // against the change that this call brought, or the coupling iterates on noise.
        let scale =
            if step.moved { (0.1 * first).clamp(1e-3 * self.start, 0.1 * self.start) } else { self.start };
        let round_off = self.round_off();
        let target = (drop * scale).max(round_off);
        // What the scene asks of a step, however little the last of several calls brought.
        let least = if step.moved { 0.1 * self.start } else { self.start };
        let asked = (residual_drop * least).max(target);
        let mut report = Report { start: self.start, target: asked, ..Report::default() };
        if step.again {
            // The Jacobian is nearly the same: what the last solve has learnt still holds.
            self.acceleration.pause();
        } else {
            self.acceleration.clear();
        }
        // Share of each correction that is taken.
        let mut share = 1.0;
        // Whether the state is the best one so far.
        let (mut best, mut better) = (norm, true);
        let mut assembled = false;
        while report.iterations < self.settings.max_iterations && (norm.is_nan() || norm > target) {
            if !assembled {
                self.correction.assemble(
                    &self.spatial,
                    &domain!(self),
                    &self.scheme,
                    &self.q,
                    &self.gradient,
                    &self.through,
                    1.0,
                );
            }
            self.acceleration.combine(
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
                share,
                &mut self.q,
            );
            report.linear_iterations += linear.iterations;
            report.iterations += 1;
            let bad = self.bad_cell();
            let before = norm;
            if bad.is_none() {
                norm = self.evaluate();
            }
            if bad.is_some() || norm.is_nan() || best.is_nan() || norm >= best {
                if better {
                    self.best.clear();
                    self.best.extend_from_slice(self.acceleration.last());
                }
                better = false;
            }
            if bad.is_some() || !norm.is_finite() || norm > 10.0 * best {
                // Back to the best state so far, and on by smaller steps.
                self.acceleration.clear();
                self.q[..n].as_flattened_mut().copy_from_slice(&self.best);
                share *= 0.5;
                assembled = false;
                if share < 1e-3 {
                    if let Some((rank, (cell, at, density))) = bad {
                        return Err(FlowError::BadState { cell, at, rank, density });
                    }
                    return Err(FlowError::Diverged {
                        start: first,
                        end: norm,
                        iterations: report.iterations,
                    });
                }
                norm = self.evaluate();
                continue;
            }
            if norm < best {
                (best, better) = (norm, true);
                share = (2.0 * share).min(1.0);
            }
            // What served well serves again.
            assembled = norm < 0.5 * before;
        }
        if norm > best {
            self.q[..n].as_flattened_mut().copy_from_slice(&self.best);
            norm = self.evaluate();
        }
        report.end = norm;
        report.met = norm <= target;
        let halved = norm <= 0.5 * self.start || norm <= 1e3 * round_off;
        if !report.met && !halved {
            return Err(self.unsolved(first, &report));
        }
        let cells = self.residual[..n].iter().zip(&self.metrics.size);
        let defect: f64 = cells.map(|(r, h)| r[0] / mass_weight(*h, &self.scheme)).sum();
        report.mass_defect = self.halo.comm().sum(defect);
        Ok(report)
    }

    /// Why a step has no answer whose iterations began at a residual of `first` (N).
    fn unsolved(&self, first: f64, report: &Report) -> FlowError {
        let Report { end, target, iterations, .. } = *report;
        if end <= first.max(self.start) {
            FlowError::Unsolved { start: self.start, end, target, iterations }
        } else {
            FlowError::Diverged { start: first, end, iterations }
        }
    }

    /// What would remain in the momentum equations of a step on a grid at rest if
    /// the flow kept its state relative to the undisturbed air, N. Collective.
    pub(super) fn inertia(&self) -> f64 {
        let (gas, still) = (&self.spatial.gas, self.wind_gain[1]);
        let past = self.past[0].q.iter().zip(&self.past[1].q).zip(&self.metrics.volume);
        let sum: f64 = past
            .take(self.topology.n_owned)
            .map(|((a, b), v)| {
                let m = self.scheme.rate * v * gas.density(a);
                (0..3).map(|d| (m * (a[1 + d] - b[1 + d] - still[d])).powi(2)).sum::<f64>()
            })
            .sum();
        self.halo.comm().sum(sum).sqrt()
    }

    /// Norm of what round-off alone may leave in the residual, N.
    pub(super) fn round_off(&self) -> f64 {
        let speed = 10.0 * self.settings.reference_speed + norm(self.scheme.frame);
        let n = self.topology.n_owned;
        let cells = self.metrics.volume[..n].iter().zip(&self.metrics.size);
        let sum: f64 = cells
            .map(|(v, h)| {
                let w = mass_weight(*h, &self.scheme);
                // Momentum stored and passed, and mass in the weight of its row.
                let e = (self.scheme.rate * v + speed * h * h) * (speed + w);
                e * e
            })
            .sum();
        4.0 * f64::EPSILON * self.settings.air.density * self.halo.comm().sum(sum).sqrt()
    }

    /// The first cell whose state is not physical, agreed on by all ranks.
    pub(super) fn bad_cell(&self) -> Option<(usize, (u64, Vec3, f64))> {
        let floor = 0.1 * self.settings.air.density;
        let ceiling = 10.0 * self.settings.air.density;
        let fine = |q: &[f64; N]| {
            let rho = self.spatial.gas.density(q);
            q.iter().all(|x| x.is_finite()) && rho > floor && rho < ceiling
        };
        let bad = self.q[..self.topology.n_owned].iter().position(|q| !fine(q));
        let finding = bad.map(|c| {
            let rho = self.spatial.gas.density(&self.q[c]);
            (self.topology.numbering.global[c], self.metrics.centre[c], rho)
        });
        agree(self.halo.comm(), finding)
    }
}

/// A defect of mass acts like the force that would have to undo it: m/s, for a cell of
/// size `h`.
#[inline(always)]
fn mass_weight(h: f64, scheme: &Scheme) -> f64 {
    h * scheme.rate + scheme.floor_squared.sqrt()
}

/// Turns the temperature residual (kg K/s) into a force: c_p / c, m/(s K).
const TEMPERATURE_WEIGHT: f64 = 3.0;
