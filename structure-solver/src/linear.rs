//! The linear solves of Newton's method: GMRES on block rows, preconditioned by
//! direct factors per subdomain that are kept while they serve, or by block Jacobi
//! where that is enough.

use std::time::Instant;

use comm::Comm;
use linalg::{BlockCsr, BlockJacobi, Gmres, KrylovError, KrylovParams, SchwarzLu};

/// What solving has cost so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct LinearCost {
    /// GMRES iterations.
    pub iterations: u64,
    /// Direct factorisations.
    pub factorisations: u64,
    /// Seconds in factorisations.
    pub factorisation_s: f64,
    /// Seconds in GMRES.
    pub solve_s: f64,
}

/// Iterations with a kept factor after which renewing it is the cheaper way.
const PATIENCE: usize = 16;
/// Iterations with block Jacobi beyond which a direct factor is the cheaper way: one
/// of its applications costs about as much as four products.
const JACOBI_LIMIT: usize = 30;
/// Iterations with a fresh factor before a solve is given up.
const LIMIT: usize = 200;

/// What GMRES is preconditioned with. Where inertia dominates (short steps, soft
/// fabric) block Jacobi is enough and costs nothing; the first solve that needs
/// more brings the direct factors, which then stay. Iteration counts decide, never
/// clocks, so that a run can be repeated to the last bit.
enum Preconditioned {
    Jacobi(Option<BlockJacobi<3>>),
    Direct(Box<SchwarzLu<3>>),
}

/// GMRES with a preconditioner that is kept while it serves.
pub struct LinearSolver {
    comm: Comm,
    gmres: Gmres,
    by: Preconditioned,
    /// Least relative tolerance, and that of the solve at hand.
    tolerance: f64,
    relative: f64,
    /// The factor is renewed before the next solve.
    stale: bool,
    /// Costs since construction.
    pub cost: LinearCost,
}

impl LinearSolver {
    /// Relative tolerance of each solve.
    pub fn new(comm: &Comm, tolerance: f64) -> Self {
        Self {
            comm: comm.clone(),
            gmres: Gmres::new(comm),
            by: Preconditioned::Jacobi(None),
            tolerance,
            relative: tolerance,
            stale: true,
            cost: LinearCost::default(),
        }
    }

    /// Least relative tolerance of a solve.
    pub fn tolerance(&self) -> f64 {
        self.tolerance
    }

    /// Solves `A x = b` from zero to the relative `tolerance`. `b` holds owned rows, `x` local ones; the ghosts
    /// of `x` are not current on return. `changed`: the matrix is another one than in
    /// the last solve. All ranks see the same outcome.
    pub fn solve(
        &mut self,
        a: &BlockCsr<3>,
        changed: bool,
        b: &[f64],
        x: &mut [f64],
        tolerance: f64,
    ) -> Result<(), String> {
        self.relative = tolerance;
        if matches!(self.by, Preconditioned::Jacobi(_)) {
            if (!changed || self.jacobi(a)?) && self.gmres(a, b, x, JACOBI_LIMIT).is_ok() {
                return Ok(());
            }
            self.by = Preconditioned::Direct(Box::new(SchwarzLu::plan(a)));
            self.stale = true;
        }
        if !self.stale {
            match self.gmres(a, b, x, PATIENCE) {
                Ok(iterations) => {
                    self.stale = iterations > PATIENCE / 2;
                    return Ok(());
                }
                Err(KrylovError::Stalled { .. }) => return Ok(()),
                Err(_) => {}
            }
        }
        self.refactor(a)?;
        match self.gmres(a, b, x, LIMIT) {
            // A correction to rounding is still one: Newton judges it.
            Ok(_) | Err(KrylovError::Stalled { .. }) => Ok(()),
            Err(e) => {
                self.stale = true;
                Err(e.to_string())
            }
        }
    }

    /// Inverts the diagonal blocks; `false` if one is singular on some rank.
    fn jacobi(&mut self, a: &BlockCsr<3>) -> Result<bool, String> {
        let Preconditioned::Jacobi(jacobi) = &mut self.by else { return Ok(false) };
        let start = Instant::now();
        let good = match jacobi {
            Some(j) => j.refactor(a).is_ok(),
            None => BlockJacobi::new(a).map(|j| *jacobi = Some(j)).is_ok(),
        };
        self.cost.factorisation_s += start.elapsed().as_secs_f64();
        Ok(self.comm.all(good))
    }

    fn gmres(
        &mut self,
        a: &BlockCsr<3>,
        b: &[f64],
        x: &mut [f64],
        limit: usize,
    ) -> Result<usize, KrylovError> {
        let start = Instant::now();
        x.fill(0.0);
        let params =
            KrylovParams { rel_tol: self.relative, max_iterations: limit, restart: 60, ..Default::default() };
        let result = match &self.by {
            Preconditioned::Jacobi(j) => {
                let j = j.as_ref().expect("made before the first solve");
                self.gmres.solve(a, j, b, x, params)
            }
            Preconditioned::Direct(lu) => self.gmres.solve(a, &**lu, b, x, params),
        };
        self.cost.solve_s += start.elapsed().as_secs_f64();
        self.cost.iterations += self.gmres.history().len().saturating_sub(1) as u64;
        result.map(|info| info.iterations)
    }

    fn refactor(&mut self, a: &BlockCsr<3>) -> Result<(), String> {
        let Preconditioned::Direct(lu) = &mut self.by else { return Ok(()) };
        let start = Instant::now();
        let result = lu.refactor(a).map_err(|e| e.to_string());
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
