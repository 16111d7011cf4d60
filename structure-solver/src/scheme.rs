//! Implicit time integration: Newmark and generalized-alpha.
//!
//! With the new displacements $`u_1`$ as unknowns (paper, equation 5, re-derived:
//! the print has lost the dots of velocities and accelerations):
//!
//! ```math
//! a_1 = \frac{u_1-u_0}{\beta\Delta t^2} - \frac{v_0}{\beta\Delta t} - (\frac1{2\beta}-1)a_0
//! ```
//!
//! ```math
//! v_1 = v_0 + \Delta t\,((1-\gamma)a_0+\gamma a_1)
//! ```
//!
//! Balance holds at the point $`u_\alpha=(1-\alpha_f)u_1+\alpha_f u_0`$ for forces and
//! $`a_\alpha=(1-\alpha_m)a_1+\alpha_m a_0`$ for inertia (Chung and Hulbert 1993).
//! Newmark, as in the paper, is $`\alpha_f=\alpha_m=0`$. It conserves the energy of
//! linear vibrations only: where fabric snaps between slack and taut it can create
//! energy without bound (the air bag of the paper does so from 0.006 s on). With
//! $`\alpha_f>0`$ the stresses come from averaged strains instead
//! ([`crate::materials::step`]), which creates none.

/// Coefficients of the time integration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scheme {
    /// Weight of the old state in the inertia.
    pub alpha_m: f64,
    /// Weight of the old state in the forces.
    pub alpha_f: f64,
    /// Newmark's gamma (the paper calls it alpha).
    pub gamma: f64,
    /// Newmark's beta.
    pub beta: f64,
}

impl Scheme {
    /// Newmark with gamma 1/2, beta 1/4: second order, no numerical damping.
    pub fn newmark() -> Self {
        Self { alpha_m: 0.0, alpha_f: 0.0, gamma: 0.5, beta: 0.25 }
    }

    /// Generalized-alpha: second order; `rho`, from 0 to 1, is the factor left
    /// of the highest frequencies after each step.
    pub fn generalized_alpha(rho: f64) -> Self {
        let (alpha_m, alpha_f) = ((2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0));
        let gamma = 0.5 - alpha_m + alpha_f;
        Self { alpha_m, alpha_f, gamma, beta: 0.25 * (1.0 - alpha_m + alpha_f).powi(2) }
    }

    /// The formulas for a step of `dt` (s) under mass damping (1/s).
    pub fn step(&self, dt: f64, damping: f64) -> StepForm {
        let Self { alpha_m, alpha_f, gamma, beta } = *self;
        let (c0, c1, c2) = (1.0 / (beta * dt * dt), 1.0 / (beta * dt), 0.5 / beta - 1.0);
        StepForm {
            dt,
            force_weight: 1.0 - alpha_f,
            mass_factor: (1.0 - alpha_m) * c0 + damping * (1.0 - alpha_f) * gamma * dt * c0,
            from_v: -(1.0 - alpha_m) * c1 + damping * (1.0 - (1.0 - alpha_f) * gamma * dt * c1),
            from_a: alpha_m - (1.0 - alpha_m) * c2
                + damping * (1.0 - alpha_f) * dt * ((1.0 - gamma) - gamma * c2),
            c0,
            c1,
            c2,
            gamma,
        }
    }
}

/// A [`Scheme`] with a step length and damping.
///
/// Inertia and damping together are `M w` with
/// `w = mass_factor (u1 - u0) + from_v v0 + from_a a0`.
#[derive(Clone, Copy, Debug)]
pub struct StepForm {
    /// Step, s.
    pub dt: f64,
    /// Weight of the new displacements at the point of balance.
    pub force_weight: f64,
    /// Factor of `M` in the effective matrix, 1/s2.
    pub mass_factor: f64,
    /// Weight of the old velocity in `w`, 1/s.
    pub from_v: f64,
    /// Weight of the old acceleration in `w`.
    pub from_a: f64,
    c0: f64,
    c1: f64,
    c2: f64,
    gamma: f64,
}

impl StepForm {
    /// Implicit Euler of an overdamped motion: `mass_factor M (u1 - u0)` (1/s2) stands
    /// for inertia. New velocities and accelerations mean nothing.
    pub fn overdamped(mass_factor: f64) -> Self {
        let none = 0.0;
        Self {
            dt: none,
            force_weight: 1.0,
            mass_factor,
            from_v: none,
            from_a: none,
            c0: none,
            c1: none,
            c2: none,
            gamma: none,
        }
    }

    /// New acceleration of one component.
    #[inline(always)]
    pub fn acceleration(&self, du: f64, v0: f64, a0: f64) -> f64 {
        self.c0 * du - self.c1 * v0 - self.c2 * a0
    }

    /// New velocity of one component from old and new acceleration.
    #[inline(always)]
    pub fn velocity(&self, v0: f64, a0: f64, a1: f64) -> f64 {
        v0 + self.dt * ((1.0 - self.gamma) * a0 + self.gamma * a1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Integrates `a + damping v + k u = 0` and returns `u` after `n` steps to time 1.
    fn oscillator(scheme: Scheme, k: f64, damping: f64, n: usize) -> f64 {
        let dt = 1.0 / n as f64;
        let s = scheme.step(dt, damping);
        let (mut u, mut v) = (1.0, 0.0);
        let mut a = -k * u - damping * v;
        for _ in 0..n {
            // mass_factor du + from_v v + from_a a + k (u + force_weight du) = 0
            let du = -(s.from_v * v + s.from_a * a + k * u) / (s.mass_factor + k * s.force_weight);
            let a1 = s.acceleration(du, v, a);
            v = s.velocity(v, a, a1);
            u += du;
            a = a1;
        }
        u
    }

    #[test]
    fn second_order_for_an_oscillator_with_damping() {
        let (k, c) = (40.0f64, 0.7);
        let w = (k - 0.25 * c * c).sqrt();
        let exact = (-0.5 * c).exp() * (w.cos() + 0.5 * c / w * w.sin());
        for scheme in [Scheme::newmark(), Scheme::generalized_alpha(0.6), Scheme::generalized_alpha(0.0)] {
            let e = |n| (oscillator(scheme, k, c, n) - exact).abs();
            let order = (e(1600) / e(3200)).log2();
            assert!((order - 2.0).abs() < 0.1, "{scheme:?}: order {order}");
        }
    }

    #[test]
    fn newmark_keeps_the_amplitude_and_alpha_damps_the_highest() {
        // u is 1 again after whole periods only; the energy-like bound is |u| <= 1.
        assert!(oscillator(Scheme::newmark(), 1e8, 0.0, 100).abs() <= 1.0 + 1e-9);
        assert!(oscillator(Scheme::generalized_alpha(0.5), 1e8, 0.0, 100).abs() < 1e-6);
    }

    #[test]
    fn spectral_radius_one_is_the_midpoint_family() {
        let s = Scheme::generalized_alpha(1.0);
        assert_eq!((s.alpha_m, s.alpha_f, s.gamma, s.beta), (0.5, 0.5, 0.5, 0.25));
    }
}
