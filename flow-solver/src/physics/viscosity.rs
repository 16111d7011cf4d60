//! Viscous stress: none, laminar, or with an eddy viscosity.

use mesh::lanes::Real;
use nalgebra::{Matrix3, Vector3};

use super::WallTreatment;
use crate::geometry::vec3::Vec3;

/// How the stress at a face follows from the velocity gradient. Loops over faces are compiled for each; what calls
/// them holds a [`ViscosityModel`].
pub trait Viscosity: Copy + Into<ViscosityModel> {
    /// Whether there is any. Decided when the program is compiled: an inviscid
    /// flow pays nothing.
    const ACTIVE: bool;
    /// Whether a transported eddy viscosity is added, see [`crate::turbulence`].
    #[inline(always)]
    fn transported(&self) -> bool {
        false
    }
    /// Dynamic viscosity (Pa s) at density `rho` (kg/m3), velocity gradient
    /// `g` (1/s, row: direction, column: component) and cell size `h` (m).
    fn dynamic<T: Real>(&self, rho: T, g: &Matrix3<T>, h: T) -> T;
}

/// No viscosity.
#[derive(Clone, Copy, Debug)]
pub struct Inviscid;

impl Viscosity for Inviscid {
    const ACTIVE: bool = false;
    #[inline(always)]
    fn dynamic<T: Real>(&self, _: T, _: &Matrix3<T>, _: T) -> T {
        T::splat(0.0)
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
    fn dynamic<T: Real>(&self, _: T, _: &Matrix3<T>, _: T) -> T {
        T::splat(self.viscosity)
    }
}

/// A dynamic viscosity of the fluid and an eddy viscosity on top of it.
#[derive(Clone, Copy, Debug)]
pub struct Turbulent {
    /// Of the fluid, Pa s.
    pub viscosity: f64,
    /// Model of the eddy viscosity.
    pub eddies: EddyViscosity,
    /// Friction on no-slip walls.
    pub wall: WallTreatment,
}

/// Where an eddy viscosity comes from. A choice at run time: its cost is negligible against the flux of a face, and all
/// turbulent flows share one compiled solver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EddyViscosity {
    /// Smagorinsky (1963), `smagorinsky`.
    Smagorinsky,
    /// Nicoud and Ducros (1999), `wale`.
    Wale,
    /// Transported with the flow, see [`crate::turbulence`].
    TransportInput,
}

impl Viscosity for Turbulent {
    const ACTIVE: bool = true;
    #[inline(always)]
    fn transported(&self) -> bool {
        self.eddies == EddyViscosity::TransportInput
    }
    #[inline(always)]
    fn dynamic<T: Real>(&self, rho: T, g: &Matrix3<T>, h: T) -> T {
        let fluid = T::splat(self.viscosity);
        match self.eddies {
            EddyViscosity::Smagorinsky => fluid + smagorinsky(rho, g, h),
            EddyViscosity::Wale => fluid + wale(rho, g, h),
            EddyViscosity::TransportInput => fluid,
        }
    }
}

/// The viscosity of a flow, as a choice at run time: one for each loop, none for each face.
#[derive(Clone, Copy, Debug)]
pub enum ViscosityModel {
    /// [`Inviscid`].
    Inviscid,
    /// [`Laminar`].
    Laminar(Laminar),
    /// [`Turbulent`].
    Turbulent(Turbulent),
}

impl ViscosityModel {
    /// Whether there is any.
    pub fn is_active(&self) -> bool {
        !matches!(self, Self::Inviscid)
    }

    /// Whether a transported eddy viscosity is added, see [`crate::turbulence`].
    pub fn transported(&self) -> bool {
        matches!(self, Self::Turbulent(turbulent) if turbulent.transported())
    }

    /// Dynamic viscosity of the fluid itself, Pa s.
    pub fn molecular(&self) -> f64 {
        match self {
            Self::Inviscid => 0.0,
            Self::Laminar(laminar) => laminar.viscosity,
            Self::Turbulent(turbulent) => turbulent.viscosity,
        }
    }

    /// Friction on no-slip walls.
    pub fn wall_treatment(&self) -> WallTreatment {
        match self {
            Self::Inviscid | Self::Laminar(_) => WallTreatment::Resolved,
            Self::Turbulent(turbulent) => turbulent.wall,
        }
    }
}

impl From<Inviscid> for ViscosityModel {
    fn from(_: Inviscid) -> Self {
        Self::Inviscid
    }
}

impl From<Laminar> for ViscosityModel {
    fn from(laminar: Laminar) -> Self {
        Self::Laminar(laminar)
    }
}

impl From<Turbulent> for ViscosityModel {
    fn from(turbulent: Turbulent) -> Self {
        Self::Turbulent(turbulent)
    }
}

/// Smagorinsky (1963): $`\mu_t = \rho (C_s h)^2 |S|`$, with $`C_s = 0.17`$, Pa s; arguments as in
/// [`Viscosity::dynamic`].
pub fn smagorinsky<T: Real>(rho: T, g: &Matrix3<T>, h: T) -> T {
    let [mut s2, half, two, constant] = [0.0, 0.5, 2.0, 0.17].map(T::splat);
    for i in 0..3 {
        for j in 0..3 {
            let s = half * (g[(i, j)] + g[(j, i)]);
            s2 += two * s * s;
        }
    }
    rho * (constant * h) * (constant * h) * s2.simd_sqrt()
}

/// WALE (Nicoud and Ducros 1999): $`\mu_t = \rho (C_w h)^2 (S^d{:}S^d)^{3/2} / ((S{:}S)^{5/2} + (S^d{:}S^d)^{5/4})`$
/// with $`S^d`$ the traceless symmetric part of the squared velocity gradient, Pa s; arguments as in [`Viscosity::dynamic`]. The constant is
/// that of isotropic turbulence, $`C_w = 0.55`$ (the paper: 0.55 to 0.60; $`C_w^2 = 10.6\, C_s^2`$ with the $`C_s`$ of [`smagorinsky`]). Zero in pure shear, and falling with the cube of the distance to a wall.
pub fn wale<T: Real>(rho: T, g: &Matrix3<T>, h: T) -> T {
    let [zero, half, three, constant] = [0.0, 0.5, 3.0, 0.55].map(T::splat);
    let square = g * g;
    let third = square.trace() / three;
    let (mut s2, mut d2) = (zero, zero);
    for i in 0..3 {
        for j in 0..3 {
            let s = half * (g[(i, j)] + g[(j, i)]);
            let d = half * (square[(i, j)] + square[(j, i)]) - if i == j { third } else { zero };
            s2 += s * s;
            d2 += d * d;
        }
    }
    let bottom = s2 * s2 * s2.simd_sqrt() + d2 * d2.simd_sqrt().simd_sqrt();
    // Where nothing turns or stretches both are zero.
    let rate = (d2 * d2.simd_sqrt() / bottom).select(bottom.simd_gt(T::splat(f64::MIN_POSITIVE)), zero);
    rho * (constant * h) * (constant * h) * rate
}

/// Force of the air on a face of area vector `area` for viscosity `mu` and
/// velocity gradient `g`: $`\tau\cdot S`$ with Stokes' hypothesis, N.
#[inline(always)]
pub fn stress_force<T: Real>(mu: T, g: &Matrix3<T>, area: Vector3<T>) -> Vector3<T> {
    let divergence = g.trace() * T::splat(2.0 / 3.0);
    ((g + g.transpose()) * area - area * divergence) * mu
}

/// Shear stress on a wall from air moving at `slip` along it at normal distance `distance`, Pa. `mu` is the viscosity
/// of the fluid, or the effective one of the law of the wall.
#[inline(always)]
pub fn wall_traction(mu: f64, slip: Vec3, distance: f64) -> Vec3 {
    slip * mu / distance
}

/// The part of a velocity along a wall of unit normal `normal`.
#[inline(always)]
pub fn along_wall(velocity: Vec3, normal: Vec3) -> Vec3 {
    velocity - normal * velocity.dot(&normal)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::vec3::Mat3;

    #[test]
    fn couette_shear() {
        // u = 3 y: stress 3 mu along x on a face with normal y.
        let mut g = Mat3::zeros();
        g[(1, 0)] = 3.0;
        assert_eq!(stress_force(0.5, &g, Vec3::y() * 2.0), Vec3::x() * 3.0);
        assert_eq!(wall_traction(0.5, along_wall(Vec3::new(3.0, 1.0, 0.0), Vec3::y()), 1.0), Vec3::x() * 1.5);
    }

    #[test]
    fn wale_vanishes_in_pure_shear_but_not_in_rotation() {
        let w = Turbulent { viscosity: 1e-5, eddies: EddyViscosity::Wale, wall: WallTreatment::Resolved };
        let mut g = Mat3::zeros();
        assert_eq!(w.dynamic(1.2, &g, 0.1), 1e-5);
        g[(1, 0)] = 30.0;
        assert!((w.dynamic(1.2, &g, 0.1) - 1e-5).abs() < 1e-18);
        // Solid rotation at rate 2: S = 0, S^d has -4/3 - ... : d2 = 16 (2/9 + 4/9), rate = d2^(1/4).
        let mut g = Mat3::zeros();
        (g[(0, 1)], g[(1, 0)]) = (2.0, -2.0);
        let rate = (16.0f64 * 6.0 / 9.0).powf(0.25);
        let exact = 1e-5 + 1.2 * (0.055 * 0.055) * rate;
        assert!((w.dynamic(1.2, &g, 0.1) - exact).abs() < 1e-12);
    }

    #[test]
    fn rigid_rotation_has_no_stress() {
        let mut g = Mat3::zeros();
        (g[(0, 1)], g[(1, 0)]) = (2.0, -2.0);
        assert_eq!(stress_force(1.0, &g, Vec3::new(1.0, 2.0, 3.0)), Vec3::zeros());
        let s =
            Turbulent { viscosity: 1e-5, eddies: EddyViscosity::Smagorinsky, wall: WallTreatment::Resolved };
        assert_eq!(s.dynamic(1.2, &g, 0.1), 1e-5);
    }

    /// `|S|^2 = 2 S:S`: the shear rate in shear, and twice the squares of the rates in plain strain.
    #[test]
    fn smagorinsky_is_proportional_to_the_strain_rate() {
        let s =
            Turbulent { viscosity: 1e-5, eddies: EddyViscosity::Smagorinsky, wall: WallTreatment::Resolved };
        let mut g = Mat3::zeros();
        g[(1, 0)] = 3.0;
        let exact = |rate: f64| 1e-5 + 1.2 * (0.17 * 0.1) * (0.17 * 0.1) * rate;
        assert!((s.dynamic(1.2, &g, 0.1) - exact(3.0)).abs() < 1e-15);
        let g = Mat3::from_diagonal(&Vec3::new(2.0, 1.0, -3.0));
        assert!((s.dynamic(1.2, &g, 0.1) - exact(28f64.sqrt())).abs() < 1e-15);
    }

    /// Gradients a and b across each other: `S:S = (a + b)^2 / 2`, the squared gradient is `ab` in the plane,
    /// so that `S^d:S^d = 6/9 (ab)^2`.
    #[test]
    fn wale_of_combined_strain_and_rotation() {
        let (a, b) = (5.0, -2.0);
        let mut g = Mat3::zeros();
        (g[(0, 1)], g[(1, 0)]) = (a, b);
        let (strain, squared): (f64, f64) = (0.5 * (a + b) * (a + b), 6.0 / 9.0 * a * a * b * b);
        let rate = squared.powf(1.5) / (strain.powf(2.5) + squared.powf(1.25));
        let found = Turbulent { viscosity: 1e-5, eddies: EddyViscosity::Wale, wall: WallTreatment::Resolved }
            .dynamic(1.2, &g, 0.1);
        assert!((found - (1e-5 + 1.2 * 0.055 * 0.055 * rate)).abs() < 1e-14, "{found}");
    }

    /// Stretch in three directions: the squared gradient is diagonal, and its mean is taken out of it.
    #[test]
    fn wale_of_a_three_dimensional_gradient() {
        let rates = [3.0, -1.0, 2.0];
        let g = Mat3::from_diagonal(&rates.into());
        let squares = rates.map(|r: f64| r * r);
        let mean = squares.iter().sum::<f64>() / 3.0;
        let d2: f64 = squares.iter().map(|s| (s - mean) * (s - mean)).sum();
        let s2: f64 = squares.iter().sum();
        let rate = d2.powf(1.5) / (s2.powf(2.5) + d2.powf(1.25));
        let found = Turbulent { viscosity: 1e-5, eddies: EddyViscosity::Wale, wall: WallTreatment::Resolved }
            .dynamic(1.2, &g, 0.1);
        assert!((found - (1e-5 + 1.2 * 0.055 * 0.055 * rate)).abs() < 1e-14, "{found}");
    }

    /// `mu (2 S - 2/3 div u)` on stretching air, and a wall at an angle.
    #[test]
    fn stress_of_a_stretch_and_traction_on_an_oblique_wall() {
        let g = Mat3::from_diagonal(&Vec3::new(2.0, 0.5, -1.0));
        let force = stress_force(0.7, &g, Vec3::new(1.0, 2.0, 3.0));
        let exact = [2.0, 0.5, -1.0].map(|rate| 0.7 * (2.0 * rate - 2.0 / 3.0 * 1.5));
        (0..3).for_each(|i| assert!((force[i] - exact[i] * (i + 1) as f64).abs() < 1e-14, "{force:?}"));
        // Of the slip (2, 1, 3) the normal (0.6, 0, 0.8) takes 3.6.
        let traction =
            wall_traction(0.5, along_wall(Vec3::new(2.0, 1.0, 3.0), Vec3::new(0.6, 0.0, 0.8)), 0.25);
        let exact = [2.0 * (2.0 - 3.6 * 0.6), 2.0, 2.0 * (3.0 - 3.6 * 0.8)];
        (0..3).for_each(|i| assert!((traction[i] - exact[i]).abs() < 1e-14, "{traction:?}"));
    }
}
