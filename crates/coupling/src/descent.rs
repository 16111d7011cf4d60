//! The frame: one degree of freedom, or three.
//!
//! The frame is fixed to the payload and does not rotate. Its equation is the momentum of the whole system over a window of
//! length $`T`$, with $`\mathbf v`$ the velocity of the frame (z upwards, so the descent speed is $`-v_z`$) and
//! $`\mathbf g`$ the acceleration of gravity, $`(0, 0, -g)`$:
//!
//! ```math
//! m\,(\mathbf v^{n+1} - \mathbf v^n) = (\bar{\mathbf S} + \mathbf D + m \mathbf g)\,T, \qquad
//! \bar{\mathbf S}\,T = \int \mathbf F\,dt - \Delta \mathbf p .
//! ```
//!
//! It is solved in the axes in which the frame moves (`descent.motion`): the vertical one, in which case the payload is held
//! sideways, or all three. The frame does not rotate: a payload that does is a body of the structure in it, and canopy and
//! grid turn in it.
//!
//! $`m`$ is the mass of payload, fabric, lines and points; $`\mathbf F`$ the external force on fabric and lines,
//! $`\mathbf p`$ their momentum relative to the frame, $`\mathbf D`$ the drag of a payload that is a point. The added mass
//! of the air is part of the resolved flow and is not added here. The structure reports the mean force $`\bar{\mathbf R}`$
//! on the payload ([`structure_stats::SUPPORT_FORCE`]):
//!
//! - Where weight and inertia of the frame act on the structure (`[fabric_gravity]`),
//!   $`\bar{\mathbf S} = \bar{\mathbf R} + m_s (\dot{\mathbf v} - \mathbf g)`$ with $`m_s`$ the mass without the
//!   payload: the equation is $`m_p \dot{\mathbf v} = \bar{\mathbf R} + \mathbf D + m_p \mathbf g`$. Of its two forms,
//!   the one used needs only the share $`m_s/m < 1`$ of the acceleration that the structure was given.
//! - Elsewhere $`\bar{\mathbf S} = \bar{\mathbf R}`$: fabric and lines have no weight in the structure's equations, so
//!   the whole mass is the frame's.
//! - A payload with six degrees of freedom has all weight and inertia in the structure's equations: the frame
//!   follows its centre of mass, $`m_p \dot{\mathbf v} = \bar{\mathbf R} + m_p \mathbf g`$ with its drag in
//!   $`\bar{\mathbf R}`$. In axes in which the frame does not move, the body moves in the frame.
//!
//! The mean is that of the impulse, so the momentum of the system changes by the external impulse to round-off.
//!
//! The paper's equation 9 takes $`\mathbf F`$ at the end of the window for $`\bar{\mathbf S}`$ (`descent.equation = "quasi-steady"`):
//! the limit in which the canopy has no acceleration relative to the frame. (The second line of equation 9 in print
//! repeats the acceleration on its left side; this is the implicit Euler step that it means.)

use case::{DescentEquation, FrameMotion, Scene};
use channel::{Stats, structure_stats};

use crate::frame_axes::FrameAxes;
use crate::geometry::Vec3;
use crate::interface::CanopyInterface;

/// Masses, gravity, and the reference values of the drag coefficient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DescentModel {
    /// Mass of payload, fabric, lines and points, kg.
    pub mass_kg: f64,
    /// Mass of the payload alone, kg.
    pub payload_kg: f64,
    /// Equation of the frame.
    pub equation: DescentEquation,
    /// Where weight and inertia of the frame act.
    pub weight: Weight,
    /// Axes in which the frame moves.
    pub axes: FrameAxes,
    /// Acceleration of gravity, m/s2.
    pub gravity_m_s2: f64,
    /// Area of the drag coefficient, m2.
    pub reference_area_m2: f64,
    /// Speed of the drag coefficient ($`V_\infty`$: the initial descent speed), m/s.
    pub reference_speed_m_s: f64,
    /// Density of the undisturbed air, kg/m3.
    pub air_density_kg_m3: f64,
    /// Drag of a point payload that moves with the frame; `None`: no drag.
    pub payload_drag: Option<PayloadDrag>,
    /// The structure reports the drag of lines and payload with each response.
    pub drag_in_structure: bool,
    /// The structure reports the force on the payload.
    pub support_known: bool,
}

/// Which parts of the system have weight, and inertia of the frame, in the structure's equations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weight {
    /// None: the whole mass is the frame's.
    Frame,
    /// Fabric, lines and points.
    Structure,
    /// Fabric, lines and points, and the payload as a body of its own.
    Body,
}

/// Forces of a window in the equation of the frame.
#[derive(Clone, Copy, Debug)]
pub struct WindowForces<'a> {
    /// Force of the air on the canopy at the end of the window, N.
    pub canopy: Vec3,
    /// Statistics of the structure's last solve.
    pub structure: &'a Stats,
    /// Mean acceleration of the frame in that solve, m/s2.
    pub frame_acceleration: Vec3,
}

/// Drag of the air on the payload, `1/2 rho (C A) |w| w`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PayloadDrag {
    /// Half the density times the drag area, kg/m.
    pub half_density_area: f64,
    /// Wind at the end of the step, m/s.
    pub wind_m_s: [f64; 3],
}

impl PayloadDrag {
    /// Drag at the velocity `v` (m/s), N.
    pub fn force(&self, v: Vec3) -> Vec3 {
        let w = Vec3::from(self.wind_m_s) - v;
        w * (self.half_density_area * w.norm())
    }

    /// Velocity at the end of a step (m/s) that without this drag would be `free`, for a mass `m` (kg): the drag is
    /// evaluated at the end of the step, like all forces of the descent. The relative wind $`\mathbf w`$ is parallel to
    /// the one without drag, and its size $`s`$ solves $`s + c s^2 = |\mathbf w_{free}|`$.
    fn slowed(&self, free: Vec3, m: f64, dt: f64) -> Vec3 {
        let wind = Vec3::from(self.wind_m_s);
        let relative = wind - free;
        let c = self.half_density_area * dt / m;
        wind - relative * (2.0 / (1.0 + (1.0 + 4.0 * c * relative.norm()).sqrt()))
    }

    /// The same where only the vertical velocity changes.
    fn slowed_vertically(&self, free: f64, m: f64, dt: f64) -> f64 {
        let [x, y, z] = self.wind_m_s;
        let c = self.half_density_area * dt / m;
        let goal = z - free;
        // r + c |w| r = goal with r the vertical part of the relative wind w: monotone and
        // convex on either side of zero, so Newton's method from the far side converges.
        let mut r = goal;
        for _ in 0..60 {
            let size = (x * x + y * y + r * r).sqrt();
            if size == 0.0 {
                break;
            }
            let step = (r + c * size * r - goal) / (1.0 + c * (size + r * r / size));
            r -= step;
            if step.abs() <= 1e-15 * goal.abs() {
                break;
            }
        }
        z - r
    }
}

impl DescentModel {
    /// The descent equation of a scene with the mass of its canopy, if it has one.
    pub fn of(scene: &Scene, interface: &CanopyInterface) -> Option<Self> {
        scene.descent.as_ref().map(|d| Self {
            mass_kg: d.payload_mass_kg + interface.masses.suspended(),
            payload_kg: d.payload_mass_kg,
            equation: d.equation,
            axes: match d.frame_motion() {
                FrameMotion::Vertical => FrameAxes::Vertical,
                FrameMotion::ThreeDimensional => FrameAxes::All,
            },
            weight: match (&d.body, &scene.fabric_gravity) {
                (Some(_), _) => Weight::Body,
                (None, Some(_)) => Weight::Structure,
                (None, None) => Weight::Frame,
            },
            gravity_m_s2: d.gravity_m_s2,
            reference_area_m2: d.reference_area_m2,
            reference_speed_m_s: d.initial_speed_m_s,
            air_density_kg_m3: scene.resolved().air.density_kg_m3,
            payload_drag: d.payload_drag.as_ref().filter(|_| d.body.is_none()).map(|p| PayloadDrag {
                half_density_area: 0.5 * scene.resolved().air.density_kg_m3 * p.drag_area_m2,
                wind_m_s: scene.resolved().wind_m_s,
            }),
            drag_in_structure: scene.structure_meets_wind(),
            support_known: true,
        })
    }

    /// Acceleration of gravity as a vector, m/s2.
    fn gravity(&self) -> Vec3 {
        Vec3::new(0.0, 0.0, -self.gravity_m_s2)
    }

    /// Velocity of the frame at the end of a window of `dt` seconds that started with `velocity`, m/s.
    pub fn end_velocity(&self, velocity: [f64; 3], forces: &WindowForces<'_>, dt: f64) -> [f64; 3] {
        let (force, mass) = match self.equation {
            DescentEquation::QuasiSteady => (self.force(forces.canopy, forces.structure), self.mass_kg),
            DescentEquation::Momentum => self.support(forces),
        };
        self.step(velocity, force, mass, dt)
    }

    /// Force (N) and mass (kg) of the frame in the momentum equation.
    pub fn support(&self, forces: &WindowForces<'_>) -> (Vec3, f64) {
        let support = vector(forces.structure, structure_stats::SUPPORT_FORCE);
        match self.weight {
            Weight::Frame => (support, self.mass_kg),
            Weight::Structure => {
                let suspended = self.mass_kg - self.payload_kg;
                (support + (forces.frame_acceleration - self.gravity()) * suspended, self.mass_kg)
            }
            Weight::Body => (support, self.payload_kg),
        }
    }

    /// Velocity (m/s) at the end of a window of `dt` seconds that started with `velocity`, under a `force` (N) on a `mass`
    /// (kg). In axes in which the frame does not move it stays.
    pub fn step(&self, velocity: [f64; 3], force: Vec3, mass: f64, dt: f64) -> [f64; 3] {
        let start = Vec3::from(velocity);
        let free = start + (force / mass + self.gravity()) * dt;
        let end = match (&self.payload_drag, self.axes) {
            (None, _) => free,
            (Some(drag), FrameAxes::All) => drag.slowed(free, mass, dt),
            (Some(drag), _) => Vec3::z() * drag.slowed_vertically(free[2], mass, dt),
        };
        let moves = self.axes.range();
        std::array::from_fn(|i| if moves.contains(&i) { end[i] } else { start[i] })
    }

    /// Force of the air on the falling system, N: `canopy` on the canopy, plus that on lines and a moving payload as the
    /// structure reports it.
    pub fn force(&self, canopy: Vec3, structure: &Stats) -> Vec3 {
        canopy + self.air_on_lines(structure)
    }

    /// Force of the air on lines and a moving payload, N.
    pub fn air_on_lines(&self, structure: &Stats) -> Vec3 {
        if self.drag_in_structure { vector(structure, structure_stats::AIR_FORCE) } else { Vec3::zeros() }
    }

    /// Drag coefficient on the reference area and the *initial* speed, as in the paper; `None` where that is zero.
    pub fn drag_coefficient(&self, force_z: f64) -> Option<f64> {
        let scale = 0.5
            * self.air_density_kg_m3
            * self.reference_speed_m_s
            * self.reference_speed_m_s
            * self.reference_area_m2;
        scale.is_normal().then(|| force_z / scale)
    }
}

/// A statistic of three numbers from index `at` on.
pub(crate) fn vector(stats: &Stats, at: usize) -> Vec3 {
    Vec3::from_column_slice(&stats.values[at..at + 3])
}

#[cfg(test)]
mod tests {
    use super::*;

    const ATPS: DescentModel = DescentModel {
        mass_kg: 106.614,
        payload_kg: 100.6975,
        equation: DescentEquation::QuasiSteady,
        weight: Weight::Frame,
        axes: FrameAxes::Vertical,
        gravity_m_s2: 9.80665,
        reference_area_m2: 41.3614,
        reference_speed_m_s: 4.8768,
        air_density_kg_m3: 1.225,
        payload_drag: None,
        drag_in_structure: false,
        support_known: true,
    };

    /// Velocity (m/s) after a step of `dt` (s) under a vertical force (N) on the whole mass, from a vertical one.
    fn fall(model: &DescentModel, velocity: f64, force: f64, dt: f64) -> f64 {
        model.step([0.0, 0.0, velocity], Vec3::new(0.0, 0.0, force), model.mass_kg, dt)[2]
    }

    /// A sphere in free fall: terminal speed sqrt(2 m g / (rho C A)). It drifts with the wind; across the wind its
    /// drag grows with the whole relative speed.
    #[test]
    fn drag_has_no_coefficient_at_zero_speed() {
        assert_eq!(DescentModel { reference_speed_m_s: 0.0, ..ATPS }.drag_coefficient(-3.0), None);
    }

    #[test]
    fn payload_without_canopy_reaches_its_terminal_speed() {
        let drag = PayloadDrag { half_density_area: 0.5 * 1.225 * 0.8, wind_m_s: [0.0; 3] };
        let model = DescentModel { payload_drag: Some(drag), ..ATPS };
        let mut v = 0.0;
        (0..4000).for_each(|_| v = fall(&model, v, 0.0, 0.05));
        let terminal = (ATPS.mass_kg * ATPS.gravity_m_s2 / drag.half_density_area).sqrt();
        assert!((v / -terminal - 1.0).abs() < 1e-12, "{v} {terminal}");
        // Rising in an updraught that is faster than the terminal speed.
        let up = PayloadDrag { wind_m_s: [0.0, 0.0, 2.0 * terminal], ..drag };
        let model = DescentModel { payload_drag: Some(up), ..ATPS };
        (0..4000).for_each(|_| v = fall(&model, v, 0.0, 0.05));
        assert!((v / terminal - 1.0).abs() < 1e-12, "{v}");
        let across = PayloadDrag { wind_m_s: [30.0, 0.0, 0.0], ..drag };
        let model = DescentModel { payload_drag: Some(across), ..ATPS };
        let mut w = 0.0;
        (0..4000).for_each(|_| w = fall(&model, w, 0.0, 0.05));
        let force = drag.half_density_area * (w * w + 900.0).sqrt() * -w;
        assert!((force / (ATPS.mass_kg * ATPS.gravity_m_s2) - 1.0).abs() < 1e-10, "{w}");
    }

    #[test]
    fn drag_of_lines_is_taken_from_the_structure_statistics() {
        let mut stats = Stats::default();
        stats.values[structure_stats::AIR_FORCE..][..3].copy_from_slice(&[1.0, -2.0, 12.5]);
        let canopy = Vec3::new(3.0, 4.0, 100.0);
        assert_eq!(ATPS.force(canopy, &stats), canopy);
        let model = DescentModel { drag_in_structure: true, ..ATPS };
        assert_eq!(model.force(canopy, &stats), Vec3::new(4.0, 2.0, 112.5));
    }

    /// Force and mass of the frame with weight and inertia in the frame, in the structure and in a body.
    #[test]
    fn frame_force_and_mass_match_the_weight_model() {
        let mut structure = Stats::default();
        let at = structure_stats::SUPPORT_FORCE;
        structure.values[at..at + 3].copy_from_slice(&[30.0, -20.0, 100.0]);
        let support = Vec3::new(30.0, -20.0, 100.0);
        let canopy = Vec3::new(50.0, 0.0, 700.0);
        let forces =
            WindowForces { canopy, structure: &structure, frame_acceleration: Vec3::new(0.5, 0.0, -2.0) };
        let of = |weight| DescentModel { weight, equation: DescentEquation::Momentum, ..ATPS };
        assert_eq!(of(Weight::Frame).support(&forces), (support, 106.614));
        assert_eq!(of(Weight::Body).support(&forces), (support, 100.6975));
        // 5.9165 kg of fabric and lines in a frame that takes 2 m/s2 off gravity and accelerates along x.
        let (force, mass) = of(Weight::Structure).support(&forces);
        let expected = support + Vec3::new(0.5, 0.0, 7.80665) * 5.9165;
        assert!((force - expected).norm() < 1e-9 && mass == 106.614, "{force}");
        let start = [1.0, 2.0, -4.0];
        let end = of(Weight::Body).end_velocity(start, &forces, 0.5);
        assert!((end[2] - (-4.0 + 0.5 * (100.0 / 100.6975 - 9.80665))).abs() < 1e-12, "{end:?}");
        assert_eq!(end[..2], start[..2], "it is held sideways");
        let free = DescentModel { axes: FrameAxes::All, ..of(Weight::Body) };
        let end = free.end_velocity(start, &forces, 0.5);
        let sideways = [1.0 + 0.5 * 30.0 / 100.6975, 2.0 - 0.5 * 20.0 / 100.6975];
        assert!((0..2).all(|i| (end[i] - sideways[i]).abs() < 1e-12), "{end:?}");
        let paper = ATPS.end_velocity(start, &forces, 0.5);
        assert!((paper[2] - (-4.0 + 0.5 * (700.0 / 106.614 - 9.80665))).abs() < 1e-12, "{paper:?}");
    }

    /// A payload in the wind, free in all axes: it drifts with the wind and falls at its terminal speed.
    #[test]
    fn free_payload_drifts_with_the_wind() {
        let drag = PayloadDrag { half_density_area: 0.49, wind_m_s: [6.0, -2.0, 0.0] };
        let model = DescentModel { payload_drag: Some(drag), axes: FrameAxes::All, ..ATPS };
        let mut v = [0.0; 3];
        (0..8000).for_each(|_| v = model.step(v, Vec3::zeros(), model.mass_kg, 0.05));
        let terminal = (ATPS.mass_kg * ATPS.gravity_m_s2 / drag.half_density_area).sqrt();
        let error = Vec3::from(v) - Vec3::new(6.0, -2.0, -terminal);
        assert!(error.norm() < 1e-9 * terminal, "{v:?}");
    }

    #[test]
    fn drag_equals_weight_at_the_published_coefficient() {
        // Paper: drag equals weight at 4.8768 m/s for Cd 1.735 on 41.3614 m2.
        let weight = ATPS.mass_kg * ATPS.gravity_m_s2;
        assert_eq!(fall(&ATPS, -4.8768, weight, 1.0), -4.8768);
        assert!((ATPS.drag_coefficient(weight).expect("a speed") - 1.735).abs() < 5e-4);
    }

    #[test]
    fn free_fall_without_air_accelerates_by_gravity() {
        let v = fall(&ATPS, -4.0, 0.0, 0.1);
        assert!((v + 4.0 + 0.980665).abs() < 1e-12);
    }

    #[test]
    fn terminal_speed_converges_with_first_order() {
        // m dv/dt = k v^2 - m g has v(t) = -v_t tanh(g t / v_t) from rest. The
        // force at the end of the step is found by bisection: implicit Euler.
        let k = 0.5 * 1.225 * 41.3614 * 1.735;
        let terminal = (ATPS.mass_kg * ATPS.gravity_m_s2 / k).sqrt();
        let speed_at = |steps: u32| {
            let (end, mut v) = (0.5, 0.0);
            let dt = end / f64::from(steps);
            for _ in 0..steps {
                let (mut low, mut high) = (-2.0 * terminal, 0.0);
                for _ in 0..80 {
                    let guess = 0.5 * (low + high);
                    if fall(&ATPS, v, k * guess * guess, dt) < guess { high = guess } else { low = guess }
                }
                v = 0.5 * (low + high);
            }
            (v + terminal * (ATPS.gravity_m_s2 * end / terminal).tanh()).abs()
        };
        let ratio = speed_at(50) / speed_at(100);
        assert!((ratio - 2.0).abs() < 0.1, "first order: halving the step halves the error, got {ratio}");
    }

    /// The drag at the end of a step balances the change of velocity over it.
    #[test]
    fn drag_is_implicit() {
        for wind in [[0.0; 3], [3.0, -4.0, 0.0], [1.0, 2.0, 5.0], [6.0, 1.0, -9.0]] {
            let drag = PayloadDrag { half_density_area: 0.7, wind_m_s: wind };
            for (free, dt) in [(-12.0, 0.1), (4.0, 2.0), (-3.0, 10.0)] {
                let mass = 5.0;
                let v = drag.slowed_vertically(free, mass, dt);
                let w = [wind[0], wind[1], wind[2] - v];
                let force = 0.7 * w.iter().map(|w| w * w).sum::<f64>().sqrt() * w[2];
                assert!(
                    (mass * (v - free) / dt - force).abs() < 1e-12 * force.abs().max(1.0),
                    "{wind:?} {v}"
                );
                let free = Vec3::new(0.5 * free, -free, free);
                let v = drag.slowed(free, mass, dt);
                let error = (v - free) * (mass / dt) - drag.force(v);
                assert!(error.norm() < 1e-12 * drag.force(v).norm().max(1.0), "{wind:?} {v}");
            }
        }
    }
}
