//! Fabric laws in plane stress, between Green strain and second
//! Piola-Kirchhoff stress.
//!
//! A law is two functions. The strain energy follows from the stress where that is
//! homogeneous of degree one in the strain (a prestress counts as one): the energy per
//! volume is `S:E/2`. Other laws give their own. How to add one: `docs/how-to/add-a-membrane-material.md`.

mod hysteretic;
mod neo_hookean;
mod orthotropic_field;
mod prestressed;
pub mod slider;
pub mod step;
mod svk;
mod tension_field;
mod viscous;

#[cfg(test)]
pub(crate) mod check;

use mesh::lanes::{Lanes, lane_by_lane};

pub use hysteretic::Hysteretic;
pub use neo_hookean::{NeoHookean, NeoHookeanTensionField};
pub use orthotropic_field::OrthotropicTensionField;
pub use prestressed::Prestressed;
pub use step::{Elastic, StepLaw};
pub use svk::StVenantKirchhoff;
pub use tension_field::TensionField;
pub use viscous::{KelvinVoigt, Viscous};

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
pub trait Material: 'static {
    /// Stress for the Green strain `e`.
    fn stress(&self, e: Strain) -> Stress;
    /// As [`Material::stress`] of the elements of a batch, the same digits. A law of one formula computes them together.
    #[inline(always)]
    fn stresses(&self, e: [Lanes; 3]) -> [Lanes; 3] {
        lane_by_lane(e, |e| self.stress(e))
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Laws of an incompressible film, Poisson's ratio 0.5.
    fn incompressible() -> (StVenantKirchhoff, TensionField, OrthotropicTensionField) {
        let (y, nu) = (7.0, 0.5);
        (
            StVenantKirchhoff::isotropic(y, nu),
            TensionField::new(y, nu),
            OrthotropicTensionField::new(y, y, nu, 0.5 * y / (1.0 + nu)),
        )
    }

    /// The closed form in plane stress: S11 = Y (E11 + E22 / 2) / (3/4), so an equal pull gives 2 Y E.
    #[test]
    fn an_incompressible_film_has_the_closed_form() {
        let (elastic, field, orthotropic) = incompressible();
        let e = [0.1, 0.1, 0.0];
        for s in [elastic.stress(e), field.stress(e), orthotropic.stress(e)] {
            assert!((s[0] - 1.4).abs() < 1e-14 && (s[1] - 1.4).abs() < 1e-14 && s[2] == 0.0, "{s:?}");
        }
        let held = Prestressed::new(field, 0.4).stress([0.0; 3]);
        assert!((held[0] - 0.4).abs() < 1e-14 && (held[1] - 0.4).abs() < 1e-14, "{held:?}");
        // Taut until the pull narrows it by half: E22 = -E11 / 2.
        assert_eq!(field.regime([0.1, -0.0499, 0.0]), Regime::Taut);
        assert_eq!(field.regime([0.1, -0.0501, 0.0]), Regime::Wrinkled);
    }

    proptest! {
        /// Both tension fields agree, and no strain has a negative energy or a stress that is not finite.
        #[test]
        fn an_incompressible_film_is_regular(e in prop::array::uniform3(-0.3..0.3f64)) {
            let (elastic, field, orthotropic) = incompressible();
            let (s, t) = (field.stress(e), orthotropic.stress(e));
            for i in 0..3 {
                prop_assert!((s[i] - t[i]).abs() < 1e-12, "{:?} {:?}", s, t);
            }
            let work = elastic.stress(e);
            prop_assert!(elastic.energy(&work, &e) >= 0.0 && field.energy(&s, &e) >= 0.0);
            prop_assert!(field.tangent(e).1.iter().flatten().all(|c| c.is_finite()));
        }
    }
}
