//! Orthogonalisation against a Krylov basis. Several vectors of the basis are worked on
//! in one pass, so that the new vector is read once for all of them. Sums have a fixed
//! order: the answer to the last bit never changes.

use comm::Comm;

use crate::block::Real;
use crate::vector::dot;

/// Vectors per pass.
const MANY: usize = 4;
const LANES: usize = 8;

/// The second pass is left out if the first keeps this share of the squared norm: then it
/// leaves the vector orthogonal but for some three roundings, and the norm by Pythagoras
/// is as good (Daniel, Gragg, Kaufman and Stewart 1976).
const KEPT: f64 = 0.1;

/// Makes `w` orthogonal to the orthonormal `basis` and of unit length. `h` gets its former
/// coefficients; returns its former distance from the basis.
///
/// `expected` is a guess of the coefficient of the last vector. Well preconditioned, `w` is
/// nearly that vector times a constant known from the iterations before: taken out first, it
/// spares the second pass that so much cancellation would otherwise demand. An iteration has
/// one reduction, seldom two (and a third where `w` lies in the basis).
pub(super) fn orthonormalise(
    comm: &Comm,
    basis: &[Vec<f64>],
    w: &mut [f64],
    expected: f64,
    h: &mut [f64],
    sums: &mut [f64],
) -> f64 {
    let k = basis.len();
    sums[k] = if expected == 0.0 { dot(w, w) } else { subtract(expected, &basis[k - 1], w) };
    h[..k].fill(0.0);
    h[k - 1] = expected;
    for pass in 0..2 {
        dots(basis, w, sums);
        comm.sum_slice(&mut sums[..=k]);
        let norm2 = sums[k];
        let rest = norm2 - sums[..k].iter().map(|s| s * s).sum::<f64>();
        h.iter_mut().zip(&sums[..k]).for_each(|(h, s)| *h += s);
        if rest > KEPT * norm2 {
            let norm = rest.sqrt();
            combine(basis, sums, 1.0 / norm, w);
            return norm;
        }
        combine(basis, sums, 1.0, w);
        if pass == 0 {
            sums[k] = dot(w, w);
        }
    }
    // Nothing is left but rounding.
    let norm = comm.sum(dot(w, w)).sqrt();
    if norm > 0.0 {
        w.iter_mut().for_each(|w| *w /= norm);
    }
    norm
}

/// `x += sum_i c_i z_i`, the vectors as long as `x` or longer.
pub(super) fn add_combination(z: &[Vec<f64>], c: &mut [f64], x: &mut [f64]) {
    c.iter_mut().for_each(|c| *c = -*c);
    combine(z, c, 1.0, x);
}

/// `w -= a v`; returns `w.w` afterwards.
fn subtract(a: f64, v: &[f64], w: &mut [f64]) -> f64 {
    let (vs, vr) = v.as_chunks::<LANES>();
    let (ws, wr) = w.as_chunks_mut::<LANES>();
    let mut sums = [[0.0; LANES]];
    for (w, v) in ws.iter_mut().zip(vs) {
        for l in 0..LANES {
            w[l] = v[l].fused(-a, w[l]);
            sums[0][l] = w[l].fused(w[l], sums[0][l]);
        }
    }
    let mut rest = 0.0;
    for (w, v) in wr.iter_mut().zip(vr) {
        *w -= a * v;
        rest += *w * *w;
    }
    across(&sums)[0] + rest
}

/// `sums_i = v_i . w`.
fn dots(v: &[Vec<f64>], w: &[f64], sums: &mut [f64]) {
    for (v, sums) in v.chunks(MANY).zip(sums.chunks_mut(MANY)) {
        match v {
            [a, b, c, d] => sums.copy_from_slice(&dot_each([a, b, c, d], w)),
            [a, b, c] => sums[..3].copy_from_slice(&dot_each([a, b, c], w)),
            [a, b] => sums[..2].copy_from_slice(&dot_each([a, b], w)),
            _ => v.iter().zip(sums).for_each(|(v, s)| *s = dot(v, w)),
        }
    }
}

fn dot_each<const K: usize>(v: [&[f64]; K], w: &[f64]) -> [f64; K] {
    let (ws, wr) = w.as_chunks::<LANES>();
    let vs = v.map(|v| &v.as_chunks::<LANES>().0[..ws.len()]);
    let mut sums = [[0.0; LANES]; K];
    for (i, w) in ws.iter().enumerate() {
        for k in 0..K {
            for l in 0..LANES {
                sums[k][l] = vs[k][i][l].fused(w[l], sums[k][l]);
            }
        }
    }
    let mut total = across(&sums);
    for k in 0..K {
        let rest = &v[k][ws.len() * LANES..];
        total[k] += rest.iter().zip(wr).map(|(v, w)| v * w).sum::<f64>();
    }
    total
}

/// Sums over the lanes. Not inlined: seeing it, the compiler would lay registers across the
/// vectors in the loop before and transpose every load.
#[inline(never)]
fn across<const K: usize>(sums: &[[f64; LANES]; K]) -> [f64; K] {
    sums.map(|s| ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7])))
}

/// `w = scale (w - sum_i c_i v_i)`.
fn combine(v: &[Vec<f64>], c: &[f64], scale: f64, w: &mut [f64]) {
    let n = v.len();
    for (at, v) in v.chunks(MANY).enumerate() {
        let c = &c[at * MANY..];
        let scale = if (at + 1) * MANY >= n { scale } else { 1.0 };
        match v {
            [a, b, d, e] => combine_each([a, b, d, e], [c[0], c[1], c[2], c[3]], scale, w),
            [a, b, d] => combine_each([a, b, d], [c[0], c[1], c[2]], scale, w),
            [a, b] => combine_each([a, b], [c[0], c[1]], scale, w),
            _ => v.iter().for_each(|a| combine_each([a], [c[0]], scale, w)),
        }
    }
}

fn combine_each<const K: usize>(v: [&[f64]; K], c: [f64; K], scale: f64, w: &mut [f64]) {
    let v = v.map(|v| &v[..w.len()]);
    for i in 0..w.len() {
        let mut sum = w[i];
        for k in 0..K {
            sum = v[k][i].fused(-c[k], sum);
        }
        w[i] = sum * scale;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn vector(n: usize, seed: usize) -> Vec<f64> {
        (0..n).map(|i| ((i * i * 7 + 3 * i * seed + seed * seed) as f64).sin()).collect()
    }

    /// Bases of every length modulo the vectors of a pass; vectors that are not whole
    /// registers; and new vectors that lie in the basis but for 1e-9.
    #[test]
    fn the_basis_is_orthonormal_and_the_coefficients_give_the_vector_back() {
        let n = 101;
        for (near, expected) in [(1.0, 0.0), (1.0, 0.7), (1e-3, 1.0), (1e-9, 0.0)] {
            let mut basis: Vec<Vec<f64>> = Vec::new();
            for k in 0..11 {
                let mut w = vector(n, k + 1);
                if let Some(last) = basis.last() {
                    w.iter_mut().zip(last).for_each(|(w, v)| *w = near * *w + v);
                } else {
                    let norm = dot(&w, &w).sqrt();
                    basis.push(w.iter().map(|w| w / norm).collect());
                    continue;
                }
                let before = w.clone();
                let (mut h, mut sums) = (vec![f64::NAN; k], vec![f64::NAN; k + 1]);
                let norm = orthonormalise(&Comm::solo(), &basis, &mut w, expected, &mut h, &mut sums);
                basis.push(w);
                h.push(norm);
                let mut back = vec![0.0; n];
                basis.iter().zip(&h).for_each(|(v, h)| crate::vector::axpy(*h, v, &mut back));
                assert!(back.iter().zip(&before).all(|(a, b)| (a - b).abs() < 1e-14), "near {near}");
            }
            for (i, a) in basis.iter().enumerate() {
                for (j, b) in basis.iter().enumerate() {
                    let want = f64::from(u8::from(i == j));
                    assert!((dot(a, b) - want).abs() < 2e-14, "near {near}: {i} {j} {}", dot(a, b) - want);
                }
            }
        }
    }

    #[test]
    fn a_vector_of_the_basis_leaves_next_to_nothing() {
        let v = vector(64, 5);
        let norm = dot(&v, &v).sqrt();
        let basis = vec![v.iter().map(|v| v / norm).collect::<Vec<f64>>()];
        let mut w = v.clone();
        let (mut h, mut sums) = ([0.0], [0.0; 2]);
        let rest = orthonormalise(&Comm::solo(), &basis, &mut w, 0.0, &mut h, &mut sums);
        assert!(rest < 1e-14 * norm && (h[0] - norm).abs() < 1e-13 * norm);
        assert!(w.iter().all(|w| w.is_finite()));
    }

    /// What is left of a vector of the span is rounding; it becomes a unit vector or zero.
    #[test]
    fn what_rounding_leaves_has_unit_length() {
        let mut units = 0;
        for seed in 1..20 {
            let v = vector(64, seed);
            let norm = dot(&v, &v).sqrt();
            let basis = vec![v.iter().map(|v| v / norm).collect::<Vec<f64>>()];
            let mut w: Vec<f64> = v.iter().map(|v| v / 3.0).collect();
            let rest = orthonormalise(&Comm::solo(), &basis, &mut w, 0.0, &mut [0.0], &mut [0.0; 2]);
            if rest > 0.0 {
                assert!((dot(&w, &w) - 1.0).abs() < 1e-14);
                units += 1;
            }
        }
        assert!(units > 0);
    }
}
