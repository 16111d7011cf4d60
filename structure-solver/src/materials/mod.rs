//! Fabric laws in plane stress, between Green strain and second
//! Piola-Kirchhoff stress.
//!
//! A law is two functions. The strain energy follows from the stress: that of each law here is
//! homogeneous of degree one in the strain (a prestress counts as one), so the energy per
//! volume is `S:E/2`.

mod orthotropic_field;
mod prestressed;
pub mod step;
mod svk;
mod tension_field;

pub use orthotropic_field::OrthotropicTensionField;
pub use prestressed::Prestressed;
pub use svk::StVenantKirchhoff;
pub use tension_field::TensionField;

/// Stress (Pa) in Voigt order 11, 22, 12.
pub type Stress = [f64; 3];
/// Green strain in Voigt order E11, E22, 2 E12.
pub type Strain = [f64; 3];
/// Material tangent dS/dE (Pa).
pub type Moduli = [[f64; 3]; 3];

/// State of a membrane under the tension-field hypothesis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Regime {
    /// No tension in any direction.
    Slack = 0,
    /// Tension in one direction, wrinkles across it.
    Wrinkled = 1,
    /// Tension in every direction.
    Taut = 2,
}

/// A law of plane stress.
pub trait Material: Copy + 'static {
    /// Stress for the Green strain `e`.
    fn stress(&self, e: Strain) -> Stress;
    /// Stress and its derivative.
    fn tangent(&self, e: Strain) -> (Stress, Moduli);
    /// Strain energy per volume, J/m3, where the strain is `e` and the stress `s`.
    #[inline(always)]
    fn energy(&self, s: &Stress, e: &Strain) -> f64 {
        0.5 * (s[0] * e[0] + s[1] * e[1] + s[2] * e[2])
    }
    /// State for pictures and reports; laws without wrinkling are always taut.
    fn regime(&self, _e: Strain) -> Regime {
        Regime::Taut
    }
}
