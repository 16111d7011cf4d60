//! Agglomeration multigrid for the pressure equation, in single precision.
//!
//! Cells that are coupled strongly are merged, about eight into one from level to
//! level. A coarse coupling is the sum of the fine ones that it stands for, each
//! reduced by how much further apart the merged cells lie than the fine ones: what
//! a finite volume method on the coarse cells would give. Transfers are constant on
//! each coarse cell, the smoother is one Gauss-Seidel sweep, forward before and
//! backward after the coarse correction, so one cycle is a symmetric operator that
//! conjugate gradients can be preconditioned with.

mod coarsen;
mod coarsest;

use comm::{Comm, Halo};
use serde::{Deserialize, Serialize};

use crate::topology::Adjacency;
use coarsen::{Coarse, MergedLevel};
use coarsest::Coarsest;

/// Symmetric matrix $`(m_i + \sum_j k_{ij}) x_i - \sum_j k_{ij} x_j`$ in the rows of
/// an [`Adjacency`].
#[derive(Clone, Debug, Default)]
pub struct Matrix {
    /// $`m_i\ge 0`$ of each owned row: storage and open boundaries.
    pub own: Vec<f32>,
    /// $`k_{ij}\ge 0`$ of each entry, and one more that nobody reads.
    pub off: Vec<f32>,
    /// Diagonal, filled by [`Matrix::complete`].
    pub diagonal: Vec<f32>,
    inverse: Vec<f32>,
}

impl Matrix {
    /// For the rows of `rows`.
    pub fn new(rows: &Adjacency) -> Self {
        let n = rows.start.len() - 1;
        Self {
            own: vec![0.0; n],
            off: vec![0.0; rows.cell.len() + 1],
            diagonal: vec![0.0; n],
            inverse: vec![0.0; n],
        }
    }

    /// Diagonal from `own` and `off`.
    pub fn complete(&mut self, rows: &Adjacency) {
        for i in 0..self.own.len() {
            let sum: f32 = self.off[rows.start[i] as usize..rows.start[i + 1] as usize].iter().sum();
            self.diagonal[i] = self.own[i] + sum;
            self.inverse[i] = 1.0 / self.diagonal[i];
        }
    }

    /// Gauss-Seidel forward from zero: `x = (D + L)^-1 b`.
    fn forward(&self, rows: &Adjacency, b: &[f32], x: &mut [f32]) {
        for i in 0..self.own.len() {
            let row = rows.start[i] as usize..rows.upper[i] as usize;
            let mut s = b[i];
            for (k, &j) in self.off[row.clone()].iter().zip(&rows.cell[row]) {
                s += k * x[j as usize];
            }
            x[i] = s * self.inverse[i];
        }
    }

    /// Gauss-Seidel backward from `x`, whose ghosts count.
    fn backward(&self, rows: &Adjacency, b: &[f32], x: &mut [f32]) {
        for i in (0..self.own.len()).rev() {
            let row = rows.start[i] as usize..rows.start[i + 1] as usize;
            let mut s = b[i];
            for (k, &j) in self.off[row.clone()].iter().zip(&rows.cell[row]) {
                s += k * x[j as usize];
            }
            x[i] = s * self.inverse[i];
        }
    }
}

/// One coarse level with the way to it from the next finer one.
#[derive(Debug)]
struct Level {
    coarse: Coarse,
    matrix: Matrix,
    b: Vec<f32>,
    x: Vec<f32>,
}

/// The levels below the finest.
#[derive(Debug)]
pub struct Multigrid {
    levels: Vec<Level>,
    coarsest: Coarsest,
}

/// The coarse cells of all levels on one rank, as they were merged.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct MergedCells(Vec<MergedLevel>);

impl MergedCells {
    /// Whether all levels on all ranks stand below the rows `fine`. Collective.
    fn check(&self, fine: &Adjacency, comm: &Comm) -> Result<(), String> {
        let depth = self.0.len() as u64;
        let agreed = comm.all_gather_u64(depth).iter().all(|d| *d == depth);
        if !agreed || self.0.len() > LEVELS {
            return Err("the ranks have different numbers of multigrid levels".into());
        }
        let mut found = Ok(());
        let mut rows = [&fine.start[..], &fine.cell[..]];
        for level in &self.0 {
            let mut starts = vec![0];
            let counts = comm.all_gather_u64(level.cells());
            starts.extend(counts.iter().scan(0u64, |end, n| {
                *end = end.saturating_add(*n);
                Some(*end)
            }));
            if found.is_ok() {
                found = level.check(rows, comm.rank(), &starts);
            }
            rows = level.rows();
        }
        match found {
            Err(what) => {
                comm.all(false);
                Err(what.into())
            }
            Ok(()) if !comm.all(true) => Err("the multigrid levels of another rank do not fit".into()),
            Ok(()) => Ok(()),
        }
    }
}

/// Levels at most: enough for 8^12 cells a rank.
const LEVELS: usize = 12;

impl Multigrid {
    /// Merges cells by the couplings of `matrix`; `centre` and `volume` belong to
    /// all local cells of the finest level. Collective.
    pub fn new(rows: &Adjacency, halo: &Halo, matrix: &Matrix, centre: &[[f64; 3]], volume: &[f64]) -> Self {
        let mut levels: Vec<Level> = Vec::new();
        let (mut centre, mut volume) = (centre.to_vec(), volume.to_vec());
        let comm = halo.comm().clone();
        let total = |n: usize| {
            let mut sum = [n as u64];
            comm.sum_u64(&mut sum);
            sum[0] as usize
        };
        let mut size = total(matrix.own.len());
        while size > coarsest::limit(comm.size()) && levels.len() < LEVELS {
            let (rows, halo, matrix) = match levels.last() {
                None => (rows, halo, matrix),
                Some(l) => (&l.coarse.rows, &l.coarse.halo, &l.matrix),
            };
            let (coarse, n_local) = Coarse::new(rows, halo, matrix, &mut centre, &mut volume);
            let smaller = total(coarse.rows.start.len() - 1);
            // Cells without neighbours cannot be merged: what is left is solved by its diagonal.
            if smaller * 4 > size * 3 {
                break;
            }
            size = smaller;
            let mut level = Level {
                matrix: Matrix::new(&coarse.rows),
                b: vec![0.0; coarse.rows.start.len() - 1],
                x: vec![0.0; n_local],
                coarse,
            };
            level.coarse.collect(rows, matrix, &mut level.matrix);
            levels.push(level);
        }
        let coarsest = Self::coarsest(&levels, size, comm.size());
        Self { levels, coarsest }
    }

    /// The coarse cells.
    pub fn merged(&self) -> MergedCells {
        MergedCells(self.levels.iter().map(|l| l.coarse.merged()).collect())
    }

    /// From coarse cells that were merged earlier on the same fine ones, in rows `fine`; `halo` is
    /// theirs. Collective.
    ///
    /// # Errors
    /// On every rank, what does not fit on one of them.
    pub fn of_merged(merged: MergedCells, fine: &Adjacency, halo: &Halo) -> Result<Self, String> {
        let comm = halo.comm();
        merged.check(fine, comm)?;
        let mut levels: Vec<Level> = Vec::new();
        for level in merged.0 {
            let (coarse, n_local) = Coarse::of_merged(level, comm);
            let n = coarse.rows.start.len() - 1;
            let matrix = Matrix::new(&coarse.rows);
            levels.push(Level { matrix, b: vec![0.0; n], x: vec![0.0; n_local], coarse });
        }
        let mut size = [levels.last().map_or(0, |l| l.coarse.rows.start.len() as u64 - 1)];
        comm.sum_u64(&mut size);
        let coarsest = Self::coarsest(&levels, size[0] as usize, comm.size());
        Ok(Self { levels, coarsest })
    }

    fn coarsest(levels: &[Level], size: usize, ranks: usize) -> Coarsest {
        match levels.last() {
            Some(l) if size <= coarsest::limit(ranks) => Coarsest::new(&l.coarse.halo),
            _ => Coarsest::default(),
        }
    }

    /// Coarse matrices from the finest one. Collective.
    pub fn assemble(&mut self, rows: &Adjacency, matrix: &Matrix) {
        let (mut rows, mut fine) = (rows, matrix);
        for level in &mut self.levels {
            level.coarse.collect(rows, fine, &mut level.matrix);
            (rows, fine) = (&level.coarse.rows, &level.matrix);
        }
        if let Some(last) = self.levels.last() {
            self.coarsest.factor(&last.coarse.halo, &last.coarse.rows, &last.matrix);
        }
    }

    /// One cycle from zero: `x ~ A^-1 b` (with ghosts that are not refreshed). Collective.
    pub fn cycle(&mut self, rows: &Adjacency, halo: &Halo, matrix: &Matrix, b: &[f32], x: &mut [f32]) {
        descend(&mut self.levels, &mut self.coarsest, rows, halo, matrix, b, x);
    }
}

fn descend(
    levels: &mut [Level],
    coarsest: &mut Coarsest,
    rows: &Adjacency,
    halo: &Halo,
    matrix: &Matrix,
    b: &[f32],
    x: &mut [f32],
) {
    let Some((level, coarser)) = levels.split_first_mut() else {
        if !coarsest.solve(halo, b, x) {
            x.fill(0.0);
            matrix.forward(rows, b, x);
            matrix.backward(rows, b, x);
        }
        return;
    };
    matrix.forward(rows, b, x);
    halo.exchange(x, 1);
    level.coarse.restrict(rows, matrix, x, &mut level.b);
    descend(coarser, coarsest, &level.coarse.rows, &level.coarse.halo, &level.matrix, &level.b, &mut level.x);
    level.coarse.prolong(&level.x, x);
    halo.exchange(x, 1);
    matrix.backward(rows, b, x);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Boxes of cells between walls at zero: the error falls by the same factor
    /// however many there are.
    #[test]
    fn multigrid_convergence_is_independent_of_size() {
        for side in [6usize, 12, 24] {
            let n = side * side * side;
            let mut cells = Vec::new();
            for c in 0..n {
                for (step, at) in [(1, c % side), (side, c / side % side), (side * side, c / side / side)] {
                    if at + 1 < side {
                        cells.push([c as u32, (c + step) as u32]);
                    }
                }
            }
            let rows = Adjacency::new(n, &cells);
            let mut a = Matrix::new(&rows);
            a.off[..2 * cells.len()].fill(1.0);
            for i in 0..n {
                a.own[i] = 2.0 * (6 - (rows.start[i + 1] - rows.start[i])) as f32;
            }
            a.complete(&rows);
            let centre: Vec<[f64; 3]> =
                (0..n).map(|c| [c % side, c / side % side, c / side / side].map(|x| x as f64)).collect();
            let halo = Halo::solo(n);
            let mut multigrid = Multigrid::new(&rows, &halo, &a, &centre, &vec![1.0; n]);
            multigrid.assemble(&rows, &a);
            // Error equation: from x to x - M A x.
            let mut x: Vec<f32> = (0..n).map(|i| ((i * 7919) % 100) as f32 / 50.0 - 1.0).collect();
            let (mut b, mut e) = (vec![0.0; n], vec![0.0; n]);
            let size = |x: &[f32]| x.iter().map(|v| v * v).sum::<f32>().sqrt();
            let mut rate = 0.0;
            for _ in 0..20 {
                for i in 0..n {
                    let row = rows.start[i] as usize..rows.start[i + 1] as usize;
                    let s: f32 = row.map(|k| a.off[k] * x[rows.cell[k] as usize]).sum();
                    b[i] = a.diagonal[i] * x[i] - s;
                }
                multigrid.cycle(&rows, &halo, &a, &b, &mut e);
                let before = size(&x);
                x.iter_mut().zip(&e).for_each(|(x, e)| *x -= e);
                rate = size(&x) / before;
            }
            assert!(rate < 0.7, "{n} cells: error times {rate} in one cycle");
        }
    }
}
