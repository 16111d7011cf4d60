//! Element kernels: pure functions over small fixed-size arrays.
//!
//! A kernel returns nodal forces and the 3x3 blocks of their tangent, exact derivatives of
//! these forces. No kernel knows a mesh: [`crate::loops::Elements`] gathers, scatters and
//! assembles for all of them.

pub mod air;
pub mod bending;
pub mod bent;
pub mod cable;
pub mod hysteresis;
pub mod load;
pub mod mass;
pub mod membrane;
pub mod quad;
pub mod reefing;

#[cfg(test)]
pub(crate) mod check;
#[cfg(test)]
mod step_tests;

use crate::materials::{Regime, Strain, Stress};
use crate::stream::Stream;
use mass::MassMatrix;
use mesh::geometry::{Mat3, Vec3};
use mesh::lanes::{LANES, Lanes};
use nalgebra::Vector3;

/// Positions of an element's nodes in a step, m; see [`crate::loops::Configuration`].
#[derive(Clone, Copy, Debug)]
pub struct Step<const N: usize> {
    /// Positions that turn stresses into forces.
    pub at: [Vec3; N],
    /// Positions at the end of the step.
    pub end: [Vec3; N],
    /// Weight of the strains at `end`.
    pub weight: f64,
}

impl<const N: usize> Step<N> {
    /// Of positions `x` alone.
    pub fn only(x: [Vec3; N]) -> Self {
        Self { at: x, end: x, weight: 1.0 }
    }
}

/// Load on the face of an element, Pa.
#[derive(Clone, Copy, Debug)]
pub struct Load<T = f64> {
    /// Pressure jump, inside minus outside.
    pub pressure: T,
    /// Traction.
    pub traction: Vector3<T>,
}

impl Load {
    /// None.
    pub const ZERO: Self = Self { pressure: 0.0, traction: Vec3::new(0.0, 0.0, 0.0) };
}

/// State of a membrane element: Green strain, second Piola-Kirchhoff stress (Pa), regime.
#[derive(Clone, Copy, Debug)]
pub struct Sheet {
    /// Green strain E11, E22, 2 E12.
    pub strain: Strain,
    /// Stress, Pa.
    pub stress: Stress,
    /// State under the tension-field hypothesis.
    pub regime: Regime,
}

/// Forces and tangent of an element with `N` nodes.
///
/// `TRACTION`: the load has a traction. `BLEND`: the step has a start, so that `end` and
/// `weight` count; otherwise `end` is `at` and `weight` is 1. Kernels with a
/// [`Kernel::RATE`] always see `BLEND`.
pub trait Kernel<const N: usize>: 'static {
    /// Reference state of an element, and its state at the start of the step.
    type Element;
    /// Reference states of [`LANES`] elements; none of kernels without [`Kernel::batch`].
    type Batch;

    /// Whether forces depend on the rate of strains.
    const RATE: bool = false;
    /// Whether forces depend on time.
    const TIMED: bool = false;
    /// Whether forces depend on the air.
    const AIR: bool = false;
    /// Number of internal variables, by which forces depend on earlier steps.
    const VARIABLES: usize = 0;
    /// Whether the elements carry the loads on faces.
    const LOADED: bool = false;

    /// Keeps the state at positions `x` (m) as that of a step's start.
    fn anchor(&self, _e: &mut Self::Element, _x: &[Vec3; N]) {}

    /// Internal minus external nodal forces, N.
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<N>,
        load: &Load,
    ) -> [Vec3; N];

    /// Some elements together, for [`Kernel::forces`] and [`Kernel::externals`]; `None`: the kernel takes each alone.
    fn batch(&self, _e: [&Self::Element; LANES]) -> Option<Self::Batch> {
        None
    }

    /// As [`Kernel::force`] of all elements of a batch with nodes at `x` (m), in a step without a start: the same digits.
    #[inline(always)]
    fn forces<const TRACTION: bool>(
        &self,
        _batch: &Self::Batch,
        _x: &[Vector3<Lanes>; N],
        _load: &Load<Lanes>,
    ) -> Option<[Vector3<Lanes>; N]> {
        None
    }

    /// As [`Kernel::force`], and `factor` times their derivative by `at`, with `end` moving in
    /// proportion: blocks `[row node][column node]`, N/m.
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<N>,
        load: &Load,
        factor: f64,
    ) -> ([Vec3; N], [[Mat3; N]; N]);

    /// External nodal forces alone, N; of [`Kernel::LOADED`] kernels.
    fn external<const TRACTION: bool>(&self, _e: &Self::Element, _x: &[Vec3; N], _load: &Load) -> [Vec3; N] {
        [Vec3::zeros(); N]
    }

    /// As [`Kernel::external`] of all elements of a batch: the same digits.
    #[inline(always)]
    fn externals<const TRACTION: bool>(
        &self,
        _batch: &Self::Batch,
        _x: &[Vector3<Lanes>; N],
        _load: &Load<Lanes>,
    ) -> Option<[Vector3<Lanes>; N]> {
        None
    }

    /// Strain energy, J.
    fn energy(&self, _e: &Self::Element, _x: &[Vec3; N]) -> f64 {
        0.0
    }

    /// Energy (J) taken out of the motion in the step from `before`, where the element was anchored, to `after` (m).
    fn dissipation(&self, _e: &Self::Element, _before: &[Vec3; N], _after: &[Vec3; N]) -> f64 {
        0.0
    }

    /// Ends a step at positions `x` (m), where the internal variables take their values; the energy (J) that they took in it.
    fn advance_history(&self, _e: &mut Self::Element, _x: &[Vec3; N]) -> f64 {
        0.0
    }

    /// Copies the [`Kernel::VARIABLES`] internal variables.
    fn history(&self, _e: &Self::Element, _variables: &mut [f64]) {}

    /// Takes up what [`Kernel::history`] gave.
    fn set_history(&self, _e: &mut Self::Element, _variables: &[f64]) {}

    /// Mass, kg; none where other elements have the mass, and the matrix their blocks.
    fn mass(&self, _e: &Self::Element) -> Option<f64> {
        None
    }

    /// Shares of the mass in the blocks between the nodes.
    fn mass_shares(&self, _e: &Self::Element, kind: MassMatrix) -> [[f64; N]; N] {
        mass::shares::<N>(kind)
    }

    /// State of a membrane element.
    fn sheet(&self, _e: &Self::Element, _x: &[Vec3; N]) -> Option<Sheet> {
        None
    }

    /// Columns of the deformation gradient of a membrane element: what its reference axes became. Of every element that has a
    /// [`Kernel::sheet`]: none is reported without.
    fn tangents(&self, _e: &Self::Element, _x: &[Vec3; N]) -> Option<[Vec3; 2]> {
        None
    }

    /// Tension (N) of a cable element.
    fn tension(&self, _e: &Self::Element, _x: &[Vec3; N]) -> Option<f64> {
        None
    }

    /// Length of the next step, s; see [`crate::loops::ElementLoop::set_step`].
    fn set_step(&mut self, _dt: f64) {}

    /// Retardation time, s, where stresses depend on the rate of strains.
    fn retardation_time(&self) -> f64 {
        0.0
    }

    /// Time at the end of the next step, s; see [`crate::loops::ElementLoop::set_time`].
    fn set_time(&mut self, _t: f64) {}

    /// The undisturbed air in the falling frame.
    fn set_air(&mut self, _air: &Stream) {}

    /// Force of that air (N) in the last step, which ended at positions `x` (m).
    fn air_force(&self, _e: &Self::Element, _x: &[Vec3; N]) -> Vec3 {
        Vec3::zeros()
    }
}
