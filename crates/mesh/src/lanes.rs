//! Several elements at a time: the scalar of kernels that are computed in the lanes of a vector register.
//!
//! A kernel written for [`Real`] is one formula for one element and for [`LANES`] of them. Each lane has the operations of the single element
//! in the same order, so the same digits.

use nalgebra::{SimdRealField, SimdValue, Vector3};
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

/// Components of the rows of the elements of a batch.
#[inline(always)]
pub fn columns<const N: usize>(rows: [&[f64; N]; LANES]) -> [Lanes; N] {
    let [a, b, c, d] = rows;
    let mut columns = [Lanes::splat(0.0); N];
    for (v, column) in columns.iter_mut().enumerate() {
        *column = Lanes::from_arr([a[v], b[v], c[v], d[v]]);
    }
    columns
}

/// The numbers of the elements `at` of an array.
#[inline(always)]
pub fn value(x: &[f64], at: &[usize; LANES]) -> Lanes {
    Lanes::from_arr([x[at[0]], x[at[1]], x[at[2]], x[at[3]]])
}

/// The rows of the elements `at` of an array, component by component.
#[inline(always)]
pub fn rows<const N: usize>(x: &[[f64; N]], at: &[usize; LANES]) -> [Lanes; N] {
    columns([&x[at[0]], &x[at[1]], &x[at[2]], &x[at[3]]])
}

/// Vectors of nodes `nodes` of a flat array, shape `[nodes][3]`.
#[inline(always)]
pub fn gather(x: &[[f64; 3]], nodes: &[u32; LANES]) -> Vector3<Lanes> {
    let [a, b, c, d] = *nodes;
    rows(x, &[a as usize, b as usize, c as usize, d as usize]).into()
}
