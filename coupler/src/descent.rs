//! The falling mass: one degree of freedom (paper, equation 9).
//!
//! $$ m \dot v = F_z - m g, \qquad v^{n+1} = v^n + \Delta t\, \dot v^{n+1} $$
//!
//! with $v$ the vertical velocity of the falling frame (positive up, so the
//! descent speed is $-v$). The second line of equation (9) in print repeats the
//! acceleration on its left side; this is the implicit Euler step it means. The
//! mass is that of payload, fabric and lines: the air that moves along is part
//! of the resolved flow and must not be added.

use channel::{Stats, structure_stats};

/// Mass, gravity and the reference that turns force into a coefficient.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DescentModel {
    /// Mass of payload, fabric and lines, kg.
    pub mass_kg: f64,
    /// Acceleration of gravity, m/s2.
    pub gravity_m_s2: f64,
    /// Area of the drag coefficient, m2.
    pub reference_area_m2: f64,
    /// Speed of the drag coefficient ($V_\infty$: the initial descent speed), m/s.
    pub reference_speed_m_s: f64,
    /// Density of the undisturbed air, kg/m3.
    pub air_density_kg_m3: f64,
    /// Drag of a payload that falls with the frame; `None`: it has none.
    pub payload_drag: Option<PayloadDrag>,
    /// The structure tells the drag of lines and payload with each answer.
    pub drag_in_structure: bool,
}

/// Drag of the air on the payload, `1/2 rho (C A) |w| w`, in a steady wind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PayloadDrag {
    /// Half the density times the drag area, kg/m.
    pub half_density_area: f64,
    /// Wind, m/s.
    pub wind_m_s: [f64; 3],
}

impl PayloadDrag {
    /// Velocity at the end of a step (m/s) that without this drag would be `free`, for a mass
    /// `m` (kg): the drag is that at the end of the step, as all forces of the descent are.
    fn slowed(&self, free: f64, m: f64, dt: f64) -> f64 {
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
    /// Vertical acceleration of the frame, m/s2, under the vertical force of the
    /// air `force_z` (N, positive up).
    pub fn acceleration(&self, force_z: f64) -> f64 {
        force_z / self.mass_kg - self.gravity_m_s2
    }

    /// Vertical velocity at the end of a window of `dt` seconds that started
    /// with `velocity`, under the force at its end.
    pub fn step(&self, velocity: f64, force_z: f64, dt: f64) -> f64 {
        let free = velocity + dt * self.acceleration(force_z);
        match &self.payload_drag {
            None => free,
            Some(drag) => drag.slowed(free, self.mass_kg, dt),
        }
    }

    /// Vertical force of the air on all that falls, N: `canopy` on the canopy, and what the
    /// structure's statistics say of lines and a payload that moves.
    pub fn force(&self, canopy: f64, structure: &Stats) -> f64 {
        if self.drag_in_structure { canopy + structure.values[structure_stats::AIR_FORCE] } else { canopy }
    }

    /// Drag coefficient on the reference area and the *initial* speed, as in the paper.
    pub fn drag_coefficient(&self, force_z: f64) -> f64 {
        force_z
            / (0.5
                * self.air_density_kg_m3
                * self.reference_speed_m_s
                * self.reference_speed_m_s
                * self.reference_area_m2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ATPS: DescentModel = DescentModel {
        mass_kg: 106.614,
        gravity_m_s2: 9.80665,
        reference_area_m2: 41.3614,
        reference_speed_m_s: 4.8768,
        air_density_kg_m3: 1.225,
        payload_drag: None,
        drag_in_structure: false,
    };

    /// A sphere that falls alone: terminal speed sqrt(2 m g / (rho C A)), and the wind carries
    /// it along: across the wind its drag grows with the whole speed.
    #[test]
    fn a_payload_alone_falls_at_its_own_speed() {
        let drag = PayloadDrag { half_density_area: 0.5 * 1.225 * 0.8, wind_m_s: [0.0; 3] };
        let model = DescentModel { payload_drag: Some(drag), ..ATPS };
        let mut v = 0.0;
        (0..4000).for_each(|_| v = model.step(v, 0.0, 0.05));
        let terminal = (ATPS.mass_kg * ATPS.gravity_m_s2 / drag.half_density_area).sqrt();
        assert!((v / -terminal - 1.0).abs() < 1e-12, "{v} {terminal}");
        // Falling upwards in an updraught that is faster.
        let up = PayloadDrag { wind_m_s: [0.0, 0.0, 2.0 * terminal], ..drag };
        let model = DescentModel { payload_drag: Some(up), ..ATPS };
        (0..4000).for_each(|_| v = model.step(v, 0.0, 0.05));
        assert!((v / terminal - 1.0).abs() < 1e-12, "{v}");
        let across = PayloadDrag { wind_m_s: [30.0, 0.0, 0.0], ..drag };
        let model = DescentModel { payload_drag: Some(across), ..ATPS };
        let mut w = 0.0;
        (0..4000).for_each(|_| w = model.step(w, 0.0, 0.05));
        let force = drag.half_density_area * (w * w + 900.0).sqrt() * -w;
        assert!((force / (ATPS.mass_kg * ATPS.gravity_m_s2) - 1.0).abs() < 1e-10, "{w}");
    }

    #[test]
    fn the_structure_tells_the_drag_of_lines() {
        let mut stats = Stats::default();
        stats.values[structure_stats::AIR_FORCE] = 12.5;
        assert_eq!(ATPS.force(100.0, &stats), 100.0);
        assert_eq!(DescentModel { drag_in_structure: true, ..ATPS }.force(100.0, &stats), 112.5);
    }

    #[test]
    fn weight_balances_at_the_published_coefficient() {
        // DESIGN.md section 6: drag = weight at 4.8768 m/s means Cd 1.735 on 41.3614 m2.
        let weight = ATPS.mass_kg * ATPS.gravity_m_s2;
        assert_eq!(ATPS.acceleration(weight), 0.0);
        assert!((ATPS.drag_coefficient(weight) - 1.735).abs() < 5e-4);
    }

    #[test]
    fn free_fall_without_air() {
        let v = ATPS.step(-4.0, 0.0, 0.1);
        assert!((v + 4.0 + 0.980665).abs() < 1e-12);
    }

    #[test]
    fn settles_at_terminal_speed_with_first_order() {
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
                    if ATPS.step(v, k * guess * guess, dt) < guess { high = guess } else { low = guess }
                }
                v = 0.5 * (low + high);
            }
            (v + terminal * (ATPS.gravity_m_s2 * end / terminal).tanh()).abs()
        };
        let ratio = speed_at(50) / speed_at(100);
        assert!((ratio - 2.0).abs() < 0.1, "first order: halving the step halves the error, got {ratio}");
    }
}
