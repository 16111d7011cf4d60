//! Spalart-Allmaras, point by point.
//!
//! Spalart and Allmaras (1994) in the form of Allmaras, Johnson and Spalart (ICCFD7-1902, 2012):
//! the standard model where the working variable $`\tilde\nu`$ is positive, its negative
//! continuation (SA-neg) where a coarse grid lets it undershoot. For constant density
//! ```math
//! \frac{D\tilde\nu}{Dt} = P - D + \frac1\sigma\left[\nabla\cdot\big((\nu + f_n\tilde\nu)
//! \nabla\tilde\nu\big) + c_{b2}|\nabla\tilde\nu|^2\right],\qquad \nu_t = f_{v1}\tilde\nu .
//! ```

/// $`\sigma`$: diffusion.
pub const SIGMA: f64 = 2.0 / 3.0;
/// $`c_{b2}`$: diffusion by squared gradients.
pub const CB2: f64 = 0.622;
/// Von Karman's constant.
pub const KAPPA: f64 = 0.41;
const CB1: f64 = 0.1355;
const CW1: f64 = CB1 / (KAPPA * KAPPA) + (1.0 + CB2) / SIGMA;
const CW2: f64 = 0.3;
const CW3: f64 = 2.0;
/// Of the damping next to walls, $`f_{v1}`$.
pub const CV1: f64 = 7.1;
const CT3: f64 = 1.2;
const CT4: f64 = 0.5;
const CN1: f64 = 16.0;
/// Limits of the modified vorticity.
const CV2: f64 = 0.7;
const CV3: f64 = 0.9;
/// Of detached eddies, of hexahedra (Shur et al. 1999).
const CDES: f64 = 0.65;

/// Of the low-Reynolds correction, $`f_w^*`$.
const FW_STAR: f64 = 0.424;

fn fv1(chi: f64) -> f64 {
    let c3 = chi * chi * chi;
    c3 / (c3 + CV1 * CV1 * CV1)
}

fn fv2(chi: f64) -> f64 {
    1.0 - chi / (1.0 + chi * fv1(chi))
}

fn ft2(chi: f64) -> f64 {
    CT3 * (-CT4 * chi * chi).exp()
}

/// Kinematic eddy viscosity $`\nu_t`$ of the working variable `x` at molecular viscosity `nu`, m2/s.
pub fn eddy_viscosity(x: f64, nu: f64) -> f64 {
    if x > 0.0 { x * fv1(x / nu) } else { 0.0 }
}

/// Dynamic viscosity at a face, eddies included, between cells whose working variables times density are `a` and `b`, for
/// the molecular viscosity `mu`; all in Pa s. It is the mean of a constant stress through a layer in which $`\tilde\nu`$ is linear,
/// as next to a wall:
/// ```math
/// \frac1{\mu_f} = \int_0^1 \frac{ds}{\mu + \mu_t\big(a + s (b - a)\big)} .
/// ```
/// Three points of Gauss: in the logarithmic layer, between cells at heights of 1 and 3, off by 0.1 % where the mean of the two is off by 10 %.
#[inline(always)]
pub fn face_viscosity([a, b]: [f64; 2], mu: f64) -> f64 {
    let resistance = |s: f64| 1.0 / (mu + eddy_viscosity(a + s * (b - a), mu));
    const NODE: f64 = 0.112_701_665_379_258_3;
    18.0 / (5.0 * (resistance(NODE) + resistance(1.0 - NODE)) + 8.0 * resistance(0.5))
}

/// Diffusivity of the working variable, $`\nu + f_n\tilde\nu`$, m2/s: positive for any `x`.
pub fn diffusivity(x: f64, nu: f64) -> f64 {
    if x >= 0.0 {
        return nu + x;
    }
    let c3 = (x / nu).powi(3);
    nu + x * (CN1 + c3) / (CN1 - c3)
}

/// Production less destruction, m2/s2, for vorticity `w` (1/s) at the length `d` (m): the distance
/// to the wall, or what a hybrid model puts in its place.
pub fn source(x: f64, nu: f64, w: f64, d: f64) -> f64 {
    if x < 0.0 {
        return CB1 * (1.0 - CT3) * w * x + CW1 * (x / d) * (x / d);
    }
    let chi = x / nu;
    let k2d2 = KAPPA * KAPPA * d * d;
    let more = x / k2d2 * fv2(chi);
    let s = if more >= -CV2 * w {
        w + more
    } else {
        w + w * (CV2 * CV2 * w + CV3 * more) / ((CV3 - 2.0 * CV2) * w - more)
    };
    let ft2 = ft2(chi);
    // Far from walls in still air nothing is produced; r is then at its bound.
    let r = if s * k2d2 > 1e-300 { (x / (s * k2d2)).min(10.0) } else { 10.0 };
    let g = r + CW2 * (r.powi(6) - r);
    let c6 = CW3.powi(6);
    let fw = g * ((1.0 + c6) / (g.powi(6) + c6)).powf(1.0 / 6.0);
    let production = CB1 * (1.0 - ft2) * s * x;
    let destruction = (CW1 * fw - CB1 / (KAPPA * KAPPA) * ft2) * (x / d) * (x / d);
    production - destruction
}

/// Cell data for the length scale of a hybrid RANS-LES model.
#[derive(Clone, Copy, Debug)]
pub struct LengthScaleInput {
    /// Distance to the nearest wall, m.
    pub wall: f64,
    /// Largest extent of the cell, m.
    pub delta: f64,
    /// Molecular and eddy viscosity together, m2/s.
    pub viscosity: f64,
    /// Norm of the velocity gradient, 1/s.
    pub gradient: f64,
    /// Working variable over molecular viscosity.
    pub chi: f64,
}

/// Length scale of a model.
pub type Length = fn(&LengthScaleInput) -> f64;

/// The wall distance: all turbulence is modelled.
pub fn rans(a: &LengthScaleInput) -> f64 {
    a.wall
}

/// Detached eddies (Spalart, Jou, Strelets and Allmaras 1997).
pub fn des97(a: &LengthScaleInput) -> f64 {
    a.wall.min(CDES * a.delta)
}

/// Low-Reynolds correction of the length scale (Spalart et al. 2006, appendix): the terms that the model has for the vicinity of walls would take
/// away most of a small eddy viscosity far from them. With it the model at equilibrium is a Smagorinsky model at any ratio of
/// viscosities:
/// ```math
/// \Psi^2 = \min\left[100,\; \frac{1 - \frac{c_{b1}}{c_{w1} \kappa^2 f_w^*} \left(f_{t2} + (1 - f_{t2}) f_{v2}\right)}
/// {f_{v1} \max(10^{-10}, 1 - f_{t2})}\right]
/// ```
fn low_reynolds(chi: f64) -> f64 {
    if chi <= 0.0 {
        return 10.0;
    }
    let ft2 = ft2(chi);
    let near_walls = CB1 / (CW1 * KAPPA * KAPPA * FW_STAR) * (ft2 + (1.0 - ft2) * fv2(chi));
    ((1.0 - near_walls) / (fv1(chi) * (1.0 - ft2).max(1e-10)).max(f64::MIN_POSITIVE)).clamp(0.0, 100.0).sqrt()
}

/// Delayed detached eddies (Spalart et al. 2006): boundary layers keep the wall distance.
pub fn ddes(a: &LengthScaleInput) -> f64 {
    let rd = a.viscosity / (a.gradient.max(f64::MIN_POSITIVE) * KAPPA * KAPPA * a.wall * a.wall);
    let fd = 1.0 - (8.0 * rd).powi(3).tanh();
    a.wall - fd * (a.wall - low_reynolds(a.chi) * CDES * a.delta).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The log layer is an exact solution: with $`\tilde\nu = \kappa u_\tau y`$ and
    /// $`S = u_\tau / (\kappa y)`$ production, destruction and diffusion balance once viscosity is
    /// negligible, which is how $`c_{w1}`$ is chosen.
    #[test]
    fn source_and_diffusion_balance_in_the_log_layer() {
        let (tau, y, nu) = (1.3, 0.02, 1e-9);
        let x = KAPPA * tau * y;
        // chi is 1e7: f_v1 = 1 and S~ = S to 1e-7.
        let diffusion = (1.0 + CB2) / SIGMA * (KAPPA * tau).powi(2);
        let balance = source(x, nu, tau / (KAPPA * y), y) + diffusion;
        assert!(balance.abs() < 1e-5 * diffusion, "{balance} {diffusion}");
    }

    /// In the whole inner layer $`\tilde\nu = \kappa u_\tau y`$ is exact, also where viscosity
    /// counts: $`\tilde S`$ is made so that it stays $`u_\tau/(\kappa y)`$ (below, without $`f_{t2}`$).
    #[test]
    fn source_and_diffusion_balance_in_the_buffer_layer() {
        let (tau, nu) = (1.0, 1.0);
        for y in [20.0, 40.0, 100.0] {
            let x = KAPPA * tau * y;
            let w = tau * tau / (nu + eddy_viscosity(x, nu));
            let diffusion = (1.0 + CB2) / SIGMA * (KAPPA * tau).powi(2);
            let balance = source(x, nu, w, y) + diffusion;
            // f_t2 is exp(-chi^2/2) < 1e-14 here.
            assert!(balance.abs() < 1e-10 * diffusion, "y+ {y}: {balance} {diffusion}");
        }
    }

    #[test]
    fn branches_are_continuous_at_zero() {
        let (nu, w, d) = (1.5e-5, 40.0, 0.01);
        assert_eq!(source(0.0, nu, w, d), 0.0);
        let h = 1e-12;
        let (below, above) = (-source(-h, nu, w, d) / h, source(h, nu, w, d) / h);
        // SA-neg continues value and slope of c_b1 (1 - c_t3) w x; S~ differs by x/(kappa d)^2.
        assert!((below / above - 1.0).abs() < 1e-3, "{below} {above}");
        assert!((diffusivity(-h, nu) - nu).abs() < 2.0 * h && diffusivity(-1.0, nu) > 0.0);
        assert_eq!(eddy_viscosity(-1.0, nu), 0.0);
    }

    #[test]
    fn lengths() {
        let near = LengthScaleInput { wall: 0.01, delta: 0.1, viscosity: 1e-3, gradient: 100.0, chi: 1e4 };
        assert_eq!((rans(&near), des97(&near)), (0.01, 0.01));
        let far = LengthScaleInput { wall: 1.0, ..near };
        assert!((des97(&far) - 0.065).abs() < 1e-15);
        assert!((ddes(&far) - 0.065).abs() < 1e-4);
        // By the formula, in another program.
        for (chi, psi) in [(0.0, 10.0), (1.0, 10.0), (5.0, 2.556854136), (10.0, 1.230355666), (1e6, 1.0)] {
            assert!((low_reynolds(chi) - psi).abs() < 1e-6, "{chi}: {}", low_reynolds(chi));
        }
        // In a boundary layer (r_d = 1) on a grid that is too fine along the wall only the first
        // gives up the wall.
        let layer =
            LengthScaleInput { wall: 0.1, delta: 0.02, viscosity: 0.1681, gradient: 100.0, chi: 100.0 };
        assert!(des97(&layer) < 0.02 && (ddes(&layer) - 0.1).abs() < 1e-12);
    }
}
