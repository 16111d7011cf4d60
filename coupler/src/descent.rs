//! The falling mass: one degree of freedom (paper, equation 9).
//!
//! $$ m \dot v = F_z - m g, \qquad v^{n+1} = v^n + \Delta t\, \dot v^{n+1} $$
//!
//! with $v$ the vertical velocity of the falling frame (positive up, so the
//! descent speed is $-v$). The second line of equation (9) in print repeats the
//! acceleration on its left side; this is the implicit Euler step it means. The
//! mass is that of payload, fabric and lines: the air that moves along is part
//! of the resolved flow and must not be added.

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
        velocity + dt * self.acceleration(force_z)
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
    };

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
