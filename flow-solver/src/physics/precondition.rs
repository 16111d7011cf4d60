//! The Weiss-Smith matrix and the speeds that scale it.
//!
//! Weiss and Smith (1995): in the pseudo-time term the compressibility
//! $`\partial\rho/\partial p`$ is replaced by $`\Theta = 1/U_r^2 - \rho_T/(\rho c_p)`$,
//! which brings the pseudo-acoustic speeds down to the reference speed $`U_r`$.

use super::gas::Gas;

/// Reference speed, m/s: the largest of the flow's own speed, of what the time
/// step lets pressure act over (`length * rate`, the unsteady limit) and of what
/// friction diffuses over a cell, and never above the speed of sound.
#[inline(always)]
pub fn reference_speed(speed: f64, length: f64, rate: f64, kinematic_viscosity: f64, sound: f64) -> f64 {
    speed.max(length * rate).max(kinematic_viscosity / length).min(sound)
}

/// Weiss-Smith matrix $`\Gamma = \partial W/\partial Q`$ with the compressibility
/// of the reference speed `ur`. At `ur = c` it is the Jacobian itself.
#[inline(always)]
pub fn preconditioner<G: Gas<N>, const N: usize>(gas: &G, q: &[f64; N], ur: f64) -> [[f64; N]; N] {
    let c2 = gas.sound_speed_squared(q);
    // rho_p of the model is 1/c^2 plus its thermal part, which stays.
    let thermal = gas.jacobian(q)[0][0] - 1.0 / c2;
    gas.time_matrix(q, Some(1.0 / (ur * ur) + thermal))
}

/// Largest pseudo-acoustic speed for velocity `un` along the face (relative to
/// it), reference speed `ur` and sound speed `c`, m/s.
#[inline(always)]
pub fn spectral_radius(un: f64, ur: f64, c: f64) -> f64 {
    // u' = u (1 - alpha), c' = sqrt(alpha^2 u^2 + ur^2), alpha = (1 - ur^2/c^2)/2.
    let alpha = 0.5 * (1.0 - (ur / c) * (ur / c));
    un.abs() * (1.0 - alpha) + (alpha * alpha * un * un + ur * ur).sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::gas::{Air, IdealGas, Isothermal};
    use super::*;
    use crate::geometry::vec3::Vec3;
    use crate::physics::velocity;
    use nalgebra::SMatrix;

    #[test]
    fn preconditioner_is_the_physical_jacobian_at_sonic_speed() {
        let gas = IdealGas::new(Air::new(1.225, 288.15));
        let q = [10.0f64, 1.0, 2.0, 3.0, 0.5];
        let c = gas.sound_speed_squared(&q).sqrt();
        let (a, b) = (preconditioner(&gas, &q, c), gas.jacobian(&q));
        for r in 0..5 {
            for k in 0..5 {
                assert!((a[r][k] - b[r][k]).abs() <= 1e-9 * b[r][k].abs().max(1e-3));
            }
        }
        assert!((spectral_radius(30.0, c, c) - (30.0 + c)).abs() < 1e-12);
    }

    #[test]
    fn pseudo_acoustic_speed_scales_with_the_flow_speed() {
        let gas = Isothermal::new(Air::new(1.225, 288.15));
        let c = gas.sound_speed_squared(&[0.0f64; 4]).sqrt();
        assert!(spectral_radius(1.0, 1.0, c) < 1.7);
        assert_eq!(reference_speed(1.0, 0.1, 100.0, 0.0, c), 10.0);
        assert_eq!(reference_speed(1.0, 0.1, 1e9, 0.0, c), c);
    }

    /// The preconditioned pseudo-time waves of Weiss and Smith are the eigenvalues of `Gamma^-1 dF/dQ`; the largest of them is
    /// the spectral radius. Flux derivative by differences.
    #[test]
    fn spectral_radius_is_the_largest_eigenvalue() {
        let gas = IdealGas::new(Air::new(1.225, 288.15));
        let n = Vec3::new(0.6, 0.0, 0.8);
        for (u, ur) in [([3.0, -2.0, 5.0], 10.0), ([-90.0, 20.0, -70.0], 120.0), ([200.0, 0.0, 50.0], 250.0)]
        {
            let q = [120.0, u[0], u[1], u[2], 1.3];
            let flux = |q: &[f64; 5]| -> [f64; 5] {
                let mass = gas.density(q) * velocity(q).dot(&n);
                let (carried, push) = (gas.carried(q), gas.pressure_flux(q[0], n, 0.0));
                std::array::from_fn(|v| mass * carried[v] + push[v])
            };
            let mut a = SMatrix::<f64, 5, 5>::zeros();
            for c in 0..5 {
                let h = [1.0, 1e-3, 1e-3, 1e-3, 1e-2][c];
                let at = |h: f64| {
                    let mut q = q;
                    q[c] += h;
                    flux(&q)
                };
                let (low, high) = (at(-h), at(h));
                (0..5).for_each(|r| a[(r, c)] = (high[r] - low[r]) / (2.0 * h));
            }
            let gamma = preconditioner(&gas, &q, ur);
            let gamma = SMatrix::<f64, 5, 5>::from_fn(|r, c| gamma[r][c]);
            let waves = gamma.lu().solve(&a).expect("regular").complex_eigenvalues();
            let largest = waves.iter().map(|w| w.norm()).fold(0.0, f64::max);
            let found = spectral_radius(velocity(&q).dot(&n), ur, gas.sound_speed_squared(&q).sqrt());
            assert!((found / largest - 1.0).abs() < 1e-3, "{found} {largest}: {waves}");
        }
        // What friction diffuses over a cell.
        assert_eq!(reference_speed(1.0, 0.5, 1.0, 20.0, 340.0), 40.0);
    }
}
