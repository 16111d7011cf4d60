//! Viscous stress: nothing, laminar, or with Smagorinsky's eddy viscosity.

use crate::geometry::vec3::Vec3;

/// How the stress at a face follows from the velocity gradient.
pub trait Viscosity: Copy {
    /// Whether there is any. Decided when the program is compiled: an inviscid
    /// flow pays nothing.
    const ACTIVE: bool;
    /// Dynamic viscosity (Pa s) at density `rho` (kg/m3), velocity gradient
    /// `g[direction][component]` (1/s) and cell size `h` (m).
    fn dynamic(&self, rho: f64, g: &[Vec3; 3], h: f64) -> f64;
}

/// No viscosity.
#[derive(Clone, Copy, Debug)]
pub struct Inviscid;

impl Viscosity for Inviscid {
    const ACTIVE: bool = false;
    #[inline(always)]
    fn dynamic(&self, _: f64, _: &[Vec3; 3], _: f64) -> f64 {
        0.0
    }
}

/// Constant dynamic viscosity.
#[derive(Clone, Copy, Debug)]
pub struct Laminar {
    /// Pa s.
    pub viscosity: f64,
}

impl Viscosity for Laminar {
    const ACTIVE: bool = true;
    #[inline(always)]
    fn dynamic(&self, _: f64, _: &[Vec3; 3], _: f64) -> f64 {
        self.viscosity
    }
}

/// Smagorinsky (1963): $\mu_t = \rho (C_s h)^2 |S|$, with $C_s = 0.17$.
#[derive(Clone, Copy, Debug)]
pub struct Smagorinsky {
    /// Of the fluid, Pa s.
    pub viscosity: f64,
}

impl Viscosity for Smagorinsky {
    const ACTIVE: bool = true;
    #[inline(always)]
    fn dynamic(&self, rho: f64, g: &[Vec3; 3], h: f64) -> f64 {
        let mut s2 = 0.0;
        for i in 0..3 {
            for j in 0..3 {
                let s = 0.5 * (g[i][j] + g[j][i]);
                s2 += 2.0 * s * s;
            }
        }
        self.viscosity + rho * (0.17 * h) * (0.17 * h) * s2.sqrt()
    }
}

/// Force of the air on a face of area vector `area` for viscosity `mu` and
/// velocity gradient `g`: $\tau\cdot S$ with Stokes' hypothesis, N.
#[inline(always)]
pub fn stress_force(mu: f64, g: &[Vec3; 3], area: Vec3) -> Vec3 {
    let divergence = (g[0][0] + g[1][1] + g[2][2]) * (2.0 / 3.0);
    std::array::from_fn(|i| {
        let sum: f64 = (0..3).map(|j| (g[j][i] + g[i][j]) * area[j]).sum();
        mu * (sum - divergence * area[i])
    })
}

/// Shear stress that a wall feels from air moving at `slip` relative to it at
/// normal distance `distance`, Pa. `normal` has unit length.
#[inline(always)]
pub fn wall_traction(mu: f64, slip: Vec3, normal: Vec3, distance: f64) -> Vec3 {
    let through = slip[0] * normal[0] + slip[1] * normal[1] + slip[2] * normal[2];
    std::array::from_fn(|i| mu * (slip[i] - through * normal[i]) / distance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn couette_shear() {
        // u = 3 y: stress 3 mu along x on a face with normal y.
        let mut g = [[0.0; 3]; 3];
        g[1][0] = 3.0;
        assert_eq!(stress_force(0.5, &g, [0.0, 2.0, 0.0]), [3.0, 0.0, 0.0]);
        assert_eq!(wall_traction(0.5, [3.0, 1.0, 0.0], [0.0, 1.0, 0.0], 1.0), [1.5, 0.0, 0.0]);
    }

    #[test]
    fn rotation_has_no_stress() {
        let mut g = [[0.0; 3]; 3];
        (g[0][1], g[1][0]) = (2.0, -2.0);
        assert_eq!(stress_force(1.0, &g, [1.0, 2.0, 3.0]), [0.0; 3]);
        let s = Smagorinsky { viscosity: 1e-5 };
        assert_eq!(s.dynamic(1.2, &g, 0.1), 1e-5);
    }
}
