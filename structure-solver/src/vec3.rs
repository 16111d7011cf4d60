//! Algebra on `[f64; 3]` and `[[f64; 3]; 3]`.

/// A point or vector in space.
pub type Vec3 = [f64; 3];
/// A 3x3 block, row-major.
pub type Mat3 = [[f64; 3]; 3];

/// The zero block.
pub const ZERO3: Mat3 = [[0.0; 3]; 3];

/// `a + b`.
#[inline(always)]
pub fn add(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// `a - b`.
#[inline(always)]
pub fn sub(a: Vec3, b: Vec3) -> Vec3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// `s a`.
#[inline(always)]
pub fn scale(s: f64, a: Vec3) -> Vec3 {
    [s * a[0], s * a[1], s * a[2]]
}

/// `a . b`.
#[inline(always)]
pub fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a x b`.
#[inline(always)]
pub fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Euclidean length.
#[inline(always)]
pub fn norm(a: Vec3) -> f64 {
    dot(a, a).sqrt()
}

/// Node `i` of a flat array of coordinates or forces, shape `[nodes][3]`.
#[inline(always)]
pub fn at(x: &[f64], i: usize) -> Vec3 {
    [x[3 * i], x[3 * i + 1], x[3 * i + 2]]
}

/// Adds `f` to node `i` of a flat array, shape `[nodes][3]`.
#[inline(always)]
pub fn add_at(x: &mut [f64], i: usize, f: Vec3) {
    let row = &mut x[3 * i..3 * i + 3];
    row[0] += f[0];
    row[1] += f[1];
    row[2] += f[2];
}

/// Adds `k` to block `to`.
#[inline(always)]
pub fn add_block(to: &mut Mat3, k: &Mat3) {
    for i in 0..3 {
        for j in 0..3 {
            to[i][j] += k[i][j];
        }
    }
}
