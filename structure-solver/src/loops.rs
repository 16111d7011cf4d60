//! The element loops: kernels applied to every element of a rank.
//!
//! A loop is written for concrete materials and laws, so the compiler sees
//! straight arithmetic; which loops there are is chosen once, at construction.

mod contact;
mod elements;
mod kinds;
mod stencil;

pub use contact::{Contact, ContactLaw};
pub use elements::Elements;

use crate::elements::Sheet;
use crate::elements::mass::MassMatrix;
use crate::failure_site::principal;
use crate::flat::Block;
use crate::materials::{Regime, Stress};
use crate::stream::Stream;
use mesh::geometry::Vec3;

/// Loads on the interface faces at one instant.
#[derive(Clone, Copy, Debug)]
pub struct FaceLoad<'a> {
    /// Pressure jump, inside minus outside, Pa, one for each face.
    pub pressure: &'a [f64],
    /// Traction, Pa, shape `[faces][3]`; empty where there is none.
    pub traction: &'a [f64],
}

/// The configuration in which forces balance.
///
/// Geometry and loads are taken at positions `at`. Strains are those at `end`, or,
/// with a `weight` below one, `weight E(end) + (1 - weight) E(start)` with the
/// strains of the step's start ([`ElementLoop::anchor`]): the work of averaged
/// strains over a step equals the change of a quadratic energy (Simo and Tarnow
/// 1992; Kuhl and Crisfield 1999), where strains at averaged positions can create
/// energy without bound.
#[derive(Clone, Copy, Debug)]
pub struct Configuration<'a> {
    /// Positions that turn stresses into forces, m.
    pub at: &'a [f64],
    /// Positions at the end of the step, m.
    pub end: &'a [f64],
    /// Weight of the strains at `end`.
    pub weight: f64,
}

impl<'a> Configuration<'a> {
    /// Forces of positions `x` alone.
    pub fn only(x: &'a [f64]) -> Self {
        Self { at: x, end: x, weight: 1.0 }
    }
}

/// Slot of a block in a row that another rank owns: not assembled here.
pub const ELSEWHERE: u32 = u32::MAX;

/// The elements of one kind on a rank. Flat arrays have shape `[n_local][3]`;
/// rows of ghosts receive partial sums that nobody reads.
pub trait ElementLoop {
    /// Keeps the strains at positions `x` (m) as those of a step's start.
    fn anchor(&mut self, x: &[f64]);

    /// Whether forces depend on the rate of strains: then [`ElementLoop::anchor`] and
    /// [`ElementLoop::set_step`] precede every step.
    fn depends_on_rate(&self) -> bool {
        false
    }

    /// Length of the next step, s; infinite where rates do not count.
    fn set_step(&mut self, _dt: f64) {}

    /// Retardation time, s, where stresses depend on the rate of strains; explicit steps shrink with it.
    fn retardation_time(&self) -> f64 {
        0.0
    }

    /// Whether forces depend on time: then [`ElementLoop::set_time`] precedes every step.
    fn depends_on_time(&self) -> bool {
        false
    }

    /// Time at the end of the next step, s since the start of the stage; infinite for a shape
    /// at rest.
    fn set_time(&mut self, _t: f64) {}

    /// Whether forces depend on the air: then [`ElementLoop::set_air`] precedes every window.
    fn feels_air(&self) -> bool {
        false
    }

    /// Velocity of the undisturbed air in the falling frame, m/s.
    fn set_air(&mut self, _air: &Stream) {}

    /// Force of that air (N) on the elements counted on this rank in the last step, which
    /// ended at positions `x` (m).
    fn air_force(&self, _x: &[f64]) -> Vec3 {
        Vec3::zeros()
    }

    /// Whether forces depend on earlier steps or act between nodes that no element joins: then [`ElementLoop::advance_history`]
    /// precedes every step.
    fn has_history(&self) -> bool {
        false
    }

    /// Ends a step at positions `x` (m): internal variables take their values there, and contact finds what is near what. Collective where forces
    /// act between ranks.
    fn advance_history(&mut self, _x: &[f64]) {}

    /// Whether the history takes energy: then [`ElementLoop::advance_history`] follows every step, and [`ElementLoop::dissipated`].
    fn has_dissipation(&self) -> bool {
        false
    }

    /// Energy (J) that what is counted on this rank took since the last call.
    fn dissipated(&mut self) -> f64 {
        0.0
    }

    /// The state now is that of an accepted window.
    fn keep(&mut self) {}

    /// Returns to the state of [`ElementLoop::keep`], so that all solves of a window depend on their input alone.
    fn rewind(&mut self) {}

    /// State other than positions and velocities that later steps depend on, when it was kept last.
    fn save_state(&self) -> Vec<f64> {
        Vec::new()
    }

    /// Takes up what [`ElementLoop::save_state`] gave.
    ///
    /// # Errors
    /// What in it does not fit; nothing is taken up then.
    fn restore_state(&mut self, memory: &[f64]) -> Result<(), String> {
        if memory.is_empty() { Ok(()) } else { Err("elements that keep nothing have kept something".into()) }
    }

    /// Energy (J) that elements counted on this rank took out of the motion in the
    /// step from positions `before`, where they were anchored, to `after` (m).
    fn dissipation(&self, _before: &[f64], _after: &[f64]) -> f64 {
        0.0
    }

    /// Adds internal minus external forces (N) to `out`.
    fn forces(&self, configuration: Configuration<'_>, load: FaceLoad<'_>, out: &mut [f64]);

    /// As [`ElementLoop::forces`], and adds `factor` times their derivative to
    /// the blocks of the system matrix. The derivative is by `at`, with `end`
    /// moving in proportion (`factor` is their common weight).
    fn tangent(
        &self,
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Block],
    );

    /// As [`ElementLoop::forces`] for the elements that touch an `active` node, shape
    /// `[n_local]`: right in the rows of active nodes, of no meaning in others.
    fn forces_near(
        &self,
        _active: &[bool],
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        out: &mut [f64],
    ) {
        self.forces(configuration, load, out);
    }

    /// As [`ElementLoop::tangent`] for the elements that touch an `active` node, shape
    /// `[n_local]`: right in the rows of active nodes, of no meaning in others.
    fn tangent_near(
        &self,
        _active: &[bool],
        configuration: Configuration<'_>,
        load: FaceLoad<'_>,
        factor: f64,
        out: &mut [f64],
        blocks: &mut [Block],
    ) {
        self.tangent(configuration, load, factor, out, blocks);
    }

    /// Adds external forces alone (N) to `out`.
    fn external(&self, _x: &[f64], _load: FaceLoad<'_>, _out: &mut [f64]) {}

    /// Strain energy of the elements counted on this rank, J.
    fn energy(&self, _x: &[f64]) -> f64 {
        0.0
    }

    /// Masses of the elements with their local nodes, kg; none where others have the mass, and the
    /// matrix their blocks.
    fn masses(&self) -> Vec<(Vec<u32>, f64)> {
        Vec::new()
    }

    /// Shares of the mass of element `element` (of [`ElementLoop::masses`]) in the
    /// blocks between its nodes, row by row.
    fn mass_shares(&self, _element: usize, _kind: MassMatrix) -> Vec<f64> {
        Vec::new()
    }

    /// Finds where the blocks of the elements lie in the system matrix.
    fn assign_slots(&mut self, slot: &dyn Fn(u32, u32) -> u32);

    /// Places of the membrane elements whose states are reported among [`crate::model::Model::triangles`].
    fn sheets(&self) -> &[u32] {
        &[]
    }

    /// States of membrane elements with nodes at `x` (m), in the order of [`ElementLoop::sheets`]. A bilinear element says it for each
    /// of the two triangles of its face.
    fn sheet_states(&self, _x: &[f64]) -> Vec<SheetState> {
        Vec::new()
    }

    /// Places of the elements with a tension among [`crate::model::Model::cables`].
    fn cables(&self) -> &[u32] {
        &[]
    }

    /// Tensions (N) of cable elements, in the order of [`ElementLoop::cables`].
    fn tensions(&self, _x: &[f64]) -> Vec<f64> {
        Vec::new()
    }
}

/// State of a membrane element.
#[derive(Clone, Copy, Debug)]
pub struct SheetState {
    /// Strain, stress and regime.
    pub sheet: Sheet,
    /// Columns of the deformation gradient.
    pub gradient: [Vec3; 2],
}

/// What is reported of membrane elements, in the order of [`ElementLoop::sheets`]. Here, so that it is compiled once and not for each kernel.
impl dyn ElementLoop + '_ {
    /// Principal stresses, Pa, the larger first, and regime.
    pub fn stresses(&self, x: &[f64]) -> Vec<([f64; 2], Regime)> {
        let of = |s: &SheetState| (principal_stresses(&s.sheet.stress), s.sheet.regime);
        self.sheet_states(x).iter().map(of).collect()
    }

    /// Larger principal values of the nominal stress, Pa: force for each unstressed cross-section.
    pub fn nominal_stresses(&self, x: &[f64]) -> Vec<f64> {
        self.sheet_states(x).iter().map(|s| nominal_stress(&s.sheet)).collect()
    }

    /// Principal Green strains, the larger first.
    pub fn strains(&self, x: &[f64]) -> Vec<[f64; 2]> {
        self.sheet_states(x).iter().map(|s| principal(s.sheet.strain)).collect()
    }

    /// Unit vectors along the larger principal stresses in the shape at `x`; zero where there is no stress.
    pub fn stress_directions(&self, x: &[f64]) -> Vec<Vec3> {
        self.sheet_states(x).iter().map(|s| stress_direction(&s.sheet.stress, s.gradient)).collect()
    }
}

/// Principal values of a stress in Voigt order (11, 22, 12), the larger first, Pa.
fn principal_stresses(s: &Stress) -> [f64; 2] {
    let (mean, radius) = (0.5 * (s[0] + s[1]), (0.25 * (s[0] - s[1]).powi(2) + s[2].powi(2)).sqrt());
    [mean + radius, mean - radius]
}

/// Unit vector along the larger principal value of the second Piola-Kirchhoff stress `s`, carried into the present shape by
/// `f`, the columns of the deformation gradient: $`F N_1 / |F N_1|`$. Zero without stress.
fn stress_direction(s: &Stress, f: [Vec3; 2]) -> Vec3 {
    if *s == [0.0; 3] {
        return Vec3::zeros();
    }
    let (sin, cos) = (0.5 * (2.0 * s[2]).atan2(s[0] - s[1])).sin_cos();
    let along = f[0] * cos + f[1] * sin;
    along.try_normalize(0.0).unwrap_or_else(Vec3::zeros)
}

/// Larger principal value of the nominal stress, Pa: the largest singular value of the first Piola-Kirchhoff stress
/// $`P = F S`$, from $`P^T P = S C S`$ with $`C = I + 2 E`$.
fn nominal_stress(s: &Sheet) -> f64 {
    let [e11, e22, g12] = s.strain;
    let [s11, s22, s12] = s.stress;
    let (c11, c22, c12) = (1.0 + 2.0 * e11, 1.0 + 2.0 * e22, g12);
    let square = [
        s11 * s11 * c11 + 2.0 * s11 * s12 * c12 + s12 * s12 * c22,
        s12 * s12 * c11 + 2.0 * s12 * s22 * c12 + s22 * s22 * c22,
        s11 * s12 * c11 + (s11 * s22 + s12 * s12) * c12 + s12 * s22 * c22,
    ];
    principal_stresses(&square)[0].max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sheet(strain: [f64; 3], stress: Stress) -> Sheet {
        Sheet { strain, stress, regime: Regime::Taut }
    }

    /// A strip of stretch 1.2 under S11: the force for each unstressed width is 1.2 S11. Turning the axes changes nothing.
    #[test]
    fn nominal_stress_is_the_force_for_each_unstressed_width() {
        let e = 0.5 * (1.2f64.powi(2) - 1.0);
        assert!((nominal_stress(&sheet([e, -0.1, 0.0], [50.0, 0.0, 0.0])) - 60.0).abs() < 1e-12);
        // Both ways, the larger second: 1.2 * 50 against sqrt(0.8) * 80.
        let both = nominal_stress(&sheet([e, -0.1, 0.0], [50.0, 80.0, 0.0]));
        assert!((both - 80.0 * 0.8f64.sqrt()).abs() < 1e-12, "{both}");
        let (sin, cos) = 0.4f64.sin_cos();
        let turned = |[a, b]: [f64; 2]| {
            [a * cos * cos + b * sin * sin, a * sin * sin + b * cos * cos, (a - b) * sin * cos]
        };
        let (mut strain, stress) = (turned([e, -0.1]), turned([50.0, 80.0]));
        strain[2] *= 2.0;
        assert!((nominal_stress(&sheet(strain, stress)) - both).abs() < 1e-12);
        assert_eq!(nominal_stress(&sheet([0.1, 0.2, 0.3], [0.0; 3])), 0.0);
    }

    /// A tension along an axis of the material turns and shears with it.
    #[test]
    fn stress_direction_moves_with_the_fabric() {
        let angle = 0.4f64;
        let (sin, cos) = angle.sin_cos();
        let tension = |along: f64, across: f64| {
            let (a, b) = (along, across);
            [a * cos * cos + b * sin * sin, a * sin * sin + b * cos * cos, (a - b) * sin * cos]
        };
        let flat = [Vec3::x(), Vec3::y()];
        let close = |found: Vec3, expected: Vec3| {
            found.cross(&expected).norm() < 1e-12 && (found.norm() - 1.0).abs() < 1e-12
        };
        let fibre = Vec3::new(cos, sin, 0.0);
        assert!(close(stress_direction(&tension(50.0, -3.0), flat), fibre));
        // The larger one, not the one of the larger magnitude.
        assert!(close(stress_direction(&tension(5.0, -80.0), flat), fibre));
        let f = [Vec3::new(0.0, 1.2, 0.3), Vec3::new(0.4, 0.0, 0.9)];
        assert!(close(stress_direction(&tension(50.0, 20.0), f), (f[0] * cos + f[1] * sin).normalize()));
        assert_eq!(stress_direction(&[0.0; 3], f), Vec3::zeros());
    }
}
