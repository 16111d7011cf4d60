//! Ideal gas, with and without its energy equation.

use mesh::lanes::Real;
use nalgebra::Vector3;

use crate::geometry::vec3::Vec3;

/// Undisturbed air.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Density, kg/m3.
    pub density: f64,
    /// Temperature, K.
    pub temperature: f64,
    /// Gas constant, J/(kg K).
    pub gas_constant: f64,
    /// Ratio of specific heats.
    pub gamma: f64,
}

impl Air {
    /// Dry air of the given density (kg/m3) and temperature (K).
    pub fn new(density: f64, temperature: f64) -> Self {
        Self { density, temperature, gas_constant: case::GAS_CONSTANT, gamma: case::HEAT_RATIO }
    }

    /// Absolute pressure of the undisturbed air, Pa.
    pub fn pressure(&self) -> f64 {
        self.density * self.gas_constant * self.temperature
    }
}

/// Equations of state and the conserved quantities of a model with `N` equations.
pub trait Gas<const N: usize>: Copy + 'static {
    /// Undisturbed air moving at `wind`, m/s.
    fn undisturbed(&self, wind: Vec3) -> [f64; N];
    /// Density, kg/m3.
    fn density<T: Real>(&self, q: &[T; N]) -> T;
    /// Squared speed of sound of the model, m2/s2.
    fn sound_speed_squared<T: Real>(&self, q: &[T; N]) -> T;
    /// What a unit of mass carries into its volume: 1, velocity[, energy, J/kg].
    fn stored(&self, q: &[f64; N]) -> [f64; N];
    /// What a unit of mass carries through a face: 1, velocity[, enthalpy, J/kg].
    fn carried<T: Real>(&self, q: &[T; N]) -> [T; N];
    /// Momentum (and work) that gauge pressure `p` passes through a face of area
    /// vector `area` that sweeps `grid_flux` (m3/s).
    fn pressure_flux<T: Real>(&self, p: T, area: Vector3<T>, grid_flux: T) -> [T; N];
    /// Change of the pressure's part of the flux when pressure alone changes by
    /// `dp`, through an area vector that the air crosses at `volume_flux` (m3/s).
    fn pressure_change(&self, dp: f64, area: Vec3, volume_flux: f64) -> [f64; N];
    /// Residual of the conserved quantities turned into that of the primitive
    /// ones: continuity, then $`\rho\,DQ/Dt`$ (its energy row is divided by c_p).
    fn primitive_residual(&self, q: &[f64; N], r: &[f64; N]) -> [f64; N];
    /// Change of the other unknowns that a change of pressure by 1 Pa brings at
    /// once (adiabatic compression); zero for the velocity.
    fn compression(&self, q: &[f64; N]) -> [f64; N];
    /// $`\partial W/\partial Q`$: rows are conserved quantities.
    #[inline(always)]
    fn jacobian(&self, q: &[f64; N]) -> [[f64; N]; N] {
        self.time_matrix(q, None)
    }
    /// $`\partial W/\partial Q`$ with $`\partial\rho/\partial p`$ replaced, where
    /// given: the Weiss-Smith matrix.
    fn time_matrix(&self, q: &[f64; N], compressibility: Option<f64>) -> [[f64; N]; N];
    /// Heat flux into the energy row for a temperature gradient along the face:
    /// `conductivity * gradient`; nothing without an energy equation.
    fn conduction<T: Real>(&self, viscosity: T, gradient: impl Fn(usize) -> T, work: T) -> [T; N];
}

/// Four equations: temperature stays that of the undisturbed air,
/// $`\rho = \rho_\infty + p'/(R T_\infty)`$.
#[derive(Clone, Copy, Debug)]
pub struct Isothermal {
    density: f64,
    inverse_rt: f64,
}

impl Isothermal {
    /// From the undisturbed air.
    pub fn new(air: Air) -> Self {
        Self { density: air.density, inverse_rt: 1.0 / (air.gas_constant * air.temperature) }
    }
}

impl Gas<4> for Isothermal {
    fn undisturbed(&self, wind: Vec3) -> [f64; 4] {
        [0.0, wind[0], wind[1], wind[2]]
    }
    #[inline(always)]
    fn density<T: Real>(&self, q: &[T; 4]) -> T {
        T::splat(self.density) + q[0] * T::splat(self.inverse_rt)
    }
    #[inline(always)]
    fn sound_speed_squared<T: Real>(&self, _: &[T; 4]) -> T {
        T::splat(1.0 / self.inverse_rt)
    }
    #[inline(always)]
    fn stored(&self, q: &[f64; 4]) -> [f64; 4] {
        [1.0, q[1], q[2], q[3]]
    }
    #[inline(always)]
    fn carried<T: Real>(&self, q: &[T; 4]) -> [T; 4] {
        [T::splat(1.0), q[1], q[2], q[3]]
    }
    #[inline(always)]
    fn pressure_flux<T: Real>(&self, p: T, area: Vector3<T>, _: T) -> [T; 4] {
        [T::splat(0.0), p * area[0], p * area[1], p * area[2]]
    }
    #[inline(always)]
    fn pressure_change(&self, dp: f64, area: Vec3, _: f64) -> [f64; 4] {
        [0.0, dp * area[0], dp * area[1], dp * area[2]]
    }
    #[inline(always)]
    fn primitive_residual(&self, q: &[f64; 4], r: &[f64; 4]) -> [f64; 4] {
        [r[0], r[1] - q[1] * r[0], r[2] - q[2] * r[0], r[3] - q[3] * r[0]]
    }
    #[inline(always)]
    fn compression(&self, _: &[f64; 4]) -> [f64; 4] {
        [1.0, 0.0, 0.0, 0.0]
    }
    #[inline(always)]
    fn time_matrix(&self, q: &[f64; 4], compressibility: Option<f64>) -> [[f64; 4]; 4] {
        let rho = self.density(q);
        let k = compressibility.unwrap_or(self.inverse_rt);
        let mut m = [[0.0; 4]; 4];
        m[0][0] = k;
        for d in 1..4 {
            m[d][0] = q[d] * k;
            m[d][d] = rho;
        }
        m
    }
    #[inline(always)]
    fn conduction<T: Real>(&self, _: T, _: impl Fn(usize) -> T, _: T) -> [T; 4] {
        [T::splat(0.0); 4]
    }
}

/// Five equations: ideal gas with energy. Temperature is kept as its difference
/// from the undisturbed air, energy is measured from the same state.
#[derive(Clone, Copy, Debug)]
pub struct IdealGas {
    air: Air,
    pressure: f64,
    cv: f64,
    cp: f64,
}

/// Prandtl number of air.
const PRANDTL: f64 = 0.72;

impl IdealGas {
    /// From the undisturbed air.
    pub fn new(air: Air) -> Self {
        let cv = air.gas_constant / (air.gamma - 1.0);
        Self { air, pressure: air.pressure(), cv, cp: cv + air.gas_constant }
    }

    #[inline(always)]
    fn temperature<T: Real>(&self, q: &[T; 5]) -> T {
        T::splat(self.air.temperature) + q[4]
    }

    #[inline(always)]
    fn energy<T: Real>(&self, q: &[T; 5]) -> T {
        T::splat(self.cv) * q[4] + T::splat(0.5) * (q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    }
}

impl Gas<5> for IdealGas {
    fn undisturbed(&self, wind: Vec3) -> [f64; 5] {
        [0.0, wind[0], wind[1], wind[2], 0.0]
    }
    #[inline(always)]
    fn density<T: Real>(&self, q: &[T; 5]) -> T {
        (T::splat(self.pressure) + q[0]) / (T::splat(self.air.gas_constant) * self.temperature(q))
    }
    #[inline(always)]
    fn sound_speed_squared<T: Real>(&self, q: &[T; 5]) -> T {
        T::splat(self.air.gamma * self.air.gas_constant) * self.temperature(q)
    }
    #[inline(always)]
    fn stored(&self, q: &[f64; 5]) -> [f64; 5] {
        [1.0, q[1], q[2], q[3], self.energy(q)]
    }
    #[inline(always)]
    fn carried<T: Real>(&self, q: &[T; 5]) -> [T; 5] {
        // H = E + p / rho
        let enthalpy = self.energy(q) + T::splat(self.air.gas_constant) * self.temperature(q);
        [T::splat(1.0), q[1], q[2], q[3], enthalpy]
    }
    #[inline(always)]
    fn pressure_flux<T: Real>(&self, p: T, area: Vector3<T>, grid_flux: T) -> [T; 5] {
        let absolute = T::splat(self.pressure) + p;
        [T::splat(0.0), p * area[0], p * area[1], p * area[2], absolute * grid_flux]
    }
    #[inline(always)]
    fn pressure_change(&self, dp: f64, area: Vec3, volume_flux: f64) -> [f64; 5] {
        [0.0, dp * area[0], dp * area[1], dp * area[2], dp * volume_flux]
    }
    #[inline(always)]
    fn primitive_residual(&self, q: &[f64; 5], r: &[f64; 5]) -> [f64; 5] {
        let m = [r[1] - q[1] * r[0], r[2] - q[2] * r[0], r[3] - q[3] * r[0]];
        let h = self.carried(q)[4];
        let e = r[4] - h * r[0] - (q[1] * m[0] + q[2] * m[1] + q[3] * m[2]);
        [r[0], m[0], m[1], m[2], e / self.cp]
    }
    #[inline(always)]
    fn compression(&self, q: &[f64; 5]) -> [f64; 5] {
        [1.0, 0.0, 0.0, 0.0, 1.0 / (self.density(q) * self.cp)]
    }
    #[inline(always)]
    fn time_matrix(&self, q: &[f64; 5], compressibility: Option<f64>) -> [[f64; 5]; 5] {
        let rho = self.density(q);
        let t = self.temperature(q);
        let k = compressibility.unwrap_or(1.0 / (self.air.gas_constant * t));
        let rho_t = -rho / t;
        let e = self.energy(q);
        let h = e + self.air.gas_constant * t;
        let mut m = [[0.0; 5]; 5];
        (m[0][0], m[0][4]) = (k, rho_t);
        for d in 1..4 {
            m[d][0] = q[d] * k;
            m[d][d] = rho;
            m[d][4] = q[d] * rho_t;
            m[4][d] = rho * q[d];
        }
        // rho E = rho H - p
        m[4][0] = h * k - 1.0;
        m[4][4] = h * rho_t + rho * self.cp;
        m
    }
    #[inline(always)]
    fn conduction<T: Real>(&self, viscosity: T, gradient: impl Fn(usize) -> T, work: T) -> [T; 5] {
        let [zero, cp, prandtl] = [0.0, self.cp, PRANDTL].map(T::splat);
        [zero, zero, zero, zero, viscosity * cp / prandtl * gradient(4) + work]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn conserved<const N: usize>(gas: &impl Gas<N>, q: &[f64; N]) -> [f64; N] {
        let rho = gas.density(q);
        gas.stored(q).map(|s| rho * s)
    }

    fn check_jacobian<const N: usize>(gas: &impl Gas<N>, q: [f64; N]) {
        let m = gas.jacobian(&q);
        for c in 0..N {
            let h = [10.0, 0.01, 0.01, 0.01, 0.01][c];
            let (mut a, mut b) = (q, q);
            a[c] -= h;
            b[c] += h;
            let (wa, wb) = (conserved(gas, &a), conserved(gas, &b));
            for r in 0..N {
                let difference = (wb[r] - wa[r]) / (2.0 * h);
                let scale = 1e-6 * (m[r][c].abs() + difference.abs()) + 1e-9;
                assert!((difference - m[r][c]).abs() < scale, "{r} {c}: {difference} {}", m[r][c]);
            }
        }
    }

    #[test]
    fn jacobians_match_finite_differences() {
        let air = Air::new(1.225, 288.15);
        check_jacobian(&Isothermal::new(air), [120.0, 3.0, -2.0, 5.0]);
        check_jacobian(&IdealGas::new(air), [120.0, 3.0, -2.0, 5.0, 1.3]);
    }

    /// The primitive residual undoes the Jacobian: dW = M dQ returns rho dQ
    /// apart from the pressure work, which continuity and compression carry.
    #[test]
    fn primitive_residual_decouples_the_unknowns() {
        let air = Air::new(1.225, 288.15);
        let gas = IdealGas::new(air);
        let q = [120.0, 3.0, -2.0, 5.0, 1.3];
        let dq = [7.0, 0.1, 0.2, -0.3, 0.4];
        let m = gas.jacobian(&q);
        let dw: [f64; 5] = std::array::from_fn(|r| (0..5).map(|c| m[r][c] * dq[c]).sum());
        let r = gas.primitive_residual(&q, &dw);
        let rho = gas.density(&q);
        for d in 1..4 {
            assert!((r[d] - rho * dq[d]).abs() < 1e-10);
        }
        let temperature = r[4] / rho + gas.compression(&q)[4] * dq[0];
        assert!((temperature - dq[4]).abs() < 1e-8, "{temperature}");

        let gas = Isothermal::new(air);
        let (q, dq) = ([120.0, 3.0, -2.0, 5.0], [7.0, 0.1, 0.2, -0.3]);
        let m = gas.jacobian(&q);
        let dw: [f64; 4] = std::array::from_fn(|r| (0..4).map(|c| m[r][c] * dq[c]).sum());
        let r = gas.primitive_residual(&q, &dw);
        assert!((r[0] - dq[0] / gas.sound_speed_squared(&q)).abs() < 1e-14);
        for d in 1..4 {
            assert!((r[d] - gas.density(&q) * dq[d]).abs() < 1e-12, "{r:?}");
        }
    }

    /// Flux of the state `q` through `s`, which sweeps `grid_flux`.
    fn flux<const N: usize>(gas: &impl Gas<N>, q: &[f64; N], s: Vec3, grid_flux: f64) -> [f64; N] {
        let mass = gas.density(q) * (q[1] * s[0] + q[2] * s[1] + q[3] * s[2] - grid_flux);
        let (carried, push) = (gas.carried(q), gas.pressure_flux(q[0], s, grid_flux));
        std::array::from_fn(|v| mass * carried[v] + push[v])
    }

    /// What is stored moves with the air, pressure pushes at the area and works at the speed of the air: `W (u . s - w)
    /// + (0, p s, p_absolute u . s)`, but for the push of the undisturbed pressure.
    fn check_flux<const N: usize>(gas: &impl Gas<N>, q: [f64; N], air: Air) {
        let (s, grid_flux) = (Vec3::new(0.7, -1.2, 0.4), 0.9);
        let volume_flux = q[1] * s[0] + q[2] * s[1] + q[3] * s[2];
        let (found, stored) = (flux(gas, &q, s, grid_flux), conserved(gas, &q));
        for v in 0..N {
            let work = (air.pressure() + q[0]) * volume_flux;
            let push = [0.0, q[0] * s[0], q[0] * s[1], q[0] * s[2], work][v];
            let exact = stored[v] * (volume_flux - grid_flux) + push;
            assert!((found[v] - exact).abs() < 1e-9 * exact.abs().max(1.0), "{v}: {} {exact}", found[v]);
        }
        // Its derivative: what moves, what more passes, what pressure gains.
        let dq: [f64; N] = std::array::from_fn(|v| [3.0, 0.2, -0.1, 0.3, 0.5][v]);
        let moved = |h: f64| std::array::from_fn(|v| q[v] + h * dq[v]);
        let h = 1e-3;
        let (a, b) = (flux(gas, &moved(-h), s, grid_flux), flux(gas, &moved(h), s, grid_flux));
        let (m, carried) = (gas.jacobian(&q), gas.carried(&q));
        let inflow = gas.density(&q) * (dq[1] * s[0] + dq[2] * s[1] + dq[3] * s[2]);
        let push = gas.pressure_change(dq[0], s, volume_flux);
        for v in 0..N {
            let exact = (b[v] - a[v]) / (2.0 * h);
            let row: f64 = (0..N).map(|c| m[v][c] * dq[c]).sum();
            let found = (volume_flux - grid_flux) * row + inflow * carried[v] + push[v];
            assert!((found - exact).abs() < 1e-6 * exact.abs().max(1.0), "{v}: {found} {exact}");
        }
    }

    /// Density follows pressure with `1 / c^2` where air is compressed without heat: in isothermal air at one
    /// temperature.
    fn check_sound<const N: usize>(gas: &impl Gas<N>, q: [f64; N]) {
        let way = gas.compression(&q);
        let at = |h: f64| gas.density(&std::array::from_fn(|v| q[v] + h * way[v]));
        let slope = (at(1.0) - at(-1.0)) / 2.0;
        assert!((slope * gas.sound_speed_squared(&q) - 1.0).abs() < 1e-6, "{slope}");
        assert!(way[1..4] == [0.0; 3] && way[0] == 1.0);
    }

    #[test]
    fn convective_and_pressure_fluxes_match_their_derivatives() {
        let air = Air::new(1.225, 288.15);
        check_flux(&Isothermal::new(air), [120.0, 3.0, -2.0, 5.0], air);
        check_flux(&IdealGas::new(air), [120.0, 3.0, -2.0, 5.0, 1.3], air);
        check_sound(&Isothermal::new(air), [120.0, 3.0, -2.0, 5.0]);
        check_sound(&IdealGas::new(air), [120.0, 3.0, -2.0, 5.0, 30.0]);
        assert!((air.pressure() - 1.225 * 287.05 * 288.15).abs() < 1e-8);
        assert!((Isothermal::new(air).sound_speed_squared(&[0.0f64; 4]) - 287.05 * 288.15).abs() < 1e-6);
        let cp = 3.5 * 287.05;
        let heat = IdealGas::new(air).conduction(2e-5, |v| if v == 4 { 30.0 } else { f64::NAN }, 0.25);
        assert!((heat[4] - (2e-5 * cp / 0.72 * 30.0 + 0.25)).abs() < 1e-12, "{heat:?}");
    }
}
