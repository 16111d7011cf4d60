//! The linear solves of Newton's method: GMRES on block rows, preconditioned by
//! direct factors per subdomain that are kept while they serve.

use std::time::Instant;

use comm::Comm;
use linalg::{BlockCsr, BlockJacobi as SchwarzLu, Gmres, KrylovParams};

/// What solving has cost so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinearCost {
    /// GMRES iterations.
    pub iterations: u64,
    /// Factorisations.
    pub factorisations: u64,
    /// Seconds in factorisations.
    pub factorisation_s: f64,
    /// Seconds in GMRES.
    pub solve_s: f64,
}

/// GMRES with a kept factorisation.
pub struct LinearSolver {
    comm: Comm,
    gmres: Gmres,
    factor: Option<SchwarzLu<3>>,
    tolerance: f64,
    /// The factor is renewed before the next solve.
    stale: bool,
    /// Costs since construction.
    pub cost: LinearCost,
}

/// Iterations after which renewing the factor is the cheaper way.
const PATIENCE: usize = 12;
/// Iterations with a fresh factor before a solve is given up.
const LIMIT: usize = 200;

impl LinearSolver {
    /// Relative tolerance of each solve.
    pub fn new(comm: &Comm, tolerance: f64) -> Self {
        Self {
            comm: comm.clone(),
            gmres: Gmres::new(comm),
            factor: None,
            tolerance,
            stale: true,
            cost: LinearCost::default(),
        }
    }

    /// Solves `A x = b` from zero. `b` holds owned rows, `x` local ones; the ghosts
    /// of `x` are not current on return.
    pub fn solve(&mut self, a: &BlockCsr<3>, b: &[f64], x: &mut [f64]) -> Result<(), String> {
        let mut fresh = false;
        if self.stale || self.factor.is_none() {
            self.refactor(a)?;
            fresh = true;
        }
        x.fill(0.0);
        loop {
            let limit = if fresh { LIMIT } else { PATIENCE };
            let start = Instant::now();
            let factor = self.factor.as_ref().expect("made above");
            let params =
                KrylovParams { rel_tol: self.tolerance, max_iterations: limit, restart: 60, ..Default::default() };
            let result = self.gmres.solve(a, factor, b, x, params);
            self.cost.solve_s += start.elapsed().as_secs_f64();
            self.cost.iterations += self.gmres.history().len().saturating_sub(1) as u64;
            match result {
                Ok(info) => {
                    // All ranks see the same count, so they renew together.
                    self.stale = !fresh && info.iterations > PATIENCE / 2;
                    return Ok(());
                }
                Err(linalg::KrylovError::Stalled { .. }) => return Ok(()),
                Err(e) if fresh => {
                    self.stale = true;
                    return Err(e.to_string());
                }
                Err(_) => {
                    x.fill(0.0);
                    self.refactor(a)?;
                    fresh = true;
                }
            }
        }
    }

    fn refactor(&mut self, a: &BlockCsr<3>) -> Result<(), String> {
        let start = Instant::now();
        let result = match &mut self.factor {
            Some(f) => f.refactor(a).map_err(|e| e.to_string()),
            None => SchwarzLu::new(a).map(|f| self.factor = Some(f)).map_err(|e| e.to_string()),
        };
        // A subdomain may be singular on one rank alone: all must hear of it.
        let all = self.comm.all(result.is_ok());
        let result = if all { result } else { result.and(Err("another rank found its block singular".into())) };
        self.cost.factorisation_s += start.elapsed().as_secs_f64();
        self.cost.factorisations += 1;
        self.stale = result.is_err();
        result
    }

    /// Renews the factor before the next solve (after a change of time step).
    pub fn renew(&mut self) {
        self.stale = true;
    }
}
