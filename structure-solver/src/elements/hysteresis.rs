//! Lines that return less work than it took to stretch them.
//!
//! Strands that rub on each other are a slider in parallel with the elastic line (a Jenkin element: Iwan, J. Appl. Mech. 33, 1966,
//! 893-900), whose limit grows with the tension, as dry friction does. For the elastic stress $`S_e = Y_e E`$
//! - the slider sticks with the stiffness $`k Y_e`$, $`\dot S_f = k Y_e \dot E`$, while $`|S_f| \le \mu |S_e|`$,
//! - and slips at this limit. A slack line has none.
//!
//! With $`Y_e = Y / (1 + \mu)`$ a line that is loaded for the first time has the modulus $`Y`$; unloaded, it follows
//! $`(1-\mu) Y_e E`$. A slow cycle from zero to $`E_0`$ and back takes the share
//! ```math
//! \psi = \frac{2 \mu (k-\mu)}{(1+\mu)(k+\mu)}
//! ```
//! of the work of loading, whatever $`E_0`$ and the rate. The slider is integrated from the start of a step to its end by
//! the closest point (backward Euler): the work that it does not store, $`S_1 \Delta E - \Delta (S^2) / (2 k Y_e)`$, is never negative. With implicit
//! steps that is first order in time, too much by the share of a step in the time of loading.

use super::cable::{CableLaw, force, stiffness, strain};
use super::{Kernel, Load, Step};
use mesh::geometry::{Mat3, Vec3};

/// Stiffness of the slider that sticks over the elastic one, `k`.
const STICK: f64 = 2.0;

/// Strain of a slider before its first step: no line has it.
const NEVER: f64 = f64::MAX;

/// Limit over elastic stress, $`\mu`$, of lines that lose the share `loss` of the work of loading: the smaller solution of $`\psi(\mu)`$ = `loss`, which
/// has one up to [`case::MOST_HYSTERESIS`].
pub fn friction(loss: f64) -> f64 {
    let b = 2.0 * STICK - loss * (1.0 + STICK);
    let a = loss + 2.0;
    (b - (b * b - 4.0 * a * loss * STICK).sqrt()) / (2.0 * a)
}

/// Sliders of lines.
pub struct Hysteresis<L> {
    /// Elastic law of the lines.
    law: L,
    /// Green strain at rest length that makes the pre-stress.
    offset: f64,
    /// Limit over elastic stress.
    friction: f64,
    /// Stiffness of a slider that sticks, Pa.
    stiffness: f64,
    /// Weight of the stress at the end of a step in its work: 1 of implicit steps, whose forces have this stress; 1/2 of central differences.
    end_weight: f64,
}

/// State of a slider at the end of a step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slider {
    /// Green strain of the line.
    pub strain: f64,
    /// Stress of the slider, Pa.
    pub stress: f64,
}

/// A line with a slider.
pub struct HystereticLine {
    /// Rest length, m.
    length: f64,
    /// Cross-section, m2.
    area: f64,
    /// `None` before the first step: as after the first loading.
    slider: Option<Slider>,
}

impl<L: CableLaw> Hysteresis<L> {
    /// Of lines with the elastic `law` of modulus `youngs_modulus` (Pa), the strain `offset` at rest length, and a limit of `friction` times the
    /// elastic stress.
    pub fn new(law: L, youngs_modulus: f64, offset: f64, friction: f64) -> Self {
        Self { law, offset, friction, stiffness: STICK * youngs_modulus, end_weight: 1.0 }
    }

    /// For central differences: the work of a step is that of the mean of the stresses at its ends.
    pub fn explicit(self) -> Self {
        Self { end_weight: 0.5, ..self }
    }

    /// An element of rest length (m) and cross-section (m2).
    pub fn element(&self, length: f64, area: f64) -> HystereticLine {
        HystereticLine { length, area, slider: None }
    }

    /// Stress (Pa) of a slider at the strain `e`, and its derivative.
    #[inline(always)]
    fn slide(&self, from: Option<Slider>, e: f64) -> (f64, f64) {
        let (elastic, modulus) = self.law.stress(e);
        let Some(from) = from else { return (self.friction * elastic, self.stiffness) };
        let limit = self.friction * elastic.abs();
        let stuck = from.stress + self.stiffness * (e - from.strain);
        if stuck.abs() <= limit {
            (stuck, self.stiffness)
        } else {
            (limit.copysign(stuck), self.friction * modulus * elastic.signum() * stuck.signum())
        }
    }

    /// Strain with the vector `d` between the ends (m), and the slider's stress and its derivative there.
    #[inline(always)]
    fn state(&self, e: &HystereticLine, d: Vec3) -> (f64, f64, f64) {
        let strain = strain(d, e.length) + self.offset;
        let (s, y) = self.slide(e.slider, strain);
        (strain, s, y)
    }

    /// Energy of a slider of stress `s` (Pa) in an element, J.
    fn stored(&self, e: &HystereticLine, s: f64) -> f64 {
        0.5 * s * s / self.stiffness * e.area * e.length
    }
}

impl<L: CableLaw> Kernel<2> for Hysteresis<L> {
    type Element = HystereticLine;
    const HISTORY: bool = true;

    #[inline(always)]
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &HystereticLine,
        step: &Step<2>,
        _load: &Load,
    ) -> [Vec3; 2] {
        let (_, s, _) = self.state(e, step.end[1] - step.end[0]);
        let f = force(s, step.at[1] - step.at[0], e.length, e.area);
        [-f, f]
    }

    #[inline(always)]
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &HystereticLine,
        step: &Step<2>,
        _load: &Load,
        factor: f64,
    ) -> ([Vec3; 2], [[Mat3; 2]; 2]) {
        let (d, end) = (step.at[1] - step.at[0], step.end[1] - step.end[0]);
        let (_, s, y) = self.state(e, end);
        let f = force(s, d, e.length, e.area);
        let k = stiffness(s, y / step.weight, d, end, e.length, e.area);
        let [plus, minus] = [factor, -factor].map(|by| k.map(|row| row * by));
        ([-f, f], [[plus, minus], [minus, plus]])
    }

    fn energy(&self, e: &HystereticLine, x: &[Vec3; 2]) -> f64 {
        self.stored(e, self.state(e, x[1] - x[0]).1)
    }

    fn tension(&self, e: &HystereticLine, x: &[Vec3; 2]) -> Option<f64> {
        let d = x[1] - x[0];
        Some(force(self.state(e, d).1, d, e.length, e.area).dot(&d) / d.norm())
    }

    fn advance_history(&self, e: &mut HystereticLine, x: &[Vec3; 2]) -> f64 {
        let (strain, s, _) = self.state(e, x[1] - x[0]);
        let taken = e.slider.map_or(0.0, |from| {
            let mean = self.end_weight * s + (1.0 - self.end_weight) * from.stress;
            let work = mean * (strain - from.strain) * e.area * e.length;
            work - (self.stored(e, s) - self.stored(e, from.stress))
        });
        e.slider = Some(Slider { strain, stress: s });
        taken
    }

    fn history(&self, e: &HystereticLine) -> [f64; 2] {
        e.slider.map_or([NEVER, 0.0], |s| [s.strain, s.stress])
    }

    fn set_history(&self, e: &mut HystereticLine, [strain, stress]: [f64; 2]) {
        e.slider = (strain != NEVER).then_some(Slider { strain, stress });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::cable::TensionOnly;

    const Y: f64 = 5.0;
    const LENGTH: f64 = 1.1;
    const AREA: f64 = 0.3;

    fn kernel(loss: f64) -> Hysteresis<TensionOnly> {
        let mu = friction(loss);
        let youngs_modulus = Y / (1.0 + mu);
        Hysteresis::new(TensionOnly { youngs_modulus }, youngs_modulus, 0.0, mu)
    }

    /// Ends of a line with the Green strain `e` along a slanted direction.
    fn at(e: f64) -> [Vec3; 2] {
        let l = LENGTH * (1.0 + 2.0 * e).sqrt();
        [Vec3::new(0.1, 0.2, -0.3), Vec3::new(0.1 + 0.6 * l, 0.2, -0.3 + 0.8 * l)]
    }

    /// Stress and energy taken on a way through `strains`, each in `steps` steps.
    fn along(k: &Hysteresis<TensionOnly>, strains: &[f64], steps: usize) -> (f64, f64, f64) {
        let mut e = k.element(LENGTH, AREA);
        k.advance_history(&mut e, &at(0.0));
        let (mut from, mut work, mut taken) = (0.0, 0.0, 0.0);
        for &to in strains {
            for i in 1..=steps {
                let strain = from + (to - from) * i as f64 / steps as f64;
                let before = k.history(&e);
                let some = k.advance_history(&mut e, &at(strain));
                assert!(some >= -1e-16, "{strain}: {some}");
                taken += some;
                let total = |[strain, s]: [f64; 2]| s + k.law.stress(strain).0;
                work += 0.5 * (total(before) + total(k.history(&e))) * (strain - before[0]);
            }
            from = to;
        }
        (k.history(&e)[1], work * AREA * LENGTH, taken)
    }

    /// The share of the work of loading that a cycle takes is the one asked for, at any amplitude; the modulus of the first loading is that of the line.
    #[test]
    fn a_cycle_takes_its_share() {
        for loss in [0.05, 0.2, 0.35, case::MOST_HYSTERESIS] {
            let k = kernel(loss);
            for most in [1e-3, 0.1, 0.3] {
                let loading = 0.5 * Y * most * most * AREA * LENGTH;
                let (s, work, taken) = along(&k, &[most], 1000);
                assert!((s + k.law.stress(most).0 - Y * most).abs() < 1e-12 * Y * most);
                assert!((work / loading - 1.0).abs() < 1e-10, "{loss} {most}: {work} {loading}");
                let (end, work, cycle) = along(&k, &[most, 0.0], 4000);
                assert!(end.abs() < 1e-12 && taken < cycle);
                for share in [work / loading, cycle / loading] {
                    assert!((share / loss - 1.0).abs() < 2e-3, "{loss} {most}: {share}");
                }
                // The second cycle takes what the first took.
                let (_, _, two) = along(&k, &[most, 0.0, most, 0.0], 4000);
                assert!((two / cycle - 2.0).abs() < 1e-3, "{two} {cycle}");
            }
        }
    }

    /// Errors of the largest step are of first order, and none of them creates energy.
    #[test]
    fn any_step_takes_energy() {
        let k = kernel(0.3);
        for strains in [[0.2, 0.1, 0.15], [0.3, -0.1, 0.2], [-0.2, 0.1, 0.02], [0.1, 0.099, 0.3]] {
            let (_, _, taken) = along(&k, &strains, 1);
            assert!(taken > 0.0, "{strains:?}: {taken}");
        }
        // Slack throughout: nothing.
        assert_eq!(along(&k, &[-0.1, -0.2], 5), (0.0, 0.0, 0.0));
    }

    #[test]
    fn without_loss_there_is_no_friction() {
        assert_eq!(friction(0.0), 0.0);
        assert!((friction(case::MOST_HYSTERESIS) - 0.5).abs() < 1e-14);
    }

    /// Tangent against central differences: sticking, slipping both ways, slack; in steps of any weight.
    #[test]
    fn tangents_are_derivatives() {
        let k = kernel(0.3);
        for (start, end) in [(0.1, 0.2), (0.2, 0.195), (0.2, 0.05), (0.1, -0.1), (-0.1, 0.1)] {
            let mut e = k.element(LENGTH, AREA);
            for strain in [0.0, start] {
                k.advance_history(&mut e, &at(strain));
            }
            let (x0, x) = (at(start), at(end));
            for weight in [0.5, 1.0] {
                let step = |end: &[Vec3; 2]| {
                    let at = std::array::from_fn(|n| x0[n] * (1.0 - weight) + end[n] * weight);
                    Step { at, end: *end, weight }
                };
                let (_, blocks) = k.tangent::<false, true>(&e, &step(&x), &Load::ZERO, weight);
                for c in 0..3 {
                    let h = 1e-6;
                    let f = |by: f64| {
                        let mut x = x;
                        x[1][c] += by;
                        k.force::<false, true>(&e, &step(&x), &Load::ZERO)
                    };
                    let slope = (f(h)[1] - f(-h)[1]) / (2.0 * h);
                    let column = blocks[1][1].column(c).into_owned();
                    assert!((slope - column).norm() < 1e-8, "{start} {end} {weight}: {slope} {column}");
                }
            }
        }
    }
}
