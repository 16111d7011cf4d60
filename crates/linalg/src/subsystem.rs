//! Some rows of a matrix, solved for with all other unknowns held.

use std::cell::RefCell;
use std::rc::Rc;

use comm::Halo;

use crate::block::accumulate;
use crate::direct::{self, BlockLu, largest};
use crate::ilu::BlockIlu0;
use crate::{
    BlockCsr, FactorError, Gmres, KrylovError, KrylovInfo, KrylovParams, Operator, Preconditioner,
    SingularBlock,
};

/// Iterations with an incomplete factor at most, and after how many their pace is judged: a
/// direct factor costs about as much as the former.
const QUICK: usize = 16;
const PATIENCE: usize = 5;

/// Solver for the square part of a distributed matrix in a set of rows that may change
/// with each call: GMRES over all ranks, preconditioned by each rank's ILU(0), and where
/// that does not serve by a direct factor of its rows, both in single precision.
pub struct Subsystem<const B: usize> {
    halo: Rc<Halo>,
    ilu: BlockIlu0<B, f32>,
    lu: BlockLu<B, f32>,
    /// Owned rows of the set, and the ghosts that belong to it.
    rows: Vec<u32>,
    /// Rows that the factor is planned for.
    planned: Vec<u32>,
    ghosts: Vec<u32>,
    /// Number in the set of each local row, or `u32::MAX`.
    index: Vec<u32>,
    /// Couplings of the set's rows to its ghosts: both in the set's numbers, and the slot.
    far: Vec<(u32, u32, usize)>,
    /// Carries values from rank to rank, `[n_local][B]`.
    whole: RefCell<Vec<f64>>,
    krylov: Gmres,
    b: Vec<f64>,
    x: Vec<f64>,
}

/// Why a subsystem was not solved.
#[derive(Clone, Debug, thiserror::Error)]
pub enum SubsystemError {
    /// A diagonal block has no inverse.
    #[error(transparent)]
    Singular(#[from] SingularBlock),
    /// The same on another rank.
    #[error("a diagonal block on another rank is singular")]
    OtherRank,
    /// The iteration failed.
    #[error(transparent)]
    Krylov(#[from] KrylovError),
}

impl<const B: usize> Subsystem<B> {
    /// Of matrices on `halo`.
    pub fn new(halo: &Rc<Halo>) -> Self {
        Self {
            halo: halo.clone(),
            ilu: BlockIlu0::empty(),
            lu: BlockLu::of_rows(&[0], &[], &[], direct::Part::Symmetric),
            rows: Vec::new(),
            planned: Vec::new(),
            ghosts: Vec::new(),
            index: Vec::new(),
            far: Vec::new(),
            whole: RefCell::new(Vec::new()),
            krylov: Gmres::new(halo.comm()),
            b: Vec::new(),
            x: Vec::new(),
        }
    }

    /// Solves `A x = b` in the `active` rows of `a` (shape `[n_local]`, with current
    /// ghosts); `b` and `x` are whole vectors, of which the numbers of owned active rows
    /// are read and set, to the best iterate where GMRES gave up. Returns the iterations.
    /// Collective.
    pub fn solve(
        &mut self,
        a: &BlockCsr<B>,
        active: &[bool],
        b: &[f64],
        x: &mut [f64],
        params: KrylovParams,
    ) -> Result<usize, SubsystemError> {
        let n = a.n_rows();
        self.rows.clear();
        self.rows.extend((0..n as u32).filter(|&i| active[i as usize]));
        self.ghosts.clear();
        self.ghosts.extend((n as u32..active.len() as u32).filter(|&i| active[i as usize]));
        self.index.clear();
        self.index.resize(active.len(), u32::MAX);
        for (k, &i) in self.rows.iter().chain(&self.ghosts).enumerate() {
            self.index[i as usize] = k as u32;
        }
        let good = self.ilu.refit(a, &self.rows, &self.index[..n]);
        if !self.halo.comm().all(good.is_ok()) {
            good?;
            return Err(SubsystemError::OtherRank);
        }
        self.far.clear();
        if !self.ghosts.is_empty() {
            for (k, &i) in self.rows.iter().enumerate() {
                // Columns ascend: ghosts are last.
                for s in a.row(i as usize).rev().take_while(|&s| a.cols()[s] as usize >= n) {
                    let j = self.index[a.cols()[s] as usize];
                    if j != u32::MAX {
                        self.far.push((k as u32, j, s));
                    }
                }
            }
        }
        self.whole.get_mut().resize(active.len() * B, 0.0);
        let (b, x) = (b.as_chunks::<B>().0, x.as_chunks_mut::<B>().0);
        self.b.clear();
        self.b.extend(self.rows.iter().flat_map(|&i| b[i as usize]));
        self.x.clear();
        self.x.resize((self.rows.len() + self.ghosts.len()) * B, 0.0);
        let result = self.iterate(a, params);
        for (&i, v) in self.rows.iter().zip(self.x.as_chunks::<B>().0) {
            x[i as usize] = *v;
        }
        Ok(result?)
    }

    /// Solves for `self.x` from the guess there; returns the iterations.
    fn iterate(&mut self, a: &BlockCsr<B>, params: KrylovParams) -> Result<usize, KrylovError> {
        let quick =
            KrylovParams { max_iterations: params.max_iterations.min(QUICK), patience: PATIENCE, ..params };
        let first = match self.gmres(a, false, quick) {
            Err(KrylovError::NotConverged { iterations, .. }) => iterations,
            other => return other.map(|info| info.iterations),
        };
        let good = self.factor(a).is_ok();
        let direct = self.halo.comm().all(good);
        Ok(first + self.gmres(a, direct, params)?.iterations)
    }

    /// Continues from the guess in `self.x` with the incomplete factor or the direct one.
    fn gmres(
        &mut self,
        a: &BlockCsr<B>,
        direct: bool,
        params: KrylovParams,
    ) -> Result<KrylovInfo, KrylovError> {
        let Self { halo, ilu, lu, rows, ghosts, index, far, whole, krylov, b, x, .. } = self;
        let part = Part { a, halo, rows, ghosts, index, far, whole };
        let by: &dyn Preconditioner = if direct { lu } else { ilu };
        krylov.solve(&part, by, b, x, params)
    }

    /// Factorises this rank's rows of the set. A plan is made only where others did not serve, and
    /// takes memory.
    fn factor(&mut self, a: &BlockCsr<B>) -> Result<(), FactorError> {
        if self.planned != self.rows {
            self.lu = BlockLu::of_rows(a.row_ptr(), a.cols(), &self.rows, direct::Part::Symmetric);
            self.planned.clone_from(&self.rows);
        }
        let of_row = |i: &u32| largest(a.values[a.row(*i as usize)].as_flattened().as_flattened());
        let largest = self.rows.iter().map(of_row).fold(0.0, f64::max);
        self.lu.factor_scaled(&a.values, largest)
    }
}

impl<const B: usize> Preconditioner for BlockLu<B, f32> {
    fn apply(&self, r: &[f64], z: &mut [f64]) {
        z[..r.len()].copy_from_slice(r);
        self.solve(z);
    }
}

struct Part<'a, const B: usize> {
    a: &'a BlockCsr<B>,
    halo: &'a Halo,
    rows: &'a [u32],
    ghosts: &'a [u32],
    index: &'a [u32],
    far: &'a [(u32, u32, usize)],
    whole: &'a RefCell<Vec<f64>>,
}

impl<const B: usize> Part<'_, B> {
    fn near(&self, x: &[[f64; B]], y: &mut [[f64; B]]) {
        for (&i, y) in self.rows.iter().zip(y) {
            let row = self.a.row(i as usize);
            let mut sums = [[0.0; B]; B];
            for (&j, block) in self.a.cols()[row.clone()].iter().zip(&self.a.values[row]) {
                // Ghosts have numbers beyond those of the rows.
                if let Some(x) = x.get(self.index[j as usize] as usize) {
                    accumulate(&mut sums, block, x);
                }
            }
            *y = sums.map(|s| s.iter().sum());
        }
    }
}

#[inline(always)]
fn add_product<const B: usize>(a: &[[f64; B]; B], x: &[f64; B], y: &mut [f64; B]) {
    for r in 0..B {
        (0..B).for_each(|c| y[r] += a[r][c] * x[c]);
    }
}

impl<const B: usize> Operator for Part<'_, B> {
    fn n_owned(&self) -> usize {
        self.rows.len() * B
    }
    fn n_local(&self) -> usize {
        (self.rows.len() + self.ghosts.len()) * B
    }
    fn apply(&self, x: &mut [f64], y: &mut [f64]) {
        let y = &mut y.as_chunks_mut::<B>().0[..self.rows.len()];
        let x = x.as_chunks_mut::<B>().0;
        if self.halo.comm().size() == 1 {
            return self.near(&x[..self.rows.len()], y);
        }
        let mut whole = self.whole.borrow_mut();
        {
            let whole = whole.as_chunks_mut::<B>().0;
            for (&i, x) in self.rows.iter().zip(x.iter()) {
                whole[i as usize] = *x;
            }
        }
        self.halo.overlap(&mut whole, B, |_| self.near(&x[..self.rows.len()], y));
        let whole = whole.as_chunks::<B>().0;
        for (&i, x) in self.ghosts.iter().zip(&mut x[self.rows.len()..]) {
            *x = whole[i as usize];
        }
        for &(i, j, slot) in self.far {
            add_product(&self.a.values[slot], &x[j as usize], &mut y[i as usize]);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use comm::Halo;

    /// A ring of springs with ground: the rows asked for balance, the others stay.
    #[test]
    fn solves_the_rows_asked_for() {
        let n = 40usize;
        let lists: Vec<Vec<u32>> =
            (0..n).map(|i| vec![((i + n - 1) % n) as u32, ((i + 1) % n) as u32]).collect();
        let mut a = BlockCsr::<2>::from_adjacency(Rc::new(Halo::solo(n)), &lists);
        for i in 0..n {
            for s in a.row(i) {
                let d = if a.cols()[s] as usize == i { 2.5 } else { -1.0 };
                a.values[s] = [[d, 0.1], [0.0, d]];
            }
        }
        let b: Vec<f64> = (0..2 * n).map(|i| (i as f64 * 0.7).cos()).collect();
        let mut x = vec![0.0; 2 * n];
        let mut subsystem = Subsystem::new(a.halo());
        let params = KrylovParams { rel_tol: 1e-12, ..Default::default() };
        for rows in [vec![3u32, 4, 5, 6, 20], vec![9, 10], (0..n as u32).collect()] {
            x.fill(0.0);
            let mut active = vec![false; n];
            rows.iter().for_each(|&i| active[i as usize] = true);
            subsystem.solve(&a, &active, &b, &mut x, params).unwrap();
            let mut y = vec![0.0; 2 * n];
            a.apply(&mut x, &mut y);
            for i in 0..2 * n {
                if rows.contains(&(i as u32 / 2)) {
                    assert!((y[i] - b[i]).abs() < 1e-9, "row {i}");
                } else {
                    assert_eq!(x[i], 0.0);
                }
            }
        }
    }

    /// A sheet of springs on weak ground: ILU(0) would take hundreds of iterations, the direct
    /// factor next to none.
    #[test]
    fn a_direct_factor_takes_over_where_the_incomplete_one_is_slow() {
        let m = 40usize;
        let near = |k: usize| {
            let (i, j) = (k / m, k % m);
            let inside = [
                (i > 0, k.wrapping_sub(m)),
                (i + 1 < m, k + m),
                (j > 0, k.wrapping_sub(1)),
                (j + 1 < m, k + 1),
            ];
            inside.into_iter().filter(|(inside, _)| *inside).map(|(_, k)| k as u32).collect::<Vec<u32>>()
        };
        let lists: Vec<Vec<u32>> = (0..m * m).map(near).collect();
        let mut a = BlockCsr::<1>::from_adjacency(Rc::new(Halo::solo(m * m)), &lists);
        for (i, list) in lists.iter().enumerate() {
            for s in a.row(i) {
                a.values[s] = if a.cols()[s] as usize == i { [[list.len() as f64 + 1e-3]] } else { [[-1.0]] };
            }
        }
        let b: Vec<f64> = (0..m * m).map(|i| (i as f64 * 0.7).cos() + 1.0).collect();
        let mut x = vec![0.0; m * m];
        let params = KrylovParams { rel_tol: 1e-8, ..Default::default() };
        let mut subsystem = Subsystem::new(a.halo());
        let iterations = subsystem.solve(&a, &vec![true; m * m], &b, &mut x, params).unwrap();
        assert!(iterations > PATIENCE && iterations < QUICK + 6, "{iterations}");
        let mut y = vec![0.0; m * m];
        a.apply(&mut x, &mut y);
        assert!(y.iter().zip(&b).all(|(y, b)| (y - b).abs() < 1e-5));
    }
}
