//! Inverse of a dense matrix for models that need few digits.

use faer::linalg::solvers::{DenseSolveCore, PartialPivLu};
use faer::{Mat, MatRef};
use nalgebra::DMatrix;

/// Partial sums in parallel (vector lanes).
const LANES: usize = 16;

/// $`A^{-1}`$ in single precision, by rows: a product reads it once, while two triangular solves would read twice as
/// many bytes with dependent operations.
#[derive(Clone)]
pub(crate) struct Inverse {
    n: usize,
    rows: Vec<f32>,
}

/// Factors of a matrix.
pub(crate) fn factors(matrix: &DMatrix<f64>) -> PartialPivLu<f64> {
    MatRef::from_column_major_slice(matrix.as_slice(), matrix.nrows(), matrix.ncols()).partial_piv_lu()
}

impl Inverse {
    /// `None` for a singular matrix.
    pub fn of(factors: &PartialPivLu<f64>) -> Option<Self> {
        let inverse = factors.inverse();
        Self::by_rows(inverse.nrows(), |i, j| inverse[(i, j)] as f32)
    }

    /// As [`Inverse::of`], with factors in single precision: for a matrix of low condition. `None` for a singular one.
    pub fn single(matrix: &DMatrix<f64>) -> Option<Self> {
        let single = Mat::from_fn(matrix.nrows(), matrix.ncols(), |i, j| matrix[(i, j)] as f32);
        let inverse = single.partial_piv_lu().inverse();
        Self::by_rows(inverse.nrows(), |i, j| inverse[(i, j)])
    }

    fn by_rows(n: usize, at: impl Fn(usize, usize) -> f32) -> Option<Self> {
        let rows: Vec<f32> = (0..n * n).map(|k| at(k / n, k % n)).collect();
        rows.iter().all(|v| v.is_finite()).then_some(Self { n, rows })
    }

    /// The product with `x`, to about six digits of its largest number.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let x: Vec<f32> = x.iter().map(|v| *v as f32).collect();
        self.rows.chunks_exact(self.n).map(|row| f64::from(product(row, &x))).collect()
    }
}

fn product(a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0_f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for k in 0..LANES {
            sums[k] += a[k] * b[k];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_times_matrix_is_identity() {
        let n = 37;
        let matrix =
            DMatrix::from_fn(n, n, |i, j| if i == j { 4.0 } else { (i as f64 - 0.3 * j as f64).sin() });
        let x: Vec<f64> = (0..n).map(|i| (i as f64).cos()).collect();
        let inverse = Inverse::of(&factors(&matrix)).expect("a regular matrix");
        let b = &matrix * nalgebra::DVector::from_column_slice(&x);
        let found = inverse.apply(b.as_slice());
        let largest = b.amax();
        assert!(found.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-6 * largest), "{found:?} {x:?}");
        let found = Inverse::single(&matrix).expect("a regular matrix").apply(b.as_slice());
        assert!(found.iter().zip(&x).all(|(a, b)| (a - b).abs() < 1e-6 * largest), "{found:?} {x:?}");
    }

    #[test]
    fn singular_matrix_has_no_inverse() {
        assert!(Inverse::of(&factors(&DMatrix::from_element(3, 3, 0.0))).is_none());
        assert!(Inverse::single(&DMatrix::from_element(3, 3, 0.0)).is_none());
    }
}
