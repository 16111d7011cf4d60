//! Several elements at a time: the scalar of kernels that are computed in the lanes of a vector register.
//!
//! A kernel written for [`Real`] is one formula for one element and for [`LANES`] of them. Each lane has the operations of the single element
//! in the same order, so the same digits.

use nalgebra::{SimdRealField, Vector3};
use simba::simd::WideF64x4;

/// Elements in a batch.
pub const LANES: usize = 4;

/// One number of each element of a batch.
pub type Lanes = WideF64x4;

/// A number, or one of each element of a batch.
pub trait Real: SimdRealField<Element = f64> + Copy {}

impl<T: SimdRealField<Element = f64> + Copy> Real for T {}

/// Values `of` the elements of a batch.
#[inline(always)]
pub fn lanes(of: impl FnMut(usize) -> f64) -> Lanes {
    Lanes::from_arr(std::array::from_fn(of))
}

/// What `one` makes of each lane alone.
#[inline(always)]
pub fn lane_by_lane<const N: usize>(e: [Lanes; N], one: impl Fn([f64; N]) -> [f64; N]) -> [Lanes; N] {
    let e = e.map(Lanes::into_arr);
    let results: [[f64; N]; LANES] = std::array::from_fn(|l| one(std::array::from_fn(|i| e[i][l])));
    std::array::from_fn(|i| lanes(|l| results[l][i]))
}

/// Vectors of nodes `nodes` of a flat array, shape `[nodes][3]`.
#[inline(always)]
pub fn gather(x: &[[f64; 3]], nodes: &[u32; LANES]) -> Vector3<Lanes> {
    let [a, b, c, d] = *nodes;
    let rows = [x[a as usize], x[b as usize], x[c as usize], x[d as usize]];
    let component = |i: usize| Lanes::from_arr([rows[0][i], rows[1][i], rows[2][i], rows[3][i]]);
    Vector3::new(component(0), component(1), component(2))
}
