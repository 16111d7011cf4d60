use super::{Material, Moduli, Regime, Strain, Stress};
use mesh::lanes::{Lanes, Real};

/// A law about a stress that is there without strain: the fabric was stretched before it was
/// measured. $`S(E) = S_0(E + E_0)`$, $`W(E) = W_0(E + E_0)`$ with the strain $`E_0`$ that the
/// prestress needs; the energy counts from where the fabric is slack.
#[derive(Clone, Copy, Debug)]
pub struct Prestressed<M> {
    law: M,
    offset: Strain,
}

impl<M: Material> Prestressed<M> {
    /// `law` about the same stress `prestress` (Pa, at least zero) along all directions.
    pub fn new(law: M, prestress: f64) -> Self {
        if prestress == 0.0 {
            return Self { law, offset: [0.0; 3] };
        }
        // The laws are linear where they are taut: two pulls give the strain.
        let [a, b] = [law.tangent([1.0, 1.0, 0.0]).1[0], law.tangent([1.0, 1.0, 0.0]).1[1]];
        let determinant = a[0] * b[1] - a[1] * b[0];
        let offset = [prestress * (b[1] - a[1]) / determinant, prestress * (a[0] - b[0]) / determinant, 0.0];
        Self { law, offset }
    }

    #[inline(always)]
    fn whole<T: Real>(&self, e: &[T; 3]) -> [T; 3] {
        std::array::from_fn(|i| e[i] + T::splat(self.offset[i]))
    }
}

impl<M: Material> Material for Prestressed<M> {
    #[inline(always)]
    fn stress(&self, e: Strain) -> Stress {
        self.law.stress(self.whole(&e))
    }

    #[inline(always)]
    fn stresses(&self, e: [Lanes; 3]) -> [Lanes; 3] {
        self.law.stresses(self.whole(&e))
    }

    #[inline(always)]
    fn tangent(&self, e: Strain) -> (Stress, Moduli) {
        self.law.tangent(self.whole(&e))
    }

    #[inline(always)]
    fn energy(&self, s: &Stress, e: &Strain) -> f64 {
        self.law.energy(s, &self.whole(e))
    }

    fn regime(&self, e: Strain) -> Regime {
        self.law.regime(self.whole(&e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::step::{self, StepStart};
    use crate::materials::{OrthotropicTensionField, StVenantKirchhoff, TensionField};
    use proptest::prelude::*;

    fn holds(law: impl Material) {
        let m = Prestressed::new(law, 0.4);
        let s = m.stress([0.0; 3]);
        assert!((s[0] - 0.4).abs() < 1e-14 && (s[1] - 0.4).abs() < 1e-14 && s[2] == 0.0, "{s:?}");
        assert_eq!(m.regime([0.0; 3]), Regime::Taut);
    }

    #[test]
    fn unstrained_fabric_has_the_prestress() {
        holds(StVenantKirchhoff::isotropic(7.0, 0.3));
        holds(TensionField::new(7.0, 0.3));
        holds(StVenantKirchhoff::orthotropic(7.0, 2.0, 0.25, 0.6));
        holds(OrthotropicTensionField::new(7.0, 2.0, 0.25, 0.6));
    }

    proptest! {
        /// The stress is the derivative of the energy, and a step creates none.
        #[test]
        fn stress_and_energy_belong_together(
            a in prop::array::uniform3(-0.2..0.2f64), b in prop::array::uniform3(-0.2..0.2f64),
        ) {
            let m = Prestressed::new(TensionField::new(7.0, 0.3), 0.4);
            let energy = |e: Strain| m.energy(&m.stress(e), &e);
            let h = 1e-6;
            for i in 0..3 {
                let at = |by: f64| { let mut e = a; e[i] += by; energy(e) };
                let slope = (at(h) - at(-h)) / (2.0 * h);
                prop_assert!((slope - m.stress(a)[i]).abs() < 1e-5, "{} {:?}", slope, m.stress(a));
            }
            let s = step::stress(&m, &StepStart::new(&m, a), b, 0.5);
            let work: f64 = (0..3).map(|i| s[i] * (b[i] - a[i])).sum();
            prop_assert!(work - (energy(b) - energy(a)) > -1e-12);
        }
    }
}
