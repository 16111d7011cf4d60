//! Trajectory of a point mass under its weight and a quasi-steady force of the air:
//!
//! ```math
//! m \dot{\mathbf v} = m \mathbf g + \tfrac12 \rho\, |\mathbf u| \left(A_D\, \mathbf u + A_L\, |\mathbf u|\, \mathbf l\right),
//! \qquad \mathbf u = \mathbf w - \mathbf v
//! ```
//!
//! with the velocity $`\mathbf u`$ of the air past the mass, the wind $`\mathbf w`$ and the density $`\rho`$ at its height, drag area $`A_D`$,
//! lift area $`A_L`$ and the direction $`\mathbf l`$ of the lift, normal to $`\mathbf u`$. The canopy follows without delay: no added mass, no
//! swing. That is the limit of changes that are slow against $`m/(\rho A_D |\mathbf u|)`$, the time in which the mass takes its terminal speed.

use crate::frame_axes::FrameAxes;
use crate::geometry::Vec3;

/// Air at one place and time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// Density, kg/m3.
    pub density_kg_m3: f64,
    /// Wind over ground, m/s.
    pub wind_m_s: Vec3,
}

/// Force of the air on a canopy in steady descent, over the dynamic pressure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceAreas {
    /// $`A_D`$, m2.
    pub drag_m2: f64,
    /// $`A_L`$, m2.
    pub lift_m2: f64,
    /// Horizontal direction to which the lift pulls, of length 1.
    pub direction: [f64; 2],
}

impl ForceAreas {
    /// The areas whose force balances the weight $`m g`$ in a mean velocity `u` (m/s) of the air past the mass. In axes that hold it
    /// sideways only the vertical part of the force counts, and there is no lift. `None` where the air does not rise past the mass.
    pub fn in_equilibrium(weight_n: f64, density: f64, u: Vec3, axes: FrameAxes) -> Option<Self> {
        let (speed, across) = (u.norm(), u[0].hypot(u[1]));
        if !(u[2] > 0.0 && speed.is_finite() && density > 0.0) {
            return None;
        }
        let whole = weight_n / (0.5 * density * speed * speed);
        if axes != FrameAxes::All {
            let drag_m2 = whole * speed / u[2];
            return Some(Self { drag_m2, lift_m2: 0.0, direction: [1.0, 0.0] });
        }
        // The weight m g = D along u and L across it: D = m g cos, L = m g sin of the angle of u with the vertical.
        let direction = if across > 0.0 { [-u[0] / across, -u[1] / across] } else { [1.0, 0.0] };
        Some(Self { drag_m2: whole * u[2] / speed, lift_m2: whole * across / speed, direction })
    }

    /// Force (N) in air of `density` (kg/m3) that moves past the mass with `u` (m/s).
    pub fn force(&self, density: f64, u: Vec3) -> Vec3 {
        let speed = u.norm();
        let lift = match self.lift_m2 {
            0.0 => Vec3::zeros(),
            area => self.lift_direction(u) * (area * speed),
        };
        (u * self.drag_m2 + lift) * (0.5 * density * speed)
    }

    /// Unit vector normal to `u` in the plane of `u` and the horizontal direction of the lift; zero where both are parallel.
    fn lift_direction(&self, u: Vec3) -> Vec3 {
        let h = Vec3::new(self.direction[0], self.direction[1], 0.0);
        let normal = h - u * (h.dot(&u) / u.norm_squared().max(f64::MIN_POSITIVE));
        normal.try_normalize(1e-9).unwrap_or_default()
    }
}

/// A mass that falls with given areas.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FallingMass {
    /// Mass of payload, fabric and lines, kg.
    pub mass_kg: f64,
    /// Acceleration of gravity, m/s2.
    pub gravity_m_s2: f64,
    /// Force of the air.
    pub areas: ForceAreas,
    /// Directions in which it moves.
    pub axes: FrameAxes,
}

/// Position (m) and velocity (m/s) of a falling mass.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FallState {
    /// Position over ground.
    pub position: Vec3,
    /// Velocity over ground.
    pub velocity: Vec3,
}

/// Longest step as a share of the time in which the mass takes its terminal speed: the error of a step of fourth order is
/// below 1e-9 of the change of the speed.
const STEP_SHARE: f64 = 0.02;
/// Most steps in a window.
pub const MOST_STEPS: f64 = 1e5;

impl FallingMass {
    /// Acceleration (m/s2) in `air` at a velocity `v` (m/s); zero in directions in which the mass does not move.
    pub fn acceleration(&self, v: Vec3, air: &Air) -> Vec3 {
        let force = self.areas.force(air.density_kg_m3, air.wind_m_s - v);
        let free = force / self.mass_kg - Vec3::z() * self.gravity_m_s2;
        let moves = self.axes.range();
        Vec3::from_fn(|i, _| if moves.contains(&i) { free[i] } else { 0.0 })
    }

    /// State after `dt` seconds from time `t` (s), by the classical Runge-Kutta method of fourth order; `air` gives the air at a time (s) and
    /// a position (m). `None` where it takes more than [`MOST_STEPS`] steps, or is not finite.
    pub fn advance(
        &self,
        start: FallState,
        t: f64,
        dt: f64,
        air: impl Fn(f64, Vec3) -> Air,
    ) -> Option<FallState> {
        let here = air(t, start.position);
        // Rate at which a difference of the speed decays, 1/s, at the terminal speed or above it.
        let terminal = 2.0 * self.mass_kg * self.gravity_m_s2 * here.density_kg_m3 * self.areas.drag_m2;
        let u = (here.wind_m_s - start.velocity).norm() * here.density_kg_m3 * self.areas.drag_m2;
        let rate = u.max(terminal.sqrt()) / self.mass_kg;
        let steps = (dt * rate / STEP_SHARE).ceil().max(1.0);
        if steps.is_nan() || steps > MOST_STEPS {
            return None;
        }
        let h = dt / steps;
        let mut state = start;
        for k in 0..steps as u32 {
            state = self.step(state, t + f64::from(k) * h, h, &air);
        }
        let finite = |v: &Vec3| v.iter().all(|x| x.is_finite());
        (finite(&state.position) && finite(&state.velocity)).then_some(state)
    }

    fn step(&self, s: FallState, t: f64, h: f64, air: &impl Fn(f64, Vec3) -> Air) -> FallState {
        let rate = |share: f64, x: Vec3, v: Vec3| self.acceleration(v, &air(t + share * h, x));
        let (x, v) = (s.position, s.velocity);
        let (v1, a1) = (v, rate(0.0, x, v));
        let v2 = v + a1 * (0.5 * h);
        let a2 = rate(0.5, x + v1 * (0.5 * h), v2);
        let v3 = v + a2 * (0.5 * h);
        let a3 = rate(0.5, x + v2 * (0.5 * h), v3);
        let v4 = v + a3 * h;
        let a4 = rate(1.0, x + v3 * h, v4);
        FallState {
            position: x + (v1 + (v2 + v3) * 2.0 + v4) * (h / 6.0),
            velocity: v + (a1 + (a2 + a3) * 2.0 + a4) * (h / 6.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: f64 = 9.80665;
    const MASS: f64 = 106.6;

    fn mass(areas: ForceAreas, axes: FrameAxes) -> FallingMass {
        FallingMass { mass_kg: MASS, gravity_m_s2: G, areas, axes }
    }

    fn drag(drag_m2: f64) -> ForceAreas {
        ForceAreas { drag_m2, lift_m2: 0.0, direction: [1.0, 0.0] }
    }

    fn still(_: f64, _: Vec3) -> Air {
        Air { density_kg_m3: 1.225, wind_m_s: Vec3::zeros() }
    }

    /// From rest in uniform air: v = V tanh(g t / V), z = -(V^2/g) ln cosh(g t / V).
    #[test]
    fn fall_from_rest_follows_the_hyperbolic_tangent() {
        let m = mass(drag(30.0), FrameAxes::Vertical);
        let terminal = (2.0 * MASS * G / (1.225 * 30.0)).sqrt();
        let mut state = FallState::default();
        for k in 0..20 {
            state = m.advance(state, 0.05 * f64::from(k), 0.05, still).expect("a short window");
        }
        let x = G / terminal;
        assert!((state.velocity[2] + terminal * x.tanh()).abs() < 1e-8 * terminal, "{state:?}");
        let fallen = terminal * terminal / G * x.cosh().ln();
        assert!((state.position[2] + fallen).abs() < 1e-8 * fallen, "{state:?}");
    }

    /// The areas of a velocity hold that velocity: drag alone, with glide and wind, and held sideways.
    #[test]
    fn areas_in_equilibrium_hold_the_velocity() {
        let air = Air { density_kg_m3: 0.9, wind_m_s: Vec3::new(3.0, -1.0, 0.2) };
        for (v, axes) in [
            (Vec3::new(3.0, -1.0, -4.5), FrameAxes::All),
            (Vec3::new(1.0, 1.5, -4.5), FrameAxes::All),
            (Vec3::new(0.0, 0.0, -4.5), FrameAxes::Vertical),
        ] {
            let u = air.wind_m_s - v;
            let areas = ForceAreas::in_equilibrium(MASS * G, 0.9, u, axes).expect("a descent");
            let m = mass(areas, axes);
            assert!(m.acceleration(v, &air).norm() < 1e-13 * G, "{v} {areas:?}");
            let start = FallState { position: Vec3::zeros(), velocity: v };
            let end = m.advance(start, 0.0, 60.0, |_, _| air).expect("a window");
            assert!((end.velocity - v).norm() < 1e-11, "{} {v}", end.velocity);
            assert!((end.position - v * 60.0).norm() < 1e-9, "{}", end.position);
        }
        let rising = Vec3::new(0.0, 0.0, -1.0);
        assert_eq!(ForceAreas::in_equilibrium(1.0, 1.0, rising, FrameAxes::All), None);
    }

    /// Glide ratio = lift over drag, to the side of the lift; its speed sqrt(2 m g / (rho A)) with A of both.
    #[test]
    fn glide_has_the_ratio_of_lift_to_drag() {
        let areas = ForceAreas { drag_m2: 40.0, lift_m2: 10.0, direction: [0.6, -0.8] };
        let m = mass(areas, FrameAxes::All);
        let end = m.advance(FallState::default(), 0.0, 30.0, still).expect("a window").velocity;
        assert!((end[0].hypot(end[1]) / -end[2] - 0.25).abs() < 1e-9, "{end}");
        assert!((end[0] / 0.6 - end[1] / -0.8).abs() < 1e-9 && end[0] > 0.0, "{end}");
        let speed = (2.0 * MASS * G / (1.225 * 40.0f64.hypot(10.0))).sqrt();
        assert!((end.norm() - speed).abs() < 1e-9 * speed, "{}", end.norm());
    }

    /// A window in which the fall cannot be resolved has no end.
    #[test]
    fn windows_of_too_many_steps_are_refused() {
        let m = mass(drag(30.0), FrameAxes::Vertical);
        assert!(m.advance(FallState::default(), 0.0, 100.0, still).is_some());
        assert_eq!(m.advance(FallState::default(), 0.0, 1e4, still), None);
        assert_eq!(m.advance(FallState::default(), 0.0, f64::NAN, still), None);
    }

    /// In air whose density changes slowly the speed follows sqrt(2 m g / (rho A)), late by the inertia: with
    /// rho = rho_0 exp(-z/H) the terminal speed w obeys w w' (d/dz) = -w^2/(2H), so that v^2 = w^2 (1 + w^2/(2 g H) ...)
    /// on the way down.
    #[test]
    fn speed_follows_the_density() {
        let scale = 8_500.0;
        let air =
            |_: f64, x: Vec3| Air { density_kg_m3: 1.225 * (-x[2] / scale).exp(), wind_m_s: Vec3::zeros() };
        let m = mass(drag(74.0), FrameAxes::Vertical);
        let start = FallState { position: Vec3::z() * 3_000.0, velocity: Vec3::z() * -5.0 };
        let mut state = start;
        for k in 0..50 {
            state = m.advance(state, 10.0 * f64::from(k), 10.0, air).expect("a window");
        }
        let density = air(0.0, state.position).density_kg_m3;
        let terminal = (2.0 * MASS * G / (density * 74.0)).sqrt();
        let late = terminal * (1.0 + 0.5 * terminal * terminal / (2.0 * G * scale));
        assert!(state.position[2] > 100.0 && state.position[2] < 1_000.0, "{state:?}");
        assert!((-state.velocity[2] / late - 1.0).abs() < 1e-6, "{} {late} {terminal}", state.velocity[2]);
    }
}
