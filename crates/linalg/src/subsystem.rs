//! Some rows of a matrix, solved for with all other unknowns held.

use std::cell::RefCell;
use std::rc::Rc;

use comm::Halo;

use crate::ilu::BlockIlu0;
use crate::{BlockCsr, Gmres, KrylovError, KrylovParams, Operator, SingularBlock};

/// Solver for the square part of a distributed matrix in a set of rows that may change
/// with each call: GMRES over all ranks, preconditioned by each rank's ILU(0) in single
/// precision.
pub struct Subsystem<const B: usize> {
    halo: Rc<Halo>,
    ilu: BlockIlu0<B, f32>,
    /// Owned rows of the set, and the ghosts that belong to it.
    rows: Vec<u32>,
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
            rows: Vec::new(),
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
        let Self { halo, ilu, rows, ghosts, far, whole, krylov, b, x: solution, .. } = self;
        let part = Part { a, halo, pattern: ilu, rows, ghosts, far, whole };
        let result = krylov.solve(&part, &*ilu, b, solution, params);
        for (&i, v) in rows.iter().zip(solution.as_chunks::<B>().0) {
            x[i as usize] = *v;
        }
        Ok(result?.iterations)
    }
}

struct Part<'a, const B: usize> {
    a: &'a BlockCsr<B>,
    halo: &'a Halo,
    pattern: &'a BlockIlu0<B, f32>,
    rows: &'a [u32],
    ghosts: &'a [u32],
    far: &'a [(u32, u32, usize)],
    whole: &'a RefCell<Vec<f64>>,
}

impl<const B: usize> Part<'_, B> {
    fn near(&self, x: &[[f64; B]], y: &mut [[f64; B]]) {
        for (i, y) in y.iter_mut().enumerate() {
            *y = [0.0; B];
            for (j, slot) in self.pattern.row(i) {
                add_product(&self.a.values[slot], &x[j], y);
            }
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
            return self.near(x, y);
        }
        let mut whole = self.whole.borrow_mut();
        {
            let whole = whole.as_chunks_mut::<B>().0;
            for (&i, x) in self.rows.iter().zip(x.iter()) {
                whole[i as usize] = *x;
            }
        }
        self.halo.overlap(&mut whole, B, |_| self.near(x, y));
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
}
