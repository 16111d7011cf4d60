//! Forces and tangent of two-node elements under axial stress: cables, their damping, reefing lines.

use super::stencil::Stencil;
use crate::elements::cable;
use crate::vec3::{Mat3, Vec3};

/// What a two-node element makes its forces of.
pub(super) struct Axial {
    /// Vector between the ends that turns the stress into forces, m.
    pub(super) d: Vec3,
    /// Vector between the ends at the end of the step, along which the strain grows, m.
    pub(super) end: Vec3,
    /// Rest length, m.
    pub(super) rest_length: f64,
    /// Stress, Pa.
    pub(super) s: f64,
    /// Its derivative by the strain, Pa.
    pub(super) y: f64,
}

/// Adds the forces (N) of `elements` of cross-section `area` (m2).
#[inline(always)]
pub(super) fn add_forces<'e>(
    elements: impl Iterator<Item = (&'e Stencil<2>, Axial)>,
    area: f64,
    out: &mut [f64],
) {
    for (stencil, a) in elements {
        stencil.scatter_pull(cable::force(a.s, a.d, a.rest_length, area), out);
    }
}

/// As [`add_forces`], and adds `factor` times the derivative to the blocks of the matrix.
#[inline(always)]
pub(super) fn add_tangent<'e>(
    elements: impl Iterator<Item = (&'e Stencil<2>, Axial)>,
    area: f64,
    factor: f64,
    out: &mut [f64],
    blocks: &mut [Mat3],
) {
    for (stencil, a) in elements {
        stencil.scatter_pull(cable::force(a.s, a.d, a.rest_length, area), out);
        let k = cable::stiffness(a.s, a.y, a.d, a.end, a.rest_length, area);
        stencil.add_spring(&k, factor, blocks);
    }
}
