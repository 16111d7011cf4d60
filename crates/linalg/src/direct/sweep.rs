//! The products that a solve consists of: each reads its matrix once, and nothing else
//! takes long. Rows and columns come filled up to whole registers.

use crate::block::Real;

/// Numbers in a vector register (of 256 bits, in single precision).
pub(super) const LANES: usize = 8;

/// The length that holds `n` numbers in whole registers.
pub(super) const fn padded(n: usize) -> usize {
    n.next_multiple_of(LANES)
}

/// See [`Real::flushed`].
pub(super) fn flush<T: Real>(x: &mut [T]) {
    x.iter_mut().for_each(|v| *v = v.flushed());
}

/// Flushes whole registers; returns whether all numbers are finite.
pub(super) fn flush_finite<T: Real>(x: &mut [T]) -> bool {
    let mut sums = [T::default(); LANES];
    for x in x.as_chunks_mut::<LANES>().0 {
        for l in 0..LANES {
            // Zero, or NaN.
            sums[l] += x[l] * T::default();
            x[l] = x[l].flushed();
        }
    }
    sums.iter().all(|s| s.to_f64() == 0.0)
}

/// Largest magnitude; NaN is passed over.
pub(crate) fn largest(x: &[f64]) -> f64 {
    let (chunks, rest) = x.as_chunks::<LANES>();
    let mut most = [0.0f64; LANES];
    for x in chunks {
        for l in 0..LANES {
            most[l] = if x[l].abs() > most[l] { x[l].abs() } else { most[l] };
        }
    }
    most.iter().chain(rest).fold(0.0, |m, v| m.max(v.abs()))
}

/// `y += M x` with `M` by columns that begin every `stride` numbers, four columns at a time.
pub(super) fn add_columns<T: Real>(m: &[T], stride: usize, x: &[T], y: &mut [T]) {
    let y = y.as_chunks_mut::<LANES>().0;
    let n = y.len();
    if n == 0 {
        return;
    }
    let stride = stride / LANES;
    let mut columns = m.as_chunks::<LANES>().0.chunks_exact(4 * stride);
    let (quads, rest) = x.as_chunks::<4>();
    for (four, q) in columns.by_ref().zip(quads) {
        let (a, four) = four.split_at(stride);
        let (b, four) = four.split_at(stride);
        let (c, d) = four.split_at(stride);
        let [a, b, c, d] = [a, b, c, d].map(|column| &column[..n]);
        for i in 0..n {
            for l in 0..LANES {
                let sum = c[i][l].fused(q[2], d[i][l].fused(q[3], y[i][l]));
                y[i][l] = a[i][l].fused(q[0], b[i][l].fused(q[1], sum));
            }
        }
    }
    for (column, &q) in columns.remainder().chunks_exact(stride).zip(rest) {
        for (y, a) in y.iter_mut().zip(column) {
            for l in 0..LANES {
                y[l] = a[l].fused(q, y[l]);
            }
        }
    }
}

/// `y = M x` with `M` by rows.
pub(super) fn rows_dot<T: Real>(m: &[T], x: &[T], y: &mut [T]) {
    let x = x.as_chunks::<LANES>().0;
    let m = m.as_chunks::<LANES>().0;
    let (six, rest) = y.as_chunks_mut::<6>();
    let (rows_of_six, rows_of_rest) = m.split_at(six.len() * 6 * x.len());
    for (rows, y) in rows_of_six.chunks_exact(6 * x.len()).zip(six) {
        *y = dots(rows, x);
    }
    let (three, rest) = rest.as_chunks_mut::<3>();
    let (rows_of_three, rows_of_rest) = rows_of_rest.split_at(three.len() * 3 * x.len());
    for (rows, y) in rows_of_three.chunks_exact(3 * x.len()).zip(three) {
        *y = dots(rows, x);
    }
    for (row, y) in rows_of_rest.chunks_exact(x.len()).zip(rest) {
        [*y] = dots(row, x);
    }
}

/// Products of `R` rows with `x`, summed in lanes and those in pairs: a fixed order.
#[inline(always)]
fn dots<const R: usize, T: Real>(rows: &[[T; LANES]], x: &[[T; LANES]]) -> [T; R] {
    let n = x.len();
    let row: [&[[T; LANES]]; R] = std::array::from_fn(|r| &rows[r * n..(r + 1) * n]);
    let mut sums = [[T::default(); LANES]; R];
    for k in 0..n {
        for r in 0..R {
            for l in 0..LANES {
                sums[r][l] = row[r][k][l].fused(x[k][l], sums[r][l]);
            }
        }
    }
    across(&sums)
}

/// Sum over the lanes of each row. Not inlined: seeing it, the compiler would lay registers
/// across rows in the loop before and transpose every load.
#[inline(never)]
fn across<const R: usize, T: Real>(sums: &[[T; LANES]; R]) -> [T; R] {
    sums.map(|s| ((s[0] + s[4]) + (s[2] + s[6])) + ((s[1] + s[5]) + (s[3] + s[7])))
}
