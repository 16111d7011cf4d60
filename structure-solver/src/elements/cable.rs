//! The 2-node cable (paper, equation 4).
//!
//! The Green strain is measured against the rest length $`L`$, which need not be
//! the initial distance: $`E = (l^2 - L^2) / (2 L^2)`$. The axial force is
//! $`N = A S l / L`$ with $`S = Y E`$.

use super::{Kernel, Load, Step};
use mesh::geometry::{Mat3, Vec3};

/// Stiffness of a cable element under axial strain.
pub trait CableLaw: Copy + 'static {
    /// Second Piola-Kirchhoff stress (Pa) and its derivative for Green strain `e`.
    fn stress(&self, e: f64) -> (f64, f64);
}

/// Pulls and pushes: a bar.
#[derive(Clone, Copy, Debug)]
pub struct TwoWay {
    /// Young's modulus, Pa.
    pub youngs_modulus: f64,
}

impl CableLaw for TwoWay {
    #[inline(always)]
    fn stress(&self, e: f64) -> (f64, f64) {
        (self.youngs_modulus * e, self.youngs_modulus)
    }
}

/// Pulls only: a line shorter than its rest length carries nothing.
#[derive(Clone, Copy, Debug)]
pub struct TensionOnly {
    /// Young's modulus, Pa.
    pub youngs_modulus: f64,
}

impl CableLaw for TensionOnly {
    #[inline(always)]
    fn stress(&self, e: f64) -> (f64, f64) {
        let y = if e > 0.0 { self.youngs_modulus } else { 0.0 };
        (y * e, y)
    }
}

/// Green strain against the rest length for the vector `d` between the ends (m).
#[inline(always)]
pub fn strain(d: Vec3, rest_length: f64) -> f64 {
    0.5 * (d.dot(&d) / (rest_length * rest_length) - 1.0)
}

/// Stress of a step from Green strain `start` to `end`, and its derivative by `end`
/// divided by `w`: see [`crate::materials::step`]. With `w = 1` the law itself.
#[inline(always)]
pub fn step(law: &impl CableLaw, start: f64, end: f64, w: f64) -> (f64, f64) {
    let (s, y) = law.stress(w * end + (1.0 - w) * start);
    if w == 1.0 {
        return (s, y);
    }
    let (s1, s0) = (law.stress(end).0, law.stress(start).0);
    let (stored, work) = (0.5 * (s1 * end - s0 * start), s * (end - start));
    if stored - work > 1e-13 * (s1 * end + s0 * start) {
        let mean = stored / (end - start);
        (mean, (s1 - mean) / ((end - start) * w))
    } else {
        (s, y)
    }
}

/// Force on the second end (N) for the stress `s` (Pa), `d` the vector between the
/// ends: the internal force vector is `[-f, f]`.
#[inline(always)]
pub fn force(s: f64, d: Vec3, rest_length: f64, area: f64) -> Vec3 {
    d * (area * s / rest_length)
}

/// The block $`k`$ of the tangent $`[[k,-k],[-k,k]]`$ of [`force`] (N/m), `y` the
/// derivative of the stress. The strain grows along `by` (m): `d` itself, or the
/// vector between the ends in another configuration that makes the stress.
#[inline(always)]
pub fn stiffness(s: f64, y: f64, d: Vec3, by: Vec3, rest_length: f64, area: f64) -> Mat3 {
    let (geometric, material) = (area * s / rest_length, area * y / rest_length.powi(3));
    let mut k = d * material * by.transpose();
    (0..3).for_each(|i| k[(i, i)] += geometric);
    k
}

/// Axial force (N), positive in tension. `offset`: strain at rest length that makes
/// the pre-stress.
pub fn tension(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, offset: f64, area: f64) -> f64 {
    let d = x[1] - x[0];
    area * law.stress(strain(d, rest_length) + offset).0 * d.dot(&d).sqrt() / rest_length
}

/// Strain energy (J), that of the pre-stress included.
pub fn energy(law: &impl CableLaw, x: &[Vec3; 2], rest_length: f64, offset: f64, area: f64) -> f64 {
    let e = strain(x[1] - x[0], rest_length) + offset;
    0.5 * law.stress(e).0 * e * area * rest_length
}

/// Axial stress of two-node elements over a step.
pub trait AxialStress: 'static {
    /// State at the start of the step.
    type Start: Copy;
    /// See [`Kernel::RATE`].
    const RATE: bool = false;
    /// See [`Kernel::TIMED`].
    const TIMED: bool = false;
    /// Whether it adds to the stress of other elements, which have the mass.
    const ADDS: bool = false;

    /// Rest length (m) now of an element made with `length`.
    #[inline(always)]
    fn rest_length(&self, length: f64) -> f64 {
        length
    }
    /// State with the vector `d` between the ends (m).
    fn start(&self, d: Vec3, rest_length: f64) -> Self::Start;
    /// Stress (Pa) of a step to the vector `end` (m), and its derivative by the strain there divided by the weight `w`.
    fn stress(&self, start: &Self::Start, end: Vec3, rest_length: f64, w: f64) -> (f64, f64);
    /// Strain energy, J.
    fn energy(&self, _x: &[Vec3; 2], _rest_length: f64, _area: f64) -> f64 {
        0.0
    }
    /// Tension, N, where it is reported.
    fn tension(&self, _x: &[Vec3; 2], _rest_length: f64, _area: f64) -> Option<f64> {
        None
    }
    /// See [`Kernel::dissipation`]; `by`: vectors between the ends before and after.
    fn dissipation(&self, _start: &Self::Start, _by: [Vec3; 2], _rest_length: f64, _area: f64) -> f64 {
        0.0
    }
    /// See [`Kernel::set_step`].
    fn set_step(&mut self, _dt: f64) {}
    /// See [`Kernel::retardation_time`].
    fn retardation_time(&self) -> f64 {
        0.0
    }
    /// See [`Kernel::set_time`].
    fn set_time(&mut self, _t: f64) {}
}

/// Stress of a law about a pre-stress.
pub struct Elastic<L> {
    /// The law.
    pub law: L,
    /// Green strain at rest length: the pre-stress over the modulus. It adds to the strain, so
    /// that energies and steps know of it too.
    pub offset: f64,
}

impl<L: CableLaw> AxialStress for Elastic<L> {
    /// Strain.
    type Start = f64;

    fn start(&self, d: Vec3, rest_length: f64) -> f64 {
        strain(d, rest_length) + self.offset
    }

    #[inline(always)]
    fn stress(&self, start: &f64, end: Vec3, rest_length: f64, w: f64) -> (f64, f64) {
        step(&self.law, *start, strain(end, rest_length) + self.offset, w)
    }

    fn energy(&self, x: &[Vec3; 2], rest_length: f64, area: f64) -> f64 {
        energy(&self.law, x, rest_length, self.offset, area)
    }

    fn tension(&self, x: &[Vec3; 2], rest_length: f64, area: f64) -> Option<f64> {
        Some(tension(&self.law, x, rest_length, self.offset, area))
    }
}

/// Stiffness-proportional damping of [`Elastic`]: see [`crate::materials::Viscous`].
pub struct Viscous<L> {
    elastic: Elastic<L>,
    /// Damping time, s.
    time: f64,
    /// Time over the step, 1.
    rate: f64,
}

impl<L: CableLaw> Viscous<L> {
    /// With the damping time in s.
    pub fn new(elastic: Elastic<L>, time: f64) -> Self {
        Self { elastic, time, rate: 0.0 }
    }

    /// Elastic stress and its derivative.
    #[inline(always)]
    fn law(&self, d: Vec3, rest_length: f64) -> (f64, f64) {
        self.elastic.law.stress(strain(d, rest_length) + self.elastic.offset)
    }
}

impl<L: CableLaw> AxialStress for Viscous<L> {
    /// Elastic stress.
    type Start = f64;
    const RATE: bool = true;
    const ADDS: bool = true;

    fn start(&self, d: Vec3, rest_length: f64) -> f64 {
        self.law(d, rest_length).0
    }

    #[inline(always)]
    fn stress(&self, start: &f64, end: Vec3, rest_length: f64, w: f64) -> (f64, f64) {
        let (s, y) = self.law(end, rest_length);
        (self.rate * (s - start), self.rate / w * y)
    }

    fn dissipation(&self, start: &f64, by: [Vec3; 2], rest_length: f64, area: f64) -> f64 {
        let [from, to] = by.map(|d| strain(d, rest_length));
        let s = self.rate * (self.law(by[1], rest_length).0 - start);
        area * rest_length * s * (to - from)
    }

    fn set_step(&mut self, dt: f64) {
        self.rate = self.time / dt;
    }

    fn retardation_time(&self) -> f64 {
        self.time
    }
}

/// Two-node elements of one axial stress.
pub struct Cable<S> {
    /// Its stress.
    pub stress: S,
    /// Density, kg/m3.
    pub density: f64,
}

/// A two-node element.
pub struct Line<T> {
    /// Rest length (m), or what [`AxialStress::rest_length`] makes it of.
    length: f64,
    /// Cross-section, m2.
    area: f64,
    start: T,
}

impl<S: AxialStress> Cable<S> {
    /// An element of cross-section `area` (m2) made with `length`; a step starts with the vector `d` between its ends (m).
    pub fn element(&self, length: f64, area: f64, d: Vec3) -> Line<S::Start> {
        Line { length, area, start: self.stress.start(d, self.stress.rest_length(length)) }
    }

    /// Vectors between the ends in a step, rest length, stress and its derivative.
    #[inline(always)]
    fn state(&self, e: &Line<S::Start>, step: &Step<2>) -> ([Vec3; 2], f64, (f64, f64)) {
        let (d, end) = (between(&step.at), between(&step.end));
        let rest_length = self.stress.rest_length(e.length);
        ([d, end], rest_length, self.stress.stress(&e.start, end, rest_length, step.weight))
    }
}

/// Vector from the first to the second end.
#[inline(always)]
fn between(x: &[Vec3; 2]) -> Vec3 {
    x[1] - x[0]
}

impl<S: AxialStress> Kernel<2> for Cable<S> {
    type Element = Line<S::Start>;
    type Batch = ();
    const RATE: bool = S::RATE;
    const TIMED: bool = S::TIMED;

    fn anchor(&self, e: &mut Self::Element, x: &[Vec3; 2]) {
        e.start = self.stress.start(between(x), self.stress.rest_length(e.length));
    }

    #[inline(always)]
    fn force<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<2>,
        _load: &Load,
    ) -> [Vec3; 2] {
        let ([d, _], rest_length, (s, _)) = self.state(e, step);
        let f = force(s, d, rest_length, e.area);
        [-f, f]
    }

    #[inline(always)]
    fn tangent<const TRACTION: bool, const BLEND: bool>(
        &self,
        e: &Self::Element,
        step: &Step<2>,
        _load: &Load,
        factor: f64,
    ) -> ([Vec3; 2], [[Mat3; 2]; 2]) {
        let ([d, end], rest_length, (s, y)) = self.state(e, step);
        let f = force(s, d, rest_length, e.area);
        let k = stiffness(s, y, d, end, rest_length, e.area);
        let [plus, minus] = [factor, -factor].map(|s| k.map(|row| row * s));
        ([-f, f], [[plus, minus], [minus, plus]])
    }

    fn energy(&self, e: &Self::Element, x: &[Vec3; 2]) -> f64 {
        self.stress.energy(x, self.stress.rest_length(e.length), e.area)
    }

    fn dissipation(&self, e: &Self::Element, before: &[Vec3; 2], after: &[Vec3; 2]) -> f64 {
        let by = [between(before), between(after)];
        self.stress.dissipation(&e.start, by, self.stress.rest_length(e.length), e.area)
    }

    fn mass(&self, e: &Self::Element) -> Option<f64> {
        (!S::ADDS).then(|| self.density * e.area * self.stress.rest_length(e.length))
    }

    fn tension(&self, e: &Self::Element, x: &[Vec3; 2]) -> Option<f64> {
        self.stress.tension(x, self.stress.rest_length(e.length), e.area)
    }

    fn set_step(&mut self, dt: f64) {
        self.stress.set_step(dt);
    }

    fn retardation_time(&self) -> f64 {
        self.stress.retardation_time()
    }

    fn set_time(&mut self, t: f64) {
        self.stress.set_time(t);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::{conforms, conforms_in_a_step};

    const X: [Vec3; 2] = [Vec3::new(0.1, 0.2, -0.3), Vec3::new(1.0, 0.7, 0.4)];

    #[test]
    fn lines_conform() {
        fn check(law: impl CableLaw, length: f64) {
            let kernel = Cable { stress: Elastic { law, offset: 0.0 }, density: 2.0 };
            let rest = [Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.1 + length, 0.2, 0.3)];
            conforms(&kernel, || kernel.element(length, 0.3, between(&rest)), rest, X);
            let mut damping = Cable { stress: Viscous::new(kernel.stress, 0.4), density: 2.0 };
            damping.set_step(0.2);
            conforms_in_a_step(&damping, || damping.element(length, 0.3, between(&rest)), rest, X);
        }
        check(TensionOnly { youngs_modulus: 5.0 }, 1.1);
        check(TwoWay { youngs_modulus: 5.0 }, 1.1);
        // Compressed.
        check(TwoWay { youngs_modulus: 5.0 }, 1.4);
    }

    #[test]
    fn a_slack_line_carries_nothing() {
        let law = TensionOnly { youngs_modulus: 5.0 };
        let d = X[1] - X[0];
        assert_eq!(law.stress(strain(d, 1.4)), (0.0, 0.0));
        assert_eq!(stiffness(0.0, 0.0, d, d, 1.4, 0.3), Mat3::zeros());
        assert_eq!(energy(&law, &X, 1.4, 0.0, 0.3), 0.0);
    }

    #[test]
    fn a_step_creates_no_energy_and_knows_its_derivative() {
        let law = TensionOnly { youngs_modulus: 5.0 };
        let stored = |e: f64| 0.5 * law.stress(e).0 * e;
        for w in [0.5, 0.6, 1.0] {
            for (a, b) in [(0.1, 0.3), (-0.2, 0.3), (0.3, -0.25), (-0.3, -0.1), (-0.1, 0.05), (0.2, 0.2)] {
                let (s, y) = step(&law, a, b, w);
                assert!(s * (b - a) >= stored(b) - stored(a) - 1e-15, "{w} {a} {b}");
                let h = 1e-6;
                let slope = (step(&law, a, b + h, w).0 - step(&law, a, b - h, w).0) / (2.0 * h);
                assert!((slope - w * y).abs() < 1e-6, "{w} {a} {b}: {slope} {}", w * y);
            }
        }
    }

    /// The stress of the averaged strain where its work covers the energy, also from slack to taut; the least that does
    /// elsewhere.
    #[test]
    fn a_step_is_corrected_where_it_must_be() {
        let law = TensionOnly { youngs_modulus: 5.0 };
        let stored = |e: f64| 0.5 * law.stress(e).0 * e;
        for (a, b, w, corrected) in [
            (-0.05, 0.3, 0.6, false),
            (-0.3, 0.3, 0.6, true),
            (-0.05, 0.3, 0.5, true),
            (0.1, 0.3, 0.5, false),
            (0.3, -0.25, 0.6, false),
        ] {
            let plain = law.stress(w * b + (1.0 - w) * a).0;
            let exact = if corrected { (stored(b) - stored(a)) / (b - a) } else { plain };
            assert!((step(&law, a, b, w).0 - exact).abs() < 1e-14, "{w} {a} {b}");
            assert_eq!(stored(b) - stored(a) > plain * (b - a) + 1e-12, corrected, "{w} {a} {b}");
        }
    }

    /// Pre-stress S0 at rest length; released at the length where Y E = -S0.
    #[test]
    fn a_prestressed_line_pulls_at_its_rest_length() {
        let (y, s0) = (7.0, 0.7);
        let law = TensionOnly { youngs_modulus: y };
        let at = |l: f64| tension(&law, &[Vec3::zeros(), Vec3::new(l, 0.0, 0.0)], 2.0, s0 / y, 0.5);
        assert!((at(2.0) - 0.5 * s0).abs() < 1e-15);
        let free = 2.0 * (1.0f64 - 2.0 * s0 / y).sqrt();
        assert_eq!(at(free - 1e-6), 0.0);
        assert!(at(free + 1e-6) > 0.0);
        // The energy is the work of pulling from there: Simpson's rule, exact for the
        // cubic tension.
        let work = (2.0 - free) / 6.0 * (at(free) + 4.0 * at(0.5 * (2.0 + free)) + at(2.0));
        let stored = energy(&law, &[Vec3::zeros(), Vec3::new(2.0, 0.0, 0.0)], 2.0, s0 / y, 0.5);
        assert!((work - stored).abs() < 1e-15, "{work} {stored}");
    }

    #[test]
    fn tension_is_measured_against_the_rest_length() {
        // Stretch 1.1: E = 0.105, N = A Y E l/L.
        let x = [Vec3::zeros(), Vec3::new(2.2, 0.0, 0.0)];
        let law = TensionOnly { youngs_modulus: 7.0 };
        assert!((tension(&law, &x, 2.0, 0.0, 0.5) - 0.5 * 7.0 * 0.105 * 1.1).abs() < 1e-14);
        assert!((energy(&law, &x, 2.0, 0.0, 0.5) - 0.5 * 7.0 * 0.105f64.powi(2)).abs() < 1e-14);
    }
}
