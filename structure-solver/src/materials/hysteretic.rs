//! Cloth that returns less work than it took to stretch it.
//!
//! Yarns rub on each other where they cross. The cloth is an elastic law and a slider ([`super::slider`]) that follows one number, the stretch in the
//! measure of the elastic energy $`W`$ for each volume,
//! ```math
//! q = \sqrt{2 W(E)},\quad S = S_e + s\,\frac{\partial q}{\partial E} = \Bigl(1 + \frac sq\Bigr) S_e,
//! ```
//! so that elastic law and slider have the work $`\mathrm d W = q\,\mathrm d q`$ and $`s\,\mathrm d q`$: a line with the modulus 1 (pseudo-elasticity after Ogden and Roxburgh,
//! Proc. R. Soc. Lond. A 455, 1999, 2861-2877, whose factor on the stress is here that of dry friction). The stress keeps the directions of the elastic one: cloth in
//! wrinkles stays in wrinkles, slack cloth is slack, and any law will do. A cycle from zero along any one strain takes the share that a line takes. What
//! turns the strain and leaves $`W`$ as it is takes nothing.
//!
//! Over a step the elastic stress $`S^*`$ of [`super::step`] has $`S^* : \Delta E \ge \Delta W`$, and the slider's is $`\rho S^*`$ with $`\rho = 2 s_1 / (q_0 + q_1)`$:
//! its work is $`s_1 \Delta q`$ where that of the elastic stress is $`\Delta W`$, which the slider stores or takes, never less than nothing.

use super::slider::{self, Friction, Slider};
use super::step::{self, StepLaw, StepStart};
use super::{Material, Moduli, Regime, Strain, Stress};
use crate::elements::Sheet;

/// An elastic law with a slider.
pub struct Hysteretic {
    law: Box<dyn Material>,
    friction: Friction,
}

/// State at the start of a step.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    elastic: StepStart,
    /// By `q`, in the root of Pa; `None` before the first step: as after the first loading.
    slider: Option<Slider>,
}

/// Elastic stretch `q`, and the slider there.
struct State {
    q: f64,
    /// Stress of the slider and its derivative by `q`.
    s: f64,
    slope: f64,
    /// Elastic stress, Pa.
    stress: Stress,
}

impl Material for Box<dyn Material> {
    fn stress(&self, e: Strain) -> Stress {
        (**self).stress(e)
    }

    fn tangent(&self, e: Strain) -> (Stress, Moduli) {
        (**self).tangent(e)
    }

    fn energy(&self, s: &Stress, e: &Strain) -> f64 {
        (**self).energy(s, e)
    }

    fn regime(&self, e: Strain) -> Regime {
        (**self).regime(e)
    }
}

/// Stretch that stores `energy` (J/m3), in the root of Pa.
fn stretch(energy: f64) -> f64 {
    (2.0 * energy.max(0.0)).sqrt()
}

impl Hysteretic {
    /// Of the elastic `law`, with a limit of `limit` times its stress.
    pub fn new(law: impl Material, limit: f64) -> Self {
        Self { law: Box::new(law), friction: Friction::new(limit, 1.0) }
    }

    /// For central differences.
    pub fn explicit(self) -> Self {
        Self { friction: self.friction.explicit(), ..self }
    }

    fn state(&self, from: Option<Slider>, e: Strain) -> State {
        let stress = self.law.stress(e);
        let q = stretch(self.law.energy(&stress, &e));
        let (s, slope) = self.friction.slide(from, q, (q, 1.0));
        State { q, s, slope, stress }
    }
}

impl State {
    /// Stress of the cloth over the elastic one and its derivative by `q`, in a step from the stretch `q0`, or at this state alone.
    fn factor(&self, q0: Option<f64>) -> (f64, f64) {
        let Self { q, s, slope, .. } = *self;
        match q0 {
            _ if q == 0.0 => (1.0, 0.0),
            Some(q0) => (1.0 + 2.0 * s / (q0 + q), 2.0 * (slope - s / (q0 + q)) / (q0 + q)),
            None => (1.0 + s / q, (slope - s / q) / q),
        }
    }
}

impl StepLaw for Hysteretic {
    type Start = Start;
    const VARIABLES: usize = 2;

    fn start(&self, e: Strain) -> Start {
        Start { elastic: StepStart::new(&self.law, e), slider: None }
    }

    fn anchor(&self, start: &mut Start, e: Strain) {
        start.elastic = StepStart::new(&self.law, e);
    }

    fn stress<const BLEND: bool>(&self, start: &Start, end: Strain, w: f64) -> Stress {
        let at = self.state(start.slider, end);
        let stress = if BLEND { step::stress(&self.law, &start.elastic, end, w) } else { at.stress };
        let (factor, _) = at.factor(BLEND.then(|| stretch(start.elastic.energy)));
        stress.map(|s| factor * s)
    }

    fn tangent<const BLEND: bool>(&self, start: &Start, end: Strain, w: f64) -> (Stress, Moduli) {
        let at = self.state(start.slider, end);
        let (stress, moduli) =
            if BLEND { step::tangent(&self.law, &start.elastic, end, w) } else { self.law.tangent(end) };
        let (factor, by_q) = at.factor(BLEND.then(|| stretch(start.elastic.energy)));
        if start.slider.is_none() {
            // As stiff as it can be in any direction, for bounds: S S^T / q^2 is at most C.
            let most = 1.0 + self.friction.stiffness();
            return (stress.map(|s| factor * s), moduli.map(|row| row.map(|c| most * c)));
        }
        // The derivative of q is that of the elastic energy, the stress, over q.
        let slope = at.stress.map(|s| by_q * s / (at.q.max(f64::MIN_POSITIVE) * w));
        let moduli =
            std::array::from_fn(|i| std::array::from_fn(|j| factor * moduli[i][j] + stress[i] * slope[j]));
        (stress.map(|s| factor * s), moduli)
    }

    fn energy(&self, start: &Start, e: Strain) -> f64 {
        let at = self.state(start.slider, e);
        0.5 * at.q * at.q + self.friction.stored(at.s)
    }

    /// Where a step has ended.
    fn sheet(&self, start: &Start, e: Strain) -> Option<Sheet> {
        let share = match start.slider {
            Some(slider) if slider.strain > 0.0 => slider.stress / slider.strain,
            Some(_) => 0.0,
            None => self.friction.limit(),
        };
        let stress = self.law.stress(e).map(|s| (1.0 + share) * s);
        Some(Sheet { strain: e, stress, regime: self.law.regime(e) })
    }

    fn mean(&self, points: &[Start; 4]) -> Start {
        let all: [Option<Slider>; 4] = points.map(|p| p.slider);
        let mean = |of: fn(&Slider) -> f64| 0.25 * all.iter().flatten().map(of).sum::<f64>();
        let slider = Slider { strain: mean(|s| s.strain), stress: mean(|s| s.stress) };
        Start { slider: all.iter().all(Option::is_some).then_some(slider), ..points[0] }
    }

    fn advance_history(&self, start: &mut Start, e: Strain) -> f64 {
        let at = self.state(start.slider, e);
        let to = Slider { strain: at.q, stress: at.s };
        let from = start.slider.replace(to);
        self.friction.taken(from, to)
    }

    fn history(&self, start: &Start, variables: &mut [f64]) {
        variables.copy_from_slice(&slider::variables(start.slider));
    }

    fn set_history(&self, start: &mut Start, variables: &[f64]) {
        start.slider = slider::of_variables([variables[0], variables[1]]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::check::conforms_in_a_step;
    use crate::elements::membrane::{Reference, Triangle};
    use crate::elements::{Kernel, Load, Step, quad};
    use crate::materials::{
        NeoHookean, OrthotropicTensionField, Prestressed, StVenantKirchhoff, TensionField, slider,
    };
    use mesh::geometry::Vec3;
    use proptest::prelude::*;

    const Y: f64 = 7.0;
    const LOSS: f64 = 0.3;

    fn hysteretic(loss: f64) -> Hysteretic {
        let limit = slider::friction(loss);
        Hysteretic::new(TensionField::new(Y / (1.0 + limit), 0.3), limit)
    }

    fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    /// Work for each volume of steps of weight `w` along `strains`, each in `steps` of equal length, what they took and the state at the end.
    fn along(law: &Hysteretic, w: f64, strains: &[Strain], steps: usize) -> (f64, f64, Start) {
        let mut start = law.start([0.0; 3]);
        law.advance_history(&mut start, [0.0; 3]);
        let (mut from, mut work, mut taken) = ([0.0; 3], 0.0, 0.0);
        for &to in strains {
            let mut before = from;
            for i in 1..=steps {
                let share = i as f64 / steps as f64;
                let end = std::array::from_fn(|c| from[c] + share * (to[c] - from[c]));
                law.anchor(&mut start, before);
                let stress = law.stress::<true>(&start, end, w);
                work += dot(&stress, &std::array::from_fn(|c| end[c] - before[c]));
                taken += law.advance_history(&mut start, end);
                before = end;
            }
            from = to;
        }
        (work, taken, start)
    }

    /// The first loading has the law of the fabric; a cycle along any one strain takes the share asked for of the work of loading, twice in two cycles, and the rest
    /// returns. In wrinkles the stress stays that of a tension field.
    #[test]
    fn a_cycle_takes_its_share() {
        for loss in [0.05, 0.2, case::MOST_HYSTERESIS] {
            let law = hysteretic(loss);
            let elastic = TensionField::new(Y, 0.3);
            for most in [[0.1, 0.0, 0.0], [0.1, 0.08, 0.03], [0.1, -0.2, 0.0], [0.02, -0.01, 0.2]] {
                let exact = elastic.stress(most);
                let loading = elastic.energy(&exact, &most);
                let (work, _, start) = along(&law, 0.5, &[most], 1000);
                let s = law.sheet(&start, most).expect("a sheet").stress;
                for i in 0..3 {
                    assert!((s[i] - exact[i]).abs() < 1e-12, "{most:?}: {s:?} {exact:?}");
                }
                assert!((work / loading - 1.0).abs() < 2e-3, "{loss} {most:?}: {work} {loading}");
                let zero = [0.0; 3];
                let (work, taken, _) = along(&law, 0.5, &[most, zero], 4000);
                for share in [work / loading, taken / loading] {
                    assert!((share / loss - 1.0).abs() < 3e-3, "{loss} {most:?}: {share}");
                }
                let (_, two, _) = along(&law, 0.5, &[most, zero, most, zero], 4000);
                assert!((two / taken - 2.0).abs() < 1e-3, "{two} {taken}");
            }
        }
    }

    /// Slack fabric has no stress, whatever it was before.
    #[test]
    fn slack_fabric_is_slack() {
        let (_, _, mut start) = along(&hysteretic(LOSS), 0.5, &[[0.1, 0.05, 0.0]], 10);
        let law = hysteretic(LOSS);
        law.anchor(&mut start, [0.1, 0.05, 0.0]);
        let slack = [-0.1, -0.1, 0.0];
        assert_eq!(law.stress::<false>(&start, slack, 1.0), [0.0; 3]);
        law.advance_history(&mut start, slack);
        law.anchor(&mut start, slack);
        assert_eq!(law.stress::<true>(&start, [-0.05, -0.1, 0.0], 0.5), [0.0; 3]);
        assert_eq!(law.energy(&start, slack), 0.0);
    }

    /// The bound on the tangent before the first step holds in all states after it.
    fn bounded(law: &Hysteretic, start: &Start, e: Strain, v: &[f64; 3]) {
        let quadratic = |start: &Start| {
            let (_, c) = law.tangent::<false>(start, e, 1.0);
            (0..3).map(|i| v[i] * dot(&c[i], v)).sum::<f64>()
        };
        let (now, most) = (quadratic(start), quadratic(&law.start(e)));
        assert!(now <= most + 1e-12, "{now} {most}");
    }

    proptest! {
        /// What a step of any length takes is the work that it does not store, never less than nothing, for laws that are quadratic and for others.
        #[test]
        fn a_step_takes_its_work(
            a in prop::array::uniform3(-0.3..0.3f64), b in prop::array::uniform3(-0.3..0.3f64), c in prop::array::uniform3(-0.3..0.3f64),
        ) {
            let limit = slider::friction(LOSS);
            for (law, exact) in [
                (Hysteretic::new(StVenantKirchhoff::isotropic(Y, 0.3), limit), true),
                (Hysteretic::new(TensionField::new(Y, 0.3), limit), false),
                (Hysteretic::new(OrthotropicTensionField::new(Y, 3.0, 0.2, 1.5), limit), false),
            ] {
                let (_, _, mut start) = along(&law, 0.5, &[a], 1);
                for [from, to] in [[a, b], [b, c]] {
                    law.anchor(&mut start, from);
                    let before = law.energy(&start, from);
                    let work = dot(&law.stress::<true>(&start, to, 0.5), &std::array::from_fn(|i| to[i] - from[i]));
                    let taken = law.advance_history(&mut start, to);
                    let rest = work - taken - (law.energy(&start, to) - before);
                    prop_assert!(taken > -1e-14 && rest > -1e-12, "{taken} {rest}");
                    prop_assert!(!exact || rest.abs() < 1e-12, "{rest}");
                    bounded(&law, &start, to, &c);
                }
            }
        }

        /// The tangent is the derivative of the stress, where the slider sticks and where it slips, in steps of any weight and without a start.
        #[test]
        fn tangents_are_derivatives(
            a in prop::array::uniform3(0.02..0.3f64), by in prop::array::uniform3(-0.1..0.1f64), size in 0.01..1.0f64, w in 0.5..1.0f64,
        ) {
            let law = Hysteretic::new(StVenantKirchhoff::orthotropic(Y, 3.0, 0.2, 1.5), slider::friction(LOSS));
            let (_, _, mut start) = along(&law, 0.5, &[a], 1);
            law.anchor(&mut start, a);
            let end: Strain = std::array::from_fn(|i| a[i] + size * by[i]);
            let h = 1e-6;
            let at = |j: usize, by: f64| { let mut e = end; e[j] += by; e };
            let (k, alone) = (law.tangent::<true>(&start, end, w), law.tangent::<false>(&start, end, 1.0));
            prop_assert_eq!(k.0, law.stress::<true>(&start, end, w));
            prop_assert_eq!(alone.0, law.stress::<false>(&start, end, 1.0));
            for j in 0..3 {
                let slopes = [-20.0, 20.0].map(|by| law.state(start.slider, at(j, by * h)).slope);
                prop_assume!(slopes[0] == slopes[1]);
                for i in 0..3 {
                    let slope = |of: &dyn Fn(Strain) -> Stress| (of(at(j, h))[i] - of(at(j, -h))[i]) / (2.0 * h);
                    let blended = slope(&|e| law.stress::<true>(&start, e, w));
                    prop_assert!((blended - w * k.1[i][j]).abs() < 1e-6, "{blended} {}", w * k.1[i][j]);
                    let single = slope(&|e| law.stress::<false>(&start, e, 1.0));
                    prop_assert!((single - alone.1[i][j]).abs() < 1e-6, "{single} {}", alone.1[i][j]);
                }
            }
        }
    }

    const SHEET: [Vec3; 4] = [
        Vec3::new(0.1, -0.2, 0.3),
        Vec3::new(1.2, 0.1, 0.2),
        Vec3::new(1.4, 1.1, 0.5),
        Vec3::new(0.3, 0.9, 0.6),
    ];

    fn pulled(x: Vec3, by: f64) -> Vec3 {
        Vec3::new(
            (1.0 + by) * x[0] + 0.1 * x[1],
            (1.0 + 0.5 * by) * x[1] - 0.2 * x[2],
            x[2] + by * x[0] * x[1],
        )
    }

    /// Triangles and quadrilaterals of such cloth are elements as any other, loaded on and relieved; their internal variables are saved whole.
    #[test]
    fn elements_conform() {
        let sheet = |by: f64| SHEET.map(|x| pulled(x, by));
        for law in [
            || Hysteretic::new(StVenantKirchhoff::isotropic(Y, 0.3), 0.2),
            || Hysteretic::new(Prestressed::new(StVenantKirchhoff::isotropic(Y, 0.3), 1.0), 0.2),
            || Hysteretic::new(NeoHookean::new(Y), 0.2),
        ] {
            for (before, now) in [(0.1, 0.3), (0.4, 0.2)] {
                let (from, to) = (sheet(before), sheet(now));
                let triangle = |x: [Vec3; 4]| [x[0], x[1], x[2]];
                let kernel = Triangle::new(law(), 2.0);
                let r = Reference::new(triangle(SHEET)).expect("a proper triangle");
                let element = || {
                    let mut e = kernel.element(&r, 0.02);
                    kernel.advance_history(&mut e, &triangle(from));
                    e
                };
                conforms_in_a_step(&kernel, element, triangle(SHEET), triangle(to));
                let kernel = quad::Quad::new(law(), 0.02, 2.0);
                let r = quad::Reference::new(SHEET, None).expect("a proper quadrilateral");
                let element = || {
                    let mut e = kernel.element(r);
                    kernel.advance_history(&mut e, &from);
                    e
                };
                conforms_in_a_step(&kernel, element, SHEET, to);
                let (mut saved, mut again) = ([0.0; 8], kernel.element(r));
                kernel.history(&element(), &mut saved);
                kernel.set_history(&mut again, &saved);
                let step = Step::only(to);
                let force = |e| kernel.force::<false, false>(e, &step, &Load::ZERO);
                assert_eq!(force(&again), force(&element()));
            }
        }
    }
}
