//! Small dense blocks, row-major, in storage precision `T`.

/// A storage precision of matrix entries. Arithmetic on vectors stays in `f64`.
pub trait Real: faer::traits::RealField + comm::Scalar {
    /// Rounds to this precision.
    fn from_f64(x: f64) -> Self;
    /// Widens.
    fn to_f64(self) -> f64;
    /// Zero in place of a number so small that its product with another such number would
    /// be subnormal: processors compute with those many times slower.
    fn flushed(self) -> Self;
    /// `self * a + b`, in one instruction where the target has it (Rust does not fuse by
    /// itself, and without the instruction `mul_add` is a slow function).
    fn fused(self, a: Self, b: Self) -> Self;
}

const FUSES: bool = cfg!(any(target_feature = "fma", target_arch = "aarch64"));

impl Real for f64 {
    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn flushed(self) -> f64 {
        if self.abs() < 1e-150 { 0.0 } else { self }
    }
    #[inline(always)]
    fn fused(self, a: f64, b: f64) -> f64 {
        if FUSES { self.mul_add(a, b) } else { self * a + b }
    }
}

impl Real for f32 {
    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn flushed(self) -> f32 {
        if self.abs() < 1e-18 { 0.0 } else { self }
    }
    #[inline(always)]
    fn fused(self, a: f32, b: f32) -> f32 {
        if FUSES { self.mul_add(a, b) } else { self * a + b }
    }
}

/// `y += A x`.
#[inline(always)]
pub(crate) fn add_mul<const R: usize, const C: usize, T: Real>(
    y: &mut [f64; R],
    a: &[[T; C]; R],
    x: &[f64; C],
) {
    for r in 0..R {
        // The row is summed before it is added: a short chain of dependent additions.
        let mut sum = a[r][0].to_f64() * x[0];
        for c in 1..C {
            sum = a[r][c].to_f64().fused(x[c], sum);
        }
        y[r] += sum;
    }
}

/// Adds the products that make up `A x`, each to its own sum: `A x` is the sum over
/// columns of `sums`. Without dependence between neighbouring entries the compiler fills
/// vector registers, and a row of blocks costs one horizontal sum.
#[inline(always)]
pub(crate) fn accumulate<const R: usize, const C: usize, T: Real>(
    sums: &mut [[f64; C]; R],
    a: &[[T; C]; R],
    x: &[f64; C],
) {
    for r in 0..R {
        for c in 0..C {
            sums[r][c] = a[r][c].to_f64().fused(x[c], sums[r][c]);
        }
    }
}

/// Inverse by Gauss-Jordan elimination with partial pivoting, `None` if singular
/// to working precision or not finite.
pub(crate) fn invert<const B: usize>(a: &[[f64; B]; B]) -> Option<[[f64; B]; B]> {
    let mut a = *a;
    let mut inv = [[0.0; B]; B];
    let mut scale = 0.0f64;
    for r in 0..B {
        inv[r][r] = 1.0;
        for c in 0..B {
            if !a[r][c].is_finite() {
                return None;
            }
            scale = scale.max(a[r][c].abs());
        }
    }
    for k in 0..B {
        let mut p = k;
        for r in k + 1..B {
            if a[r][k].abs() > a[p][k].abs() {
                p = r;
            }
        }
        if a[p][k].abs() <= scale * 1e-14 {
            return None;
        }
        a.swap(k, p);
        inv.swap(k, p);
        let d = 1.0 / a[k][k];
        for c in 0..B {
            a[k][c] *= d;
            inv[k][c] *= d;
        }
        for r in 0..B {
            if r != k {
                let f = a[r][k];
                for c in 0..B {
                    a[r][c] -= f * a[k][c];
                    inv[r][c] -= f * inv[k][c];
                }
            }
        }
    }
    Some(inv)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverse_of_a_pivoting_block() {
        let a = [[0.0, 2.0, 1.0], [1.0, 0.0, 3.0], [4.0, 1.0, 0.0]];
        let inv = invert(&a).unwrap();
        for r in 0..3 {
            for c in 0..3 {
                let s: f64 = (0..3).map(|k| a[r][k] * inv[k][c]).sum();
                assert!((s - f64::from(u8::from(r == c))).abs() < 1e-14);
            }
        }
        assert!(invert(&[[1.0, 2.0], [2.0, 4.0]]).is_none());
    }
}
