//! Inverses of dense matrices for models that need few digits.

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;
use nalgebra::DMatrix;

/// Partial sums in parallel (vector lanes).
const LANES: usize = 32;

/// A dense matrix, each row in 16 bits relative to its largest number: products wait for memory.
///
/// What rounding leaves of a number is carried to the next one in its row. The sum of any consecutive numbers of a row is thus exact to one unit, and
/// products with smooth vectors, which inverses of influence matrices amplify, keep more digits than those with rough ones.
#[derive(Clone)]
pub(crate) struct ShortMatrix {
    n: usize,
    rows: Vec<i16>,
    /// Value of one unit in each row.
    units: Vec<f64>,
}

impl ShortMatrix {
    /// $`A^{-1}`$. A product with it costs one with a matrix; triangular solves would be dependent operations. `None` for a singular matrix.
    pub fn inverse(matrix: &DMatrix<f64>) -> Option<Self> {
        Self::by_rows(&inverse_transposed(matrix, 0.0), |_, _, inverse| inverse)
    }

    /// $`(I + g A^{-1})^{-1} = I - g (A + gI)^{-1}`$ with a `gain` $`g`$. `None` where $`A + gI`$ is singular.
    pub fn relaxation(matrix: &DMatrix<f64>, gain: f64) -> Option<Self> {
        let identity = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
        Self::by_rows(&inverse_transposed(matrix, gain), |i, j, inverse| identity(i, j) - gain * inverse)
    }

    /// Rows of `value(i, j, transposed[j, i])`. `None` where one is not finite.
    fn by_rows(transposed: &Mat<f64>, value: impl Fn(usize, usize, f64) -> f64) -> Option<Self> {
        let n = transposed.ncols();
        let (mut rows, mut units) = (Vec::with_capacity(n * n), Vec::with_capacity(n));
        let mut row = vec![0.0; n];
        for i in 0..n {
            row.iter_mut().enumerate().for_each(|(j, v)| *v = value(i, j, transposed[(j, i)]));
            if !row.iter().all(|v| v.is_finite()) {
                return None;
            }
            let largest = row.iter().fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
            let unit = largest / f64::from(i16::MAX);
            let mut left = 0.0;
            rows.extend(row.iter().map(|v| {
                let exact = v / unit + left;
                // The largest number may carry half a unit beyond the range, which stays left.
                let short = exact.round() as i16;
                left = exact - f64::from(short);
                short
            }));
            units.push(unit);
        }
        Some(Self { n, rows, units })
    }

    /// The product with `x`.
    pub fn apply(&self, x: &[f64]) -> Vec<f64> {
        let x: Vec<f32> = x.iter().map(|v| *v as f32).collect();
        let rows = self.rows.chunks_exact(self.n).zip(&self.units);
        rows.map(|(row, unit)| unit * f64::from(product(row, &x))).collect()
    }

    /// The product of the transposed matrix with `x`.
    pub fn apply_transposed(&self, x: &[f64]) -> Vec<f64> {
        let mut sum = vec![0.0; self.n];
        for ((row, unit), x) in self.rows.chunks_exact(self.n).zip(&self.units).zip(x) {
            let x = x * unit;
            sum.iter_mut().zip(row).for_each(|(sum, v)| *sum += f64::from(*v) * x);
        }
        sum
    }
}

/// $`(A + gI)^{-T}`$. In double precision, so that the round-off of other processors does not change the rounding to 16 bits; products would differ by 1e-4.
fn inverse_transposed(matrix: &DMatrix<f64>, gain: f64) -> Mat<f64> {
    let shifted = |i: usize, j: usize| matrix[(i, j)] + if i == j { gain } else { 0.0 };
    Mat::from_fn(matrix.ncols(), matrix.nrows(), |j, i| shifted(i, j)).partial_piv_lu().inverse()
}

fn product(a: &[i16], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut sums = [0.0_f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for k in 0..LANES {
            sums[k] = f32::from(a[k]).mul_add(b[k], sums[k]);
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| f32::from(*a) * b).sum();
    sums.iter().sum::<f32>() + rest
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::*;
    use crate::schemes::surrogate::vortex_lattice::VortexLattice;
    use crate::schemes::test_support::plate;

    /// Largest error of `found` relative to the largest number of `exact`.
    fn error(found: &[f64], exact: &DVector<f64>) -> f64 {
        let errors = found.iter().zip(exact).map(|(found, exact)| (found - exact).abs());
        errors.fold(0.0, f64::max) / exact.amax()
    }

    /// Against exact factors: products with the inverse, its transpose and the relaxation for heavy to light fabric. An error is that of a row: half a unit and
    /// what is carried, 4e-5 of the largest number by number, 1e-3 in a sum of 400 with random signs. With smooth motions, which are what counts, most cancels.
    #[test]
    fn products_have_the_digits_of_sixteen_bits() {
        let side = 20;
        let (positions, faces) = plate(side);
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let matrix = &lattice.influence;
        let n = matrix.nrows();
        let smooth = DVector::from_fn(n, |i, _| 1.0 + 0.3 * ((i % side) as f64 / side as f64));
        let rough = DVector::from_fn(n, |i, _| (1.7 * (i * i) as f64).sin());
        let factors = matrix.clone().lu();
        let inverse = ShortMatrix::inverse(matrix).expect("a regular matrix");
        for (x, bound) in [(&smooth, 2e-5), (&rough, 1e-3)] {
            let exact = factors.solve(x).expect("a regular matrix");
            let found = error(&inverse.apply(x.as_slice()), &exact);
            let exact = matrix.transpose().lu().solve(x).expect("a regular matrix");
            let transposed = error(&inverse.apply_transposed(x.as_slice()), &exact);
            println!("inverse: {found:.1e}, transposed {transposed:.1e}");
            assert!(found < bound && transposed < 1e-3, "{found:e}, {transposed:e}");
        }
        for gain in [1.0, 30.0, 1e3, 1e5] {
            let relaxation = ShortMatrix::relaxation(matrix, gain).expect("a regular matrix");
            let shifted = (matrix + DMatrix::identity(n, n) * gain).lu();
            for (x, bound) in [(&smooth, 1e-3), (&rough, 1e-3)] {
                let exact = matrix * shifted.solve(x).expect("a regular matrix");
                let found = error(&relaxation.apply(x.as_slice()), &exact);
                println!("relaxation with a gain of {gain}: {found:.1e}");
                assert!(found < bound, "{gain}: {found:e}");
            }
        }
    }

    /// Round-off of the matrix, which differs between processors, does not change the rounding of the inverse.
    #[test]
    fn round_off_changes_no_digit() {
        let (positions, faces) = plate(12);
        let lattice = VortexLattice::new(&positions, &faces, usize::MAX, 0.0).expect("a plate");
        let mut other = lattice.influence.clone();
        other.iter_mut().enumerate().for_each(|(k, v)| *v *= 1.0 + 1e-14 * (0.37 * (k * k) as f64).sin());
        assert_ne!(lattice.influence, other);
        let both = [&lattice.influence, &other];
        for gain in [None, Some(15.0)] {
            let rows = both.map(|m| match gain {
                None => ShortMatrix::inverse(m).expect("a regular matrix").rows,
                Some(gain) => ShortMatrix::relaxation(m, gain).expect("a regular matrix").rows,
            });
            assert_eq!(rows[0], rows[1]);
        }
    }

    #[test]
    fn singular_matrix_has_no_inverse() {
        assert!(ShortMatrix::inverse(&DMatrix::from_element(3, 3, 0.0)).is_none());
        assert!(ShortMatrix::relaxation(&DMatrix::from_element(3, 3, 0.0), 0.0).is_none());
    }
}
