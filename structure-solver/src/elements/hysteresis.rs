//! Lines that return less work than it took to stretch them: the slider of [`crate::materials::slider`] next to each cable element, by its
//! Green strain.

use super::cable::{CableLaw, force, stiffness, strain};
use super::{Kernel, Load, Step};
use crate::materials::slider::{self, Friction, Slider};
use mesh::geometry::{Mat3, Vec3};

/// Sliders of lines.
pub struct Hysteresis<L> {
    /// Elastic law of the lines.
    law: L,
    /// Green strain at rest length that makes the pre-stress.
    offset: f64,
    friction: Friction,
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
    /// Of lines with the elastic `law` and the strain `offset` at rest length.
    pub fn new(law: L, offset: f64, friction: Friction) -> Self {
        Self { law, offset, friction }
    }

    /// An element of rest length (m) and cross-section (m2).
    pub fn element(&self, length: f64, area: f64) -> HystereticLine {
        HystereticLine { length, area, slider: None }
    }

    /// Strain with the vector `d` between the ends (m), and the slider's stress (Pa) and its derivative there.
    #[inline(always)]
    fn state(&self, e: &HystereticLine, d: Vec3) -> (f64, f64, f64) {
        let strain = strain(d, e.length) + self.offset;
        let (s, y) = self.friction.slide(e.slider, strain, self.law.stress(strain));
        (strain, s, y)
    }
}

impl<L: CableLaw> Kernel<2> for Hysteresis<L> {
    type Element = HystereticLine;
    type Batch = ();
    const VARIABLES: usize = 2;

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
        self.friction.stored(self.state(e, x[1] - x[0]).1) * e.area * e.length
    }

    fn tension(&self, e: &HystereticLine, x: &[Vec3; 2]) -> Option<f64> {
        let d = x[1] - x[0];
        Some(force(self.state(e, d).1, d, e.length, e.area).dot(&d) / d.norm())
    }

    fn advance_history(&self, e: &mut HystereticLine, x: &[Vec3; 2]) -> f64 {
        let (strain, stress, _) = self.state(e, x[1] - x[0]);
        let to = Slider { strain, stress };
        let from = e.slider.replace(to);
        self.friction.taken(from, to) * e.area * e.length
    }

    fn history(&self, e: &HystereticLine, variables: &mut [f64]) {
        variables.copy_from_slice(&slider::variables(e.slider));
    }

    fn set_history(&self, e: &mut HystereticLine, variables: &[f64]) {
        e.slider = slider::of_variables([variables[0], variables[1]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::cable::TensionOnly;
    use crate::materials::slider::friction;

    const Y: f64 = 5.0;
    const LENGTH: f64 = 1.1;
    const AREA: f64 = 0.3;

    fn kernel(loss: f64) -> Hysteresis<TensionOnly> {
        let mu = friction(loss);
        let youngs_modulus = Y / (1.0 + mu);
        Hysteresis::new(TensionOnly { youngs_modulus }, 0.0, Friction::new(mu, youngs_modulus))
    }

    /// Strain and stress of a slider.
    fn history(k: &Hysteresis<TensionOnly>, e: &HystereticLine) -> [f64; 2] {
        let mut variables = [0.0; 2];
        k.history(e, &mut variables);
        variables
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
                let before = history(k, &e);
                let some = k.advance_history(&mut e, &at(strain));
                assert!(some >= -1e-16, "{strain}: {some}");
                taken += some;
                let total = |[strain, s]: [f64; 2]| s + k.law.stress(strain).0;
                work += 0.5 * (total(before) + total(history(k, &e))) * (strain - before[0]);
            }
            from = to;
        }
        (history(k, &e)[1], work * AREA * LENGTH, taken)
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
