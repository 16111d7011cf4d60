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
