//! Stiffness-proportional damping: stresses proportional to the rate of the elastic
//! ones.
//!
//! Over a step from strain $`E_0`$ to $`E_1`$ the stress is
//! $`S_v = \frac{\beta}{\Delta t}(S(E_1)-S(E_0))`$. For small motions about a taut state
//! that is Rayleigh's $`\beta K v`$; being made of strains it sees no rigid motion. The
//! work over the step, $`S_v:(E_1-E_0)`$, is never negative, because each law is the
//! gradient of a convex energy. The rate is that of the middle of the step: second
//! order with the midpoint family, first order in $`\beta\Delta t`$ with Newmark.

use super::step::{Elastic, StepLaw, StepStart};
use super::{Material, Moduli, Strain, Stress};
use crate::elements::Sheet;

/// The damping alone: elements in addition to the elastic ones.
pub struct Viscous<M> {
    material: M,
    /// Damping time, s.
    time: f64,
    /// Time over the step, 1.
    rate: f64,
}

impl<M: Material> Viscous<M> {
    /// Damping time in s.
    pub fn new(material: M, time: f64) -> Self {
        Self { material, time, rate: 0.0 }
    }

    #[inline(always)]
    fn over(&self, start: &Stress, end: Stress) -> Stress {
        std::array::from_fn(|i| self.rate * (end[i] - start[i]))
    }
}

impl<M: Material> StepLaw for Viscous<M> {
    /// Elastic stress.
    type Start = Stress;
    const RATE: bool = true;
    const ADDS: bool = true;

    fn start(&self, e: Strain) -> Stress {
        self.material.stress(e)
    }

    #[inline(always)]
    fn stress<const BLEND: bool>(&self, start: &Stress, end: Strain, _w: f64) -> Stress {
        self.over(start, self.material.stress(end))
    }

    #[inline(always)]
    fn tangent<const BLEND: bool>(&self, start: &Stress, end: Strain, w: f64) -> (Stress, Moduli) {
        let by = self.rate / w;
        let (s, c) = self.material.tangent(end);
        (self.over(start, s), c.map(|row| row.map(|c| by * c)))
    }

    fn dissipation(&self, start: &Stress, from: Strain, to: Strain, volume: f64) -> f64 {
        let s = self.over(start, self.material.stress(to));
        volume * (0..3).map(|i| s[i] * (to[i] - from[i])).sum::<f64>()
    }

    fn set_step(&mut self, dt: f64) {
        self.rate = self.time / dt;
    }

    fn retardation_time(&self) -> f64 {
        self.time
    }
}

/// The material and its damping in one element.
pub struct KelvinVoigt<M> {
    elastic: Elastic<M>,
    viscous: Viscous<M>,
}

impl<M: Material + Copy> KelvinVoigt<M> {
    /// Damping time in s.
    pub fn new(material: M, time: f64) -> Self {
        Self { elastic: Elastic(material), viscous: Viscous::new(material, time) }
    }
}

impl<M: Material> StepLaw for KelvinVoigt<M> {
    type Start = (StepStart, Stress);
    const RATE: bool = true;

    fn start(&self, e: Strain) -> Self::Start {
        (self.elastic.start(e), self.viscous.start(e))
    }

    #[inline(always)]
    fn stress<const BLEND: bool>(&self, start: &Self::Start, end: Strain, w: f64) -> Stress {
        let s = self.elastic.stress::<BLEND>(&start.0, end, w);
        let v = self.viscous.stress::<BLEND>(&start.1, end, w);
        std::array::from_fn(|i| s[i] + v[i])
    }

    #[inline(always)]
    fn tangent<const BLEND: bool>(&self, start: &Self::Start, end: Strain, w: f64) -> (Stress, Moduli) {
        let (s, c) = self.elastic.tangent::<BLEND>(&start.0, end, w);
        let (v, k) = self.viscous.tangent::<BLEND>(&start.1, end, w);
        let sum = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + b[i]);
        (sum(s, v), std::array::from_fn(|i| sum(c[i], k[i])))
    }

    fn energy(&self, start: &Self::Start, e: Strain) -> f64 {
        self.elastic.energy(&start.0, e)
    }

    fn sheet(&self, start: &Self::Start, e: Strain) -> Option<Sheet> {
        self.elastic.sheet(&start.0, e)
    }

    fn dissipation(&self, start: &Self::Start, from: Strain, to: Strain, volume: f64) -> f64 {
        let (s, t) = (start.1, self.viscous.material.stress(to));
        let work: f64 = (0..3).map(|i| (t[i] - s[i]) * (to[i] - from[i])).sum();
        self.viscous.rate * volume * work
    }

    fn set_step(&mut self, dt: f64) {
        self.viscous.set_step(dt);
    }

    fn retardation_time(&self) -> f64 {
        self.viscous.time
    }
}
