//! Time marching to a steady flow.
//!
//! Implicit Euler steps of growing length. After each step the residual of the steady equations equals the time
//! derivative, $`\rho V\,\Delta u/\Delta t`$, so it needs no further evaluation. The last steps are long enough that
//! the flux has its steady limit.

use crate::error::FlowError;
use crate::geometry::vec3::Vec3;
use crate::loads::{Loads, Total};
use crate::physics::Gas;
use crate::solver::{CellError, Report, Solver, Step};
use crate::surface_force::Watched;

/// Stopping criteria of a march to a steady state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct March {
    /// Steady residual relative to its maximum at which the flow is steady; 0 disables the criterion.
    pub residual_drop: f64,
    /// Relative change of the force over the last ten steps at which the flow is steady; 0 disables the criterion.
    pub force_change: f64,
    /// Maximum number of steps.
    pub max_steps: usize,
    /// Courant number of a cell of mean size in the longest steps.
    pub max_courant: f64,
}

/// Statistics of a march.
#[derive(Clone, Copy, Debug, Default)]
pub struct MarchReport {
    /// Steps.
    pub steps: usize,
    /// Corrections in all steps.
    pub iterations: usize,
    /// Iterations of the pressure equation.
    pub linear_iterations: usize,
    /// Steady residual at the end over its largest.
    pub drop: f64,
    /// Relative change of the force over the last ten steps.
    pub change: f64,
    /// Steps whose iterations ran out before the residual had dropped by `STEP_DROP`.
    pub unsolved: usize,
    /// Whether the criterion of the force ended the march.
    pub force_converged: bool,
}

/// Each step solves its residual down by this factor. Deeper drops and faster growth
/// took as many corrections or more on the cylinder at Re 40.
const STEP_DROP: f64 = 0.3;
/// Each step is longer than the one before by this factor.
const GROWTH: f64 = 2.0;
/// Steps over which the force is watched.
const WATCHED: usize = 10;

impl March {
    /// Marches `solver` on a grid at rest that moves with its frame at `frame` (m/s); `watch` gives
    /// the force that is watched, the same on all ranks. Collective.
    ///
    /// # Errors
    /// A short step that fails, or no steady state within `max_steps`.
    pub fn run<G: Gas<N>, const N: usize>(
        &self,
        solver: &mut Solver<G, N>,
        frame: Vec3,
        mut watch: impl FnMut(&Solver<G, N>) -> Vec3,
    ) -> Result<MarchReport, FlowError> {
        let drop = std::mem::replace(&mut solver.settings.residual_drop, STEP_DROP);
        let outcome = self.steps(solver, frame, &mut watch);
        solver.settings.residual_drop = drop;
        solver.first_order_steps = 2;
        outcome
    }

    fn steps<G: Gas<N>, const N: usize>(
        &self,
        solver: &mut Solver<G, N>,
        frame: Vec3,
        watch: &mut dyn FnMut(&Solver<G, N>) -> Vec3,
    ) -> Result<MarchReport, FlowError> {
        let n = solver.topology.n_owned;
        let mut sums = [solver.metrics.volume[..n].iter().sum::<f64>(), n as f64];
        solver.comm().sum_slice(&mut sums);
        let (extent, cell) = (sums[0].cbrt(), (sums[0] / sums[1]).cbrt());
        // Settings keep a tenth of the stream's speed.
        let speed = 10.0 * solver.settings.reference_speed;
        let longest = self.max_courant * cell / speed;
        let mut dt = (cell / speed).min(longest);
        let mut marched = MarchReport::default();
        let mut largest: f64 = 0.0;
        let mut last: Vec<(f64, Vec3)> = Vec::new();
        while marched.steps < self.max_steps {
            solver.first_order_steps = 2;
            let report = match solver.advance(&Step { dt, frame, repeat: false, moved: false }) {
                Ok(report) => report,
                Err(error) if dt < 1e-3 * cell / speed => return Err(error),
                Err(_) => {
                    dt *= 0.25;
                    continue;
                }
            };
            marched.steps += 1;
            marched.iterations += report.iterations;
            marched.linear_iterations += report.linear_iterations;
            marched.unsolved += usize::from(!report.met);
            let left = steady_residual(solver, dt);
            largest = largest.max(left);
            marched.drop = left / largest.max(f64::MIN_POSITIVE);
            if last.len() == WATCHED {
                last.remove(0);
            }
            last.push((dt, watch(solver)));
            marched.change = change(&last);
            solver.accept(dt, false);
            // The force may appear steady over short steps: require that the stream has crossed the grid.
            let crossed = last.len() == WATCHED && last.iter().map(|l| l.0).sum::<f64>() * speed > extent;
            let force_converged = crossed && marched.change < self.force_change;
            // The change in an unconverged step is no measure of the steady residual.
            if report.met && (marched.drop < self.residual_drop || force_converged) {
                marched.force_converged = force_converged;
                return Ok(marched);
            }
            let factor = if report.iterations < solver.settings.max_iterations { GROWTH } else { 0.5 };
            dt = (factor * dt).min(longest);
        }
        let MarchReport { steps, drop, change, unsolved, .. } = marched;
        Err(FlowError::Unsteady { steps, drop, change, unsolved })
    }
}

/// Norm of the steady momentum residual, N. Collective.
fn steady_residual<G: Gas<N>, const N: usize>(solver: &Solver<G, N>, dt: f64) -> f64 {
    let cells = solver.q.iter().zip(&solver.previous[0].q).zip(&solver.metrics.volume);
    let sum: f64 = cells
        .take(solver.topology.n_owned)
        .map(|((q, p), v)| {
            let m = solver.spatial.gas.density(q) * v / dt;
            (1..4).map(|d| (m * (q[d] - p[d])).powi(2)).sum::<f64>()
        })
        .sum();
    solver.comm().sum(sum).sqrt()
}

/// Largest difference of the forces from the last one, relative to it.
fn change(last: &[(f64, Vec3)]) -> f64 {
    let Some((_, end)) = last.last() else { return f64::INFINITY };
    let off = last.iter().map(|(_, f)| (f - end).norm()).fold(0.0, f64::max);
    off / end.norm().max(f64::MIN_POSITIVE)
}

/// Solves a window by a march: loads and report of its steady state.
pub(crate) fn solve_window<G: Gas<N>, const N: usize>(
    march: &March,
    solver: &mut Solver<G, N>,
    loads: &mut Loads,
    watched: &Watched,
    frame: Vec3,
) -> Result<(Total, Report), FlowError> {
    let mut total = Total::default();
    let marched = march.run(solver, frame, |s| {
        total = watched.compute(s, loads);
        total.force
    })?;
    // Either criterion of the scene ends a march; without one it returns an error.
    let target =
        if marched.force_converged { march.residual_drop.max(marched.drop) } else { march.residual_drop };
    let report = Report {
        start: 1.0,
        end: marched.drop,
        target,
        met: true,
        cell: CellError::default(),
        iterations: marched.iterations,
        linear_iterations: marched.linear_iterations,
        mass_defect: 0.0,
        round_off: None,
    };
    Ok((total, report))
}
