//! Inverse of a small pivot block.

use crate::block::Real;

/// Up to this size Gauss-Jordan elimination beats a blocked factorisation.
pub(super) const SMALL: usize = 48;

/// Inverts the `n x n` matrix in place by Gauss-Jordan elimination with row pivoting. (By
/// rows or by columns: the inverse of the transpose is the transpose of the inverse.)
/// A singular matrix leaves infinities or NaN. `swaps` has room for `n` numbers.
pub(super) fn invert<T: Real>(a: &mut [T], n: usize, swaps: &mut [usize]) {
    let one = T::from_f64(1.0);
    let a = &mut a[..n * n];
    let mut pivot_row = [T::default(); SMALL];
    let pivot_row = &mut pivot_row[..n];
    for k in 0..n {
        let (mut p, mut most) = (k, T::default());
        for i in k..n {
            let v = a[i * n + k];
            let v = if v < T::default() { -v } else { v };
            if v > most {
                (p, most) = (i, v);
            }
        }
        swaps[k] = p;
        if p != k {
            let (upper, lower) = a.split_at_mut(p * n);
            upper[k * n..(k + 1) * n].swap_with_slice(&mut lower[..n]);
        }
        let row = &mut a[k * n..(k + 1) * n];
        let d = one / row[k];
        row[k] = one;
        for (v, kept) in row.iter_mut().zip(pivot_row.iter_mut()) {
            *v *= d;
            *kept = *v;
        }
        for (i, row) in a.chunks_exact_mut(n).enumerate() {
            if i != k {
                let f = -row[k];
                row[k] = T::default();
                for (v, q) in row.iter_mut().zip(pivot_row.iter()) {
                    *v = q.fused(f, *v);
                }
            }
        }
    }
    // Row swaps of the matrix are column swaps of its inverse.
    for k in (0..n).rev() {
        let p = swaps[k];
        if p != k {
            a.chunks_exact_mut(n).for_each(|row| row.swap(k, p));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_times_the_matrix_is_one() {
        for n in [1, 2, 7, 24, SMALL] {
            // Zeros on the diagonal: every step pivots.
            let a: Vec<f64> = (0..n * n)
                .map(|k| match (k / n, k % n) {
                    (i, j) if n > 1 && i == j => 0.0,
                    (i, j) => {
                        f64::from(u8::from(i + j == n - 1)) * 3.0 + ((k * k + 1) as f64).sin() / n as f64
                    }
                })
                .collect();
            let mut inverse = a.clone();
            invert(&mut inverse, n, &mut vec![0; n]);
            for i in 0..n {
                for j in 0..n {
                    let sum: f64 = (0..n).map(|k| inverse[i * n + k] * a[k * n + j]).sum();
                    assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-11, "{n}: {i} {j} {sum}");
                }
            }
        }
        let mut singular = vec![1.0f32; 9];
        invert(&mut singular, 3, &mut [0; 3]);
        assert!(singular.iter().any(|v| !v.is_finite()));
    }
}
