//! Prescribed values.

use crate::BlockCsr;
use crate::block::Real;

/// The entries that [`BlockCsr::eliminate_dirichlet`] took out of a matrix: they
/// carry prescribed values to the right-hand side of every later solve.
#[derive(Clone, Debug)]
pub struct Lift<const B: usize> {
    fixed: Vec<bool>,
    diagonal: Vec<f64>,
    /// Owned row, local column, removed entries (others zero).
    entries: Vec<(u32, u32, [[f64; B]; B])>,
}

impl<const B: usize> Lift<B> {
    /// Makes `b` (`n_owned` numbers) the right-hand side of the eliminated system:
    /// free rows lose `A_fixed g`, fixed rows become `diagonal * g`.
    /// `g` holds the prescribed values with current ghosts (`n_local` numbers);
    /// entries of free unknowns are not read.
    pub fn impose(&self, g: &[f64], b: &mut [f64]) {
        for (row, col, a) in &self.entries {
            let (i, j) = (*row as usize * B, *col as usize * B);
            for r in 0..B {
                for c in 0..B {
                    if self.fixed[j + c] {
                        b[i + r] -= a[r][c] * g[j + c];
                    }
                }
            }
        }
        for (i, (b, d)) in b.iter_mut().zip(&self.diagonal).enumerate() {
            if self.fixed[i] {
                *b = d * g[i];
            }
        }
    }
}

impl<const B: usize, T: Real> BlockCsr<B, T> {
    /// Makes the rows of fixed unknowns rows of `diagonal` times the identity.
    /// `fixed` has one flag for each owned number, `[n_owned][B]` (longer is allowed).
    pub fn set_dirichlet_rows(&mut self, fixed: &[bool], diagonal: f64) {
        for i in 0..self.n_rows() {
            for r in (0..B).filter(|r| fixed[i * B + r]) {
                for s in self.row(i) {
                    self.values[s][r] = [T::default(); B];
                }
                let s = self.diagonal_slot(i);
                self.values[s][r][r] = T::from_f64(diagonal);
            }
        }
    }

    /// Takes fixed unknowns out of the system and keeps it symmetric: their columns
    /// move to the returned [`Lift`], their rows keep only their diagonal entry (one
    /// where that is not positive), which leaves the scaling of the matrix as it was.
    /// `fixed` has one flag for each local number, ghosts included, `[n_local][B]`.
    pub fn eliminate_dirichlet(&mut self, fixed: &[bool]) -> Lift<B> {
        assert_eq!(fixed.len(), self.halo().n_local() * B, "one flag for each local number");
        let mut entries = Vec::new();
        let mut diagonal = vec![1.0; self.n_rows() * B];
        for i in 0..self.n_rows() {
            for s in self.row(i) {
                let j = self.cols()[s] as usize;
                let mut removed = [[0.0; B]; B];
                let mut any = false;
                for r in 0..B {
                    for c in 0..B {
                        let (row_fixed, col_fixed) = (fixed[i * B + r], fixed[j * B + c]);
                        if i == j && r == c && row_fixed {
                            let d = self.values[s][r][c].to_f64();
                            if d > 0.0 {
                                diagonal[i * B + r] = d;
                            } else {
                                self.values[s][r][c] = T::from_f64(1.0);
                            }
                        } else if row_fixed || col_fixed {
                            if !row_fixed {
                                removed[r][c] = self.values[s][r][c].to_f64();
                                any |= removed[r][c] != 0.0;
                            }
                            self.values[s][r][c] = T::default();
                        }
                    }
                }
                if any {
                    entries.push((i as u32, j as u32, removed));
                }
            }
        }
        Lift { fixed: fixed.to_vec(), diagonal, entries }
    }
}

#[cfg(test)]
mod tests {
    use std::rc::Rc;

    use super::*;
    use crate::Operator;
    use comm::Halo;

    /// The solution of the full system with prescribed values solves the eliminated one.
    #[test]
    fn elimination_keeps_the_solution() {
        let n = 4;
        let lists: Vec<Vec<u32>> = (0..n).map(|_| (0..n as u32).collect()).collect();
        let mut a = BlockCsr::<2>::from_adjacency(Rc::new(Halo::solo(n)), &lists);
        for (k, v) in a.values.iter_mut().enumerate() {
            for (m, v) in v.iter_mut().flatten().enumerate() {
                *v = ((k * 7 + m * 3) % 11) as f64 - 4.0;
            }
        }
        let mut x: Vec<f64> = (0..2 * n).map(|i| (i as f64).sin()).collect();
        let mut b = vec![0.0; 2 * n];
        a.apply(&mut x, &mut b);
        let mut fixed = vec![false; 2 * n];
        (fixed[1], fixed[4], fixed[5]) = (true, true, true);
        let lift = a.eliminate_dirichlet(&fixed);
        lift.impose(&x.clone(), &mut b);
        let mut y = vec![0.0; 2 * n];
        a.apply(&mut x, &mut y);
        for i in 0..2 * n {
            assert!((y[i] - b[i]).abs() < 1e-13, "{i}: {} {}", y[i], b[i]);
        }
    }
}
