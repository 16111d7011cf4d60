//! The linear solves of Newton's method: GMRES on block rows, preconditioned by
//! direct factors that are kept while they serve (of all ranks together or per subdomain), or by block Jacobi
//! where that is enough.

use std::time::Instant;

use comm::Comm;
use linalg::{
    BlockCsr, BlockJacobi, CondensedLu, FactorError, Gmres, KrylovError, KrylovParams, Preconditioner,
    SchwarzLu,
};

use crate::warm_start::{DirectWarmStart, LinearWarmStart};

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

/// Iterations with block Jacobi beyond which a direct factor is the cheaper way: one
/// of its applications costs about as much as four products.
const JACOBI_LIMIT: usize = 30;
/// Iterations with a fresh factor before a solve is given up.
const LIMIT: usize = 200;
/// Rows on some rank beyond which its subdomain is cut into parts of `PART` rows that
/// overlap by `LAYERS`: from there on the factor of the whole grows too dear.
const WHOLE: usize = 20_000;
const PART: usize = 5_000;
const LAYERS: usize = 3;
/// Iterations with fresh factors of parts beyond which inertia is too weak for them, and
/// each rank takes one factor of all its rows; and with those of the symmetric part beyond
/// which they are of the matrix itself.
const PARTS_LIMIT: usize = 60;
/// Iterations after which the pace with a kept factor shows whether it still serves.
const PATIENCE: usize = 3;
/// Iterations that a factorisation is worth, of its multiplications over the bytes of the
/// factor: an iteration reads that once, and about as much other data.
const OF_RATIO: f64 = 0.5;

/// What GMRES is preconditioned with. Where inertia dominates (short steps, soft
/// fabric) block Jacobi is enough and costs nothing; the first solve that needs
/// more brings the direct factors, which then stay. Iteration counts decide, never
/// clocks, so that a run can be repeated to the last bit.
enum Preconditioned {
    Jacobi(Option<BlockJacobi<3>>),
    Direct(Box<Direct>),
}

/// Which direct factors there are. Each costs more than the one before and serves more matrices.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
enum Kind {
    /// Of the symmetric part in several subdomains on a rank.
    Cut = 1,
    /// Of the symmetric part. A tangent differs from it by follower loads and friction.
    Symmetric = 0,
    /// Of the matrix itself.
    Whole = 2,
}

impl Kind {
    /// That of a number of a saved state.
    fn saved(number: u8) -> Self {
        match number {
            0 => Self::Symmetric,
            1 => Self::Cut,
            _ => Self::Whole,
        }
    }
}

/// A factor over all ranks.
enum Factor {
    /// Of each rank's rows and a few around them, or of parts of them.
    Schwarz(Box<SchwarzLu<3>>),
    /// Of the whole, where the interface between the ranks is small.
    Condensed(Box<CondensedLu<3>>),
}

impl Factor {
    /// Collective.
    fn plan(a: &BlockCsr<3>, kind: Kind) -> Self {
        let condensed = match kind {
            _ if a.halo().comm().size() == 1 => None,
            Kind::Cut => None,
            Kind::Symmetric => CondensedLu::plan_symmetric(a),
            Kind::Whole => CondensedLu::plan(a),
        };
        condensed.map(|lu| Self::Condensed(Box::new(lu))).unwrap_or_else(|| {
            Self::Schwarz(Box::new(match kind {
                Kind::Cut => SchwarzLu::plan_symmetric(a, PART, LAYERS),
                Kind::Symmetric => SchwarzLu::plan_symmetric(a, usize::MAX, 0),
                Kind::Whole => SchwarzLu::plan(a),
            }))
        })
    }

    fn refactor(&mut self, a: &BlockCsr<3>) -> Result<(), FactorError> {
        match self {
            Self::Schwarz(lu) => lu.refactor(a),
            Self::Condensed(lu) => lu.refactor(a),
        }
    }

    /// Multiplications of a factorisation over the bytes of the factor, on this rank.
    fn ratio(&self) -> f64 {
        let (flops, bytes) = match self {
            Self::Schwarz(lu) => (lu.flops(), lu.bytes()),
            Self::Condensed(lu) => (lu.flops(), lu.bytes()),
        };
        flops as f64 / bytes.max(1) as f64
    }
}

impl Preconditioner for Factor {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        match self {
            Self::Schwarz(lu) => lu.apply(r, z),
            Self::Condensed(lu) => lu.apply(r, z),
        }
    }
}

/// Direct factors that are kept while they serve.
struct Direct {
    lu: Factor,
    kind: Kind,
    /// Iterations that cost about as much as a factorisation, the same on all ranks.
    worth: usize,
    /// Iterations of the first solve with the present factor, and its relative tolerance.
    fresh: usize,
    at: f64,
    /// Values of the matrix that was factorised last.
    of: Vec<[[f64; 3]; 3]>,
}

impl Direct {
    /// Collective.
    fn new(a: &BlockCsr<3>, kind: Kind) -> Self {
        let lu = Factor::plan(a, kind);
        let ratio = a.halo().comm().max(lu.ratio());
        Self {
            lu,
            kind,
            worth: (OF_RATIO * ratio).clamp(4.0, 16.0) as usize,
            fresh: 1,
            at: 1.0,
            of: Vec::new(),
        }
    }

    /// Iterations that a fresh factor would need to the tolerance `relative`.
    fn expected(&self, relative: f64) -> usize {
        let share = if self.at > 0.0 && self.at < 1.0 { relative.ln() / self.at.ln() } else { 1.0 };
        (self.fresh as f64 * share).ceil().min(LIMIT as f64) as usize
    }
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
        let _part = timing::part("linear solve");
        self.relative = tolerance;
        x.fill(0.0);
        if matches!(self.by, Preconditioned::Jacobi(_)) {
            if (!changed || self.jacobi(a)?) && self.gmres(a, b, x, JACOBI_LIMIT, JACOBI_LIMIT).is_ok() {
                return Ok(());
            }
            x.fill(0.0);
            let cut = self.comm.max(a.n_rows() as f64) > WHOLE as f64;
            let kind = if cut { Kind::Cut } else { Kind::Symmetric };
            self.by = Preconditioned::Direct(Box::new(Direct::new(a, kind)));
            self.stale = true;
        }
        if !self.stale {
            let Preconditioned::Direct(d) = &self.by else { unreachable!("made above") };
            let (expected, worth) = (d.expected(tolerance), d.worth);
            match self.gmres(a, b, x, expected + worth, PATIENCE) {
                Ok(iterations) => {
                    self.stale = iterations > expected + worth / 2;
                    return Ok(());
                }
                Err(KrylovError::Stalled { .. }) => return Ok(()),
                // What was found is a better start than zero.
                Err(KrylovError::NotConverged { .. }) => {}
                Err(_) => x.fill(0.0),
            }
        }
        loop {
            let next = match &self.by {
                Preconditioned::Direct(d) if d.kind == Kind::Cut => Some(Kind::Symmetric),
                Preconditioned::Direct(d) if d.kind == Kind::Symmetric => Some(Kind::Whole),
                _ => None,
            };
            let limit = if next.is_some() { PARTS_LIMIT } else { LIMIT };
            match (self.fresh(a, b, x, limit), next) {
                // A correction to rounding is still one: Newton judges it.
                (Ok(Ok(_) | Err(KrylovError::Stalled { .. })), _) => return Ok(()),
                // A matrix that has an inverse may have a singular symmetric part.
                (Err(_) | Ok(Err(KrylovError::NotConverged { .. })), Some(kind)) => {
                    self.by = Preconditioned::Direct(Box::new(Direct::new(a, kind)));
                }
                (Err(cause), None) => return Err(cause),
                (Ok(Err(e)), _) => {
                    self.stale = true;
                    return Err(e.to_string());
                }
            }
        }
    }

    /// Factorises and solves from the guess in `x`.
    fn fresh(
        &mut self,
        a: &BlockCsr<3>,
        b: &[f64],
        x: &mut [f64],
        limit: usize,
    ) -> Result<Result<usize, KrylovError>, String> {
        self.refactor(a)?;
        let result = self.gmres(a, b, x, limit, limit);
        if let (Preconditioned::Direct(d), [first, .., last]) = (&mut self.by, self.gmres.history()) {
            (d.fresh, d.at) = (self.gmres.history().len() - 1, last / first);
        }
        Ok(result)
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
        patience: usize,
    ) -> Result<usize, KrylovError> {
        let _part = timing::part("GMRES");
        let start = Instant::now();
        let params = KrylovParams {
            rel_tol: self.relative,
            max_iterations: limit,
            restart: 60,
            patience,
            ..Default::default()
        };
        let result = match &self.by {
            Preconditioned::Jacobi(j) => {
                let j = j.as_ref().expect("made before the first solve");
                self.gmres.solve(a, j, b, x, params)
            }
            Preconditioned::Direct(d) => self.gmres.solve(a, &d.lu, b, x, params),
        };
        self.cost.solve_s += start.elapsed().as_secs_f64();
        self.cost.iterations += self.gmres.history().len().saturating_sub(1) as u64;
        result.map(|info| info.iterations)
    }

    fn refactor(&mut self, a: &BlockCsr<3>) -> Result<(), String> {
        let _part = timing::part("factorisation");
        let Preconditioned::Direct(d) = &mut self.by else { return Ok(()) };
        let start = Instant::now();
        let result = d.lu.refactor(a).map_err(|e| e.to_string());
        d.of.clone_from(&a.values);
        self.cost.factorisation_s += start.elapsed().as_secs_f64();
        self.cost.factorisations += 1;
        self.stale = result.is_err();
        result
    }

    /// What is kept from step to step. A factor is kept as the matrix that it is of, which is far
    /// smaller.
    pub fn save_state(&self) -> LinearWarmStart {
        let direct = match &self.by {
            Preconditioned::Jacobi(_) => None,
            Preconditioned::Direct(d) => Some(DirectWarmStart {
                kind: d.kind as u8,
                fresh: d.fresh as u64,
                at: d.at,
                matrix: if self.stale { Vec::new() } else { d.of.clone() },
            }),
        };
        LinearWarmStart { direct, stale: self.stale }
    }

    /// Takes up a [`LinearSolver::save_state`] for matrices with the pattern of `a`, whose values are
    /// lost. Collective.
    pub fn restore_state(&mut self, memory: LinearWarmStart, a: &mut BlockCsr<3>) {
        self.stale = memory.stale;
        let Some(m) = memory.direct else { return };
        let mut direct = Direct::new(a, Kind::saved(m.kind));
        (direct.fresh, direct.at) = (m.fresh as usize, m.at);
        if !m.matrix.is_empty() {
            a.values.clone_from(&m.matrix);
            // What was factorised once can be again.
            self.stale |= direct.lu.refactor(a).is_err();
            direct.of = m.matrix;
        }
        self.by = Preconditioned::Direct(Box::new(direct));
    }

    /// Renews the factor before the next solve (after a change of time step).
    pub fn renew(&mut self) {
        self.stale = true;
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use comm::Halo;
    use linalg::Operator;

    use super::*;

    /// A ring whose rows turn into each other: nearly all of the matrix is skew, and its symmetric
    /// part says next to nothing about it.
    fn turning(n: usize) -> BlockCsr<3> {
        let near = |i: usize| [1, 7].map(|k| [((i + k) % n) as u32, ((i + n - k) % n) as u32]).concat();
        let lists: Vec<Vec<u32>> = (0..n).map(near).collect();
        let mut a = BlockCsr::<3>::from_adjacency(Rc::new(Halo::solo(n)), &lists);
        for i in 0..n {
            for s in a.row(i) {
                let j = a.cols()[s] as usize;
                let forward = (j + n - i) % n < n / 2;
                let v = if i == j {
                    1.0
                } else if forward {
                    40.0 + i as f64
                } else {
                    -40.0 - j as f64
                };
                a.values[s] = std::array::from_fn(|r| std::array::from_fn(|c| if r == c { v } else { 0.0 }));
            }
        }
        a
    }

    fn is_whole(solver: &LinearSolver) -> bool {
        matches!(&solver.by, Preconditioned::Direct(d) if d.kind == Kind::Whole)
    }

    #[test]
    fn a_matrix_far_from_its_symmetric_part_is_factorised_itself_after_a_restart_too() {
        let mut a = turning(300);
        let b: Vec<f64> = (0..900).map(|i| (i as f64 * 0.3).sin()).collect();
        let (mut x, mut y) = (vec![0.0; 900], vec![0.0; 900]);
        let mut solver = LinearSolver::new(&Comm::solo(), 1e-8);
        solver.solve(&a, true, &b, &mut x, 1e-8).unwrap();
        a.apply(&mut x, &mut y);
        assert!(y.iter().zip(&b).all(|(y, b)| (y - b).abs() < 1e-5));
        assert!(is_whole(&solver));
        let mut other = LinearSolver::new(&Comm::solo(), 1e-8);
        other.restore_state(solver.save_state(), &mut a);
        assert!(is_whole(&other));
        let mut again = vec![0.0; 900];
        for (solver, x) in [(&mut solver, &mut x), (&mut other, &mut again)] {
            solver.solve(&a, true, &b, x, 1e-8).unwrap();
        }
        assert_eq!(x, again);
    }

    #[test]
    fn a_kept_factor_that_is_slow_is_renewed_after_a_few_iterations() {
        let mut a = turning(300);
        let b: Vec<f64> = (0..900).map(|i| (i as f64 * 0.3).sin()).collect();
        let mut x = vec![0.0; 900];
        let mut solver = LinearSolver::new(&Comm::solo(), 1e-8);
        solver.solve(&a, true, &b, &mut x, 1e-8).unwrap();
        let before = solver.cost;
        for (k, v) in a.values.iter_mut().enumerate() {
            v.iter_mut().flatten().for_each(|v| *v *= 1.0 + 0.9 * (k as f64).sin());
        }
        solver.solve(&a, true, &b, &mut x, 1e-8).unwrap();
        assert_eq!(solver.cost.factorisations, before.factorisations + 1);
        let iterations = solver.cost.iterations - before.iterations;
        let Preconditioned::Direct(direct) = &solver.by else { panic!("Jacobi served") };
        assert_eq!(iterations, (PATIENCE + direct.fresh) as u64);
    }
}
