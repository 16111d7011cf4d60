//! Some rows of a matrix, solved for with all other unknowns held.

use comm::Comm;

use crate::{BlockCsr, BlockIlu0, Gmres, KrylovError, KrylovParams, Operator, SingularBlock};

/// Solver for the square part of a matrix in a list of rows that may change with each
/// call. It belongs to one rank: other ranks' rows are held too. ILU(0) in single
/// precision and GMRES.
pub struct Subsystem<const B: usize> {
    ilu: BlockIlu0<B, f32>,
    index: Vec<u32>,
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
    /// The iteration failed.
    #[error(transparent)]
    Krylov(#[from] KrylovError),
}

impl<const B: usize> Default for Subsystem<B> {
    fn default() -> Self {
        Self {
            ilu: BlockIlu0::empty(),
            index: Vec::new(),
            krylov: Gmres::new(&Comm::solo()),
            b: Vec::new(),
            x: Vec::new(),
        }
    }
}

impl<const B: usize> Subsystem<B> {
    /// Solves `A x = b` in `rows` of `a`; `b` and `x` are whole vectors, of which the
    /// numbers of `rows` are read and set, to the best iterate where GMRES gave up.
    /// Returns the iterations.
    pub fn solve(
        &mut self,
        a: &BlockCsr<B>,
        rows: &[u32],
        b: &[f64],
        x: &mut [f64],
        params: KrylovParams,
    ) -> Result<usize, SubsystemError> {
        self.index.clear();
        self.index.resize(a.n_rows(), u32::MAX);
        for (k, &i) in rows.iter().enumerate() {
            self.index[i as usize] = k as u32;
        }
        self.ilu.refit(a, rows, &self.index)?;
        let (b, x) = (b.as_chunks::<B>().0, x.as_chunks_mut::<B>().0);
        self.b.clear();
        self.b.extend(rows.iter().flat_map(|&i| b[i as usize]));
        self.x.resize(self.b.len(), 0.0);
        let part = Part { a, pattern: &self.ilu, n: self.b.len() };
        self.x.fill(0.0);
        let result = self.krylov.solve(&part, &self.ilu, &self.b, &mut self.x, params);
        for (&i, v) in rows.iter().zip(self.x.as_chunks::<B>().0) {
            x[i as usize] = *v;
        }
        Ok(result?.iterations)
    }
}

struct Part<'a, const B: usize> {
    a: &'a BlockCsr<B>,
    pattern: &'a BlockIlu0<B, f32>,
    n: usize,
}

impl<const B: usize> Operator for Part<'_, B> {
    fn n_owned(&self) -> usize {
        self.n
    }
    fn n_local(&self) -> usize {
        self.n
    }
    fn apply(&self, x: &mut [f64], y: &mut [f64]) {
        let (x, y) = (x.as_chunks::<B>().0, y.as_chunks_mut::<B>().0);
        for (i, y) in y.iter_mut().enumerate() {
            *y = [0.0; B];
            for (j, slot) in self.pattern.row(i) {
                let (block, x) = (&self.a.values[slot], &x[j]);
                for r in 0..B {
                    (0..B).for_each(|c| y[r] += block[r][c] * x[c]);
                }
            }
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
        let mut subsystem = Subsystem::default();
        let params = KrylovParams { rel_tol: 1e-12, ..Default::default() };
        for rows in [vec![3u32, 4, 5, 6, 20], vec![9, 10], (0..n as u32).collect()] {
            x.fill(0.0);
            subsystem.solve(&a, &rows, &b, &mut x, params).unwrap();
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
