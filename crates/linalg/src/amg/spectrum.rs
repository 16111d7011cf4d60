//! The largest eigenvalue of the Jacobi-preconditioned matrix.

use crate::block::{Real, add_mul};
use crate::vector::{axpy, dot, xpby};
use crate::{BlockCsr, Operator};

/// An estimate from above, by a few percent, of the largest eigenvalue of
/// $`D^{-1} A`$ with the block diagonal $`D`$: Lanczos through the coefficients of
/// conjugate gradients, from a fixed rough vector. Collective.
pub(super) fn largest<const F: usize, S: Real>(
    a: &BlockCsr<F, S>,
    inverse: &[[[f64; F]; F]],
    first: u64,
) -> f64 {
    const STEPS: usize = 12;
    let comm = a.halo().comm();
    let n = a.n_owned();
    let mut r: Vec<f64> = (0..n)
        .map(|i| {
            // A hash of the row's number: rough, and the same in every run.
            let h = (first * F as u64 + i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            (h >> 40) as f64 / f64::from(1 << 24) - 0.5
        })
        .collect();
    let mut z = vec![0.0; n];
    let mut p = vec![0.0; a.n_local()];
    let mut q = vec![0.0; n];
    let (mut diagonal, mut off) = (Vec::new(), Vec::new());
    let mut energy_before = 0.0;
    let mut step_before = 1.0;
    for k in 0..STEPS {
        for ((z, r), d) in z.as_chunks_mut::<F>().0.iter_mut().zip(r.as_chunks::<F>().0).zip(inverse) {
            *z = [0.0; F];
            add_mul(z, d, r);
        }
        let energy = comm.sum(dot(&r, &z));
        let beta = if k == 0 { 0.0 } else { energy / energy_before };
        xpby(&z, beta, &mut p[..n]);
        a.apply(&mut p, &mut q);
        let curvature = comm.sum(dot(&p[..n], &q));
        let step = energy / curvature;
        if !(step > 0.0 && step.is_finite() && energy > 0.0) {
            break;
        }
        diagonal.push(1.0 / step + if k == 0 { 0.0 } else { beta / step_before });
        if k > 0 {
            off.push(beta.sqrt() / step_before);
        }
        axpy(-step, &q, &mut r);
        energy_before = energy;
        step_before = step;
    }
    1.05 * largest_tridiagonal(&diagonal, &off)
}

/// Largest eigenvalue of a symmetric tridiagonal matrix, by bisection on Sturm counts.
fn largest_tridiagonal(diagonal: &[f64], off: &[f64]) -> f64 {
    let n = diagonal.len();
    let radius = |i: usize| {
        let left = if i > 0 { off[i - 1].abs() } else { 0.0 };
        left + off.get(i).map_or(0.0, |o| o.abs())
    };
    let Some(bound) = (0..n).map(|i| diagonal[i] + radius(i)).max_by(f64::total_cmp) else {
        return 1.0;
    };
    let all_below = |x: f64| {
        let mut d = diagonal[0] - x;
        for i in 1..n {
            if d >= 0.0 {
                return false;
            }
            d = diagonal[i] - x - off[i - 1] * off[i - 1] / d;
        }
        d < 0.0
    };
    let (mut low, mut high) = (0.0, bound);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if all_below(middle) { high = middle } else { low = middle }
    }
    high
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_difference_matrix() {
        let n = 9;
        let want = 2.0 - 2.0 * (std::f64::consts::PI * n as f64 / (n + 1) as f64).cos();
        let got = largest_tridiagonal(&vec![2.0; n], &vec![-1.0; n - 1]);
        assert!((got - want).abs() < 1e-12, "{got} {want}");
    }
}
