//! Stress over a time step: averaged strains, corrected so that a step never
//! creates strain energy.

use super::{Material, Moduli, Strain, Stress};
use crate::elements::Sheet;
use mesh::lanes::{Lanes, lane_by_lane};

/// Stress of a sheet over a step. `BLEND`: the step has a start; otherwise the weight is 1 and
/// the strain that of `end` alone. Laws with a [`StepLaw::RATE`] always see `BLEND`.
pub trait StepLaw: 'static {
    /// State at the start of the step.
    type Start: Copy;
    /// Whether the stress depends on the rate of the strain.
    const RATE: bool = false;
    /// Whether it adds to the stress of other elements, which have mass, load and energy.
    const ADDS: bool = false;
    /// Number of internal variables, by which the stress depends on earlier steps. They are part of the state at the start.
    const VARIABLES: usize = 0;

    /// Whether the stress of a step without a start is that of the strain at its end alone.
    const OF_STRAIN: bool = false;

    /// State at strain `e`.
    fn start(&self, e: Strain) -> Self::Start;
    /// Makes `start` the state at strain `e`, without a change of its internal variables.
    fn anchor(&self, start: &mut Self::Start, e: Strain) {
        *start = self.start(e);
    }
    /// Stress of a step from `start` to strain `end` of weight `w`.
    fn stress<const BLEND: bool>(&self, start: &Self::Start, end: Strain, w: f64) -> Stress;
    /// As [`StepLaw::stress`] of the elements of a batch in a step without a start; of laws [`StepLaw::OF_STRAIN`].
    #[inline(always)]
    fn stresses(&self, end: [Lanes; 3]) -> [Lanes; 3] {
        lane_by_lane(end, |end| self.stress::<false>(&self.start(end), end, 1.0))
    }
    /// As [`StepLaw::stress`], with its derivative by `end` divided by `w`.
    fn tangent<const BLEND: bool>(&self, start: &Self::Start, end: Strain, w: f64) -> (Stress, Moduli);
    /// Strain energy per volume at strain `e` in a step from `start`, J/m3.
    fn energy(&self, _start: &Self::Start, _e: Strain) -> f64 {
        0.0
    }
    /// Stress and regime at strain `e` in a step from `start`, where they are reported.
    fn sheet(&self, _start: &Self::Start, _e: Strain) -> Option<Sheet> {
        None
    }
    /// State with the mean internal variables of `points` of one element.
    fn mean(&self, points: &[Self::Start; 4]) -> Self::Start {
        points[0]
    }
    /// Ends a step at strain `e`, where the internal variables take their values; the energy for each volume (J/m3) that they took in it.
    fn advance_history(&self, _start: &mut Self::Start, _e: Strain) -> f64 {
        0.0
    }
    /// Copies the [`StepLaw::VARIABLES`] internal variables.
    fn history(&self, _start: &Self::Start, _variables: &mut [f64]) {}
    /// Takes up what [`StepLaw::history`] gave.
    fn set_history(&self, _start: &mut Self::Start, _variables: &[f64]) {}
    /// Energy (J) that `volume` (m3) takes out of the motion in a step between two strains.
    fn dissipation(&self, _start: &Self::Start, _from: Strain, _to: Strain, _volume: f64) -> f64 {
        0.0
    }
    /// Length of the next step, s.
    fn set_step(&mut self, _dt: f64) {}
    /// Retardation time of a law with a [`StepLaw::RATE`], s.
    fn retardation_time(&self) -> f64 {
        0.0
    }
}

/// A material alone.
pub struct Elastic<M>(pub M);

impl<M: Material> StepLaw for Elastic<M> {
    type Start = StepStart;
    const OF_STRAIN: bool = true;

    fn start(&self, e: Strain) -> StepStart {
        StepStart::new(&self.0, e)
    }

    #[inline(always)]
    fn stresses(&self, end: [Lanes; 3]) -> [Lanes; 3] {
        self.0.stresses(end)
    }

    #[inline(always)]
    fn stress<const BLEND: bool>(&self, start: &StepStart, end: Strain, w: f64) -> Stress {
        if BLEND { stress(&self.0, start, end, w) } else { self.0.stress(end) }
    }

    #[inline(always)]
    fn tangent<const BLEND: bool>(&self, start: &StepStart, end: Strain, w: f64) -> (Stress, Moduli) {
        if BLEND { tangent(&self.0, start, end, w) } else { self.0.tangent(end) }
    }

    fn energy(&self, _start: &StepStart, e: Strain) -> f64 {
        self.0.energy(&self.0.stress(e), &e)
    }

    fn sheet(&self, _start: &StepStart, e: Strain) -> Option<Sheet> {
        Some(Sheet { strain: e, stress: self.0.stress(e), regime: self.0.regime(e) })
    }
}

/// Strain at the start of a step, and the energy stored there.
#[derive(Clone, Copy, Debug, Default)]
pub struct StepStart {
    strain: Strain,
    /// J/m3.
    pub(super) energy: f64,
}

impl StepStart {
    /// At strain `e`.
    pub fn new(material: &impl Material, e: Strain) -> Self {
        Self { strain: e, energy: material.energy(&material.stress(e), &e) }
    }
}

/// Stress of a step from `start` to strain `end`.
///
/// With $`E_w = wE_1+(1-w)E_0`$, $`w\ge\tfrac12`$, a quadratic energy satisfies
/// $`S(E_w):\Delta E \ge \Delta W`$, with equality at $`w=\tfrac12`$: nothing is created
/// (Simo and Tarnow 1992). A tension field is not quadratic where its state
/// changes within the step; there the least correction along $`\Delta E`$ restores
/// the bound, as in a discrete gradient (Gonzalez 1996):
/// $`S = S(E_w) + \beta\,\Delta E,\ \beta=\max(0,\Delta W-S(E_w):\Delta E)/(\Delta E:\Delta E)`$.
#[inline(always)]
pub fn stress(m: &impl Material, start: &StepStart, end: Strain, w: f64) -> Stress {
    let s = m.stress(mean(start, &end, w));
    let c = correction(m, start, &end, &s);
    [s[0] + c.beta * c.delta[0], s[1] + c.beta * c.delta[1], s[2] + c.beta * c.delta[2]]
}

/// As [`stress`], with its derivative by `end` divided by `w`. Not symmetric where
/// corrected.
#[inline(always)]
pub fn tangent(m: &impl Material, start: &StepStart, end: Strain, w: f64) -> (Stress, Moduli) {
    let (mut s, mut k) = m.tangent(mean(start, &end, w));
    let Correction { beta, delta, change, size, end_stress } = correction(m, start, &end, &s);
    if beta > 0.0 {
        let slope: [f64; 3] = std::array::from_fn(|j| {
            let ck: f64 = (0..3).map(|i| change[i] * k[i][j]).sum();
            // 2 beta Delta E, in the metric of the double contraction.
            end_stress[j] - s[j] - w * ck - 2.0 * beta * delta[j]
        });
        for i in 0..3 {
            for j in 0..3 {
                k[i][j] += delta[i] * slope[j] / (size * w);
            }
            s[i] += beta * delta[i];
        }
        // Delta E itself: the shear row holds E12 = gamma / 2.
        k[0][0] += beta / w;
        k[1][1] += beta / w;
        k[2][2] += 0.5 * beta / w;
    }
    (s, k)
}

struct Correction {
    beta: f64,
    /// The tensor Delta E in the order of stresses: 11, 22, 12.
    delta: [f64; 3],
    /// Delta E in the order of strains: E11, E22, 2 E12.
    change: [f64; 3],
    /// Delta E : Delta E.
    size: f64,
    end_stress: Stress,
}

#[inline(always)]
fn correction(m: &impl Material, start: &StepStart, end: &Strain, s: &Stress) -> Correction {
    let change: [f64; 3] = std::array::from_fn(|i| end[i] - start.strain[i]);
    let delta = [change[0], change[1], 0.5 * change[2]];
    let end_stress = m.stress(*end);
    let stored = m.energy(&end_stress, end);
    let work = dot(s, &change);
    let size = dot(&delta, &change);
    let missing = stored - start.energy - work;
    // Differences below rounding are none.
    let noise = 1e-13 * (stored + start.energy + work.abs());
    let beta = if missing > noise && size > 0.0 { missing / size } else { 0.0 };
    Correction { beta, delta, change, size, end_stress }
}

#[inline(always)]
fn mean(start: &StepStart, end: &Strain, w: f64) -> Strain {
    std::array::from_fn(|i| w * end[i] + (1.0 - w) * start.strain[i])
}

#[inline(always)]
fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::materials::{StVenantKirchhoff, TensionField};
    use proptest::prelude::*;

    proptest! {
        /// No step creates energy, whatever states it passes.
        #[test]
        fn work_covers_the_stored_energy(
            a in prop::array::uniform3(-0.3..0.3f64), b in prop::array::uniform3(-0.3..0.3f64), w in 0.5..1.0f64,
        ) {
            let m = TensionField::new(7.0, 0.3);
            let s = stress(&m, &StepStart::new(&m, a), b, w);
            let change: [f64; 3] = std::array::from_fn(|i| b[i] - a[i]);
            let stored = m.energy(&m.stress(b), &b) - m.energy(&m.stress(a), &a);
            prop_assert!(dot(&s, &change) - stored > -1e-12);
        }

        /// A quadratic law conserves with w = 1/2 and needs no correction.
        #[test]
        fn a_quadratic_law_conserves(
            a in prop::array::uniform3(-0.3..0.3f64), b in prop::array::uniform3(-0.3..0.3f64),
        ) {
            let m = StVenantKirchhoff::isotropic(7.0, 0.3);
            let s = stress(&m, &StepStart::new(&m, a), b, 0.5);
            let mid: [f64; 3] = std::array::from_fn(|i| 0.5 * (a[i] + b[i]));
            let exact = m.stress(mid);
            for i in 0..3 {
                prop_assert!((s[i] - exact[i]).abs() < 1e-11);
            }
        }

        /// Central differences, away from borders of the states (seen as a jump of
        /// the material tangent) and of the correction.
        #[test]
        fn tangent_is_the_derivative(
            a in prop::array::uniform3(-0.3..0.3f64), b in prop::array::uniform3(-0.3..0.3f64), w in 0.5..1.0f64,
        ) {
            let m = TensionField::new(7.0, 0.3);
            let start = StepStart::new(&m, a);
            let (s, k) = tangent(&m, &start, b, w);
            let h = 1e-6;
            for j in 0..3 {
                let moved = |by: f64| { let mut e = b; e[j] += by; e };
                let regime = |by: f64| {
                    let e = moved(by);
                    let c = correction(&m, &start, &e, &m.stress(mean(&start, &e, w)));
                    (m.regime(e), m.regime(mean(&start, &e, w)), c.beta > 0.0)
                };
                prop_assume!(regime(50.0 * h) == regime(-50.0 * h));
                let (up, down) = (stress(&m, &start, moved(h), w), stress(&m, &start, moved(-h), w));
                for i in 0..3 {
                    let difference = (up[i] - down[i]) / (2.0 * h);
                    prop_assert!((difference - w * k[i][j]).abs() < 2e-4, "{} {}", difference, w * k[i][j]);
                }
            }
            prop_assert_eq!(s, stress(&m, &start, b, w));
        }
    }
}
