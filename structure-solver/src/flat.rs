//! Flat arrays of the solver, shape `[nodes][3]`, and blocks of its matrix.

use mesh::geometry::{Mat3, Vec3};

/// A 3x3 block of the system matrix, row by row.
pub type Block = [[f64; 3]; 3];

/// Node `i` of a flat array of coordinates or forces.
#[inline(always)]
pub fn at(x: &[f64], i: usize) -> Vec3 {
    Vec3::new(x[3 * i], x[3 * i + 1], x[3 * i + 2])
}

/// Adds `f` to node `i` of a flat array.
#[inline(always)]
pub fn add_at(x: &mut [f64], i: usize, f: Vec3) {
    let row = &mut x[3 * i..3 * i + 3];
    row[0] += f[0];
    row[1] += f[1];
    row[2] += f[2];
}

/// Adds `k` to block `to`.
#[inline(always)]
pub fn add_block(to: &mut Block, k: &Mat3) {
    for i in 0..3 {
        for j in 0..3 {
            to[i][j] += k[(i, j)];
        }
    }
}

/// Index of the first number that is NaN or infinite. Whole blocks are judged by their bits, which compilers vectorise.
pub(crate) fn first_not_finite(values: &[f64]) -> Option<usize> {
    const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
    const BLOCK: usize = 256;
    let bad = |x: &f64| x.to_bits() & EXPONENT == EXPONENT;
    let block = values.chunks(BLOCK).position(|block| block.iter().fold(false, |any, x| any | bad(x)))?;
    values[block * BLOCK..].iter().position(bad).map(|i| block * BLOCK + i)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_number_that_is_not_finite_is_found() {
        let mut values = vec![-0.0; 700];
        values[3] = f64::MAX;
        assert_eq!(first_not_finite(&values), None);
        for (at, bad) in [(699, f64::NAN), (512, f64::NEG_INFINITY), (2, f64::INFINITY)] {
            values[at] = bad;
            assert_eq!(first_not_finite(&values), Some(at));
        }
        assert_eq!(first_not_finite(&values[3..512]), None);
    }
}
