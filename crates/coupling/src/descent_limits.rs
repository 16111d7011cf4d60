//! Physical bounds on the vertical acceleration of the frame.
//!
//! Lines, weight and drag are the only forces on the payload. A frame that accelerates downwards by more than gravity
//! and the measured downward forces allow, or upwards by more than the measured line force allows, follows a force
//! that does not act on it. The momentum equation uses the measured force; the paper's equation uses the air force on
//! the canopy and can violate both bounds.

use crate::descent::{DescentModel, WindowForces};

/// Margin relative to gravity: a converged descent speed deviates less (1 % at a coupling tolerance of 0.1).
pub const DOWNWARD_MARGIN: f64 = 0.1;
/// Margin upwards, relative to gravity and to the acceleration by the lines: the force of the air at the end of a
/// window differs from the mean line force over it by the change of forces in a window.
pub const UPWARD_MARGIN: f64 = 0.5;

/// Acceleration of the frame and the bounds from the measured forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    acceleration: f64,
    /// Force of the structure on the frame, and drag of the payload, N.
    support: f64,
    drag: f64,
    canopy: f64,
    mass: f64,
    gravity: f64,
}

impl Limits {
    /// For a window in which the frame of `model` accelerated by `acceleration` (m/s2) to `velocity` (m/s).
    pub fn of(
        model: &DescentModel,
        acceleration: [f64; 3],
        velocity: [f64; 3],
        forces: &WindowForces<'_>,
    ) -> Self {
        let (support, mass) = model.support(forces);
        Self {
            acceleration: acceleration[2],
            support: support[2],
            drag: model.payload_drag.map_or(0.0, |d| d.force(velocity.into())[2]),
            canopy: forces.canopy[2],
            mass,
            gravity: model.gravity_m_s2,
        }
    }

    /// A message where the frame falls faster than the downward forces allow.
    pub fn downward(&self) -> Option<String> {
        let pull = self.support.min(0.0) + self.drag.min(0.0);
        let least = pull / self.mass - self.gravity;
        (self.acceleration < least - DOWNWARD_MARGIN * self.gravity).then(|| {
            format!(
                "the frame accelerates downwards by {:.4} m/s2, but gravity and the measured downward forces on its {:.4} kg \
                 allow {:.4} m/s2: the lines exert {:.1} N (upwards), the air on the canopy {:.1} N. The air force on an \
                 accelerating canopy is not the force on the payload. Remedies: descent.equation = \"momentum\" with a structure \
                 that reports the force on the payload, an initial state closer to equilibrium, a shorter window_s",
                -self.acceleration, self.mass, -least, self.support, self.canopy
            )
        })
    }

    /// A message where the frame rises faster than its lines allow.
    pub fn upward(&self) -> Option<String> {
        let lift = (self.support.max(0.0) + self.drag.max(0.0)) / self.mass;
        let most = lift - self.gravity;
        let margin = UPWARD_MARGIN * (self.gravity + lift);
        (self.acceleration > most + margin).then(|| {
            format!(
                "the frame accelerates upwards by {:.4} m/s2, but its lines exert {:.1} N on {:.4} kg, which allows {:.4} m/s2; \
                 the air on the canopy exerts {:.1} N. Remedy: descent.equation = \"momentum\"",
                self.acceleration, self.support, self.mass, most, self.canopy
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use case::DescentEquation;
    use channel::{Stats, structure_stats};

    use crate::descent::{PayloadDrag, Weight};
    use crate::frame_axes::FrameAxes;
    use crate::geometry::Vec3;

    /// The ATPS released at 20 m/s with the paper's equation.
    fn limits(acceleration: f64, support: f64, canopy: f64, payload_drag: Option<PayloadDrag>) -> Limits {
        let model = DescentModel {
            mass_kg: 106.614,
            payload_kg: 100.6975,
            equation: DescentEquation::QuasiSteady,
            weight: Weight::Frame,
            axes: FrameAxes::Vertical,
            gravity_m_s2: 9.80665,
            reference_area_m2: 41.3614,
            reference_speed_m_s: 20.0,
            air_density_kg_m3: 1.225,
            payload_drag,
            drag_in_structure: false,
            support_known: true,
        };
        let mut structure = Stats::default();
        structure.values[structure_stats::SUPPORT_FORCE + 2] = support;
        let canopy = Vec3::new(0.0, 0.0, canopy);
        let forces = WindowForces { canopy, structure: &structure, frame_acceleration: Vec3::zeros() };
        Limits::of(&model, [0.0, 0.0, acceleration], [0.0, 0.0, -20.0], &forces)
    }

    #[test]
    fn downward_acceleration_beyond_the_forces_is_rejected() {
        let violent = limits(-111.4, 715.0, -10832.0, None);
        let text = violent.downward().expect("beyond gravity");
        assert!(text.contains("111.4") && text.contains("715.0 N") && text.contains("-10832.0 N"), "{text}");
        assert!(text.contains("descent.equation = \"momentum\""), "{text}");
        assert_eq!(violent.upward(), None);
        assert_eq!(limits(-9.80665, 0.0, 0.0, None).downward(), None);
        assert_eq!(limits(-9.80665 * 1.09, 0.0, 0.0, None).downward(), None);
        // Lines that push, where they can, and a downdraught on the payload.
        assert_eq!(limits(-19.0, -1000.0, 0.0, None).downward(), None);
        let wind = PayloadDrag { half_density_area: 0.6, wind_m_s: [0.0, 0.0, -70.0] };
        assert_eq!(limits(-19.0, 0.0, 0.0, Some(wind)).downward(), None);
    }

    /// Both sides of the bounds (gravity, applied force, margins), computed by hand.
    #[test]
    fn bounds_are_forces_over_mass_plus_margins() {
        let drag = |w: f64| Some(PayloadDrag { half_density_area: 0.6, wind_m_s: [0.0, 0.0, w] });
        for (within, beyond, support, payload_drag) in [
            // 1.1 g; 1000 N; a wind of 50 m/s past the payload from above: 1500 N.
            (-10.78, -10.80, 0.0, None),
            (-20.16, -20.17, -1000.0, None),
            (-24.85, -24.86, 0.0, drag(-70.0)),
        ] {
            assert_eq!(limits(within, support, 0.0, payload_drag).downward(), None, "{within}");
            assert!(limits(beyond, support, 0.0, payload_drag).downward().is_some(), "{beyond}");
        }
        // 1500 N on 106.614 kg are 14.0695 m/s2: less g, plus half of both; 90 m/s from below are 4860 N.
        for (within, beyond, support, payload_drag) in
            [(16.20, 16.21, 1500.0, None), (63.47, 63.48, 0.0, drag(70.0))]
        {
            assert_eq!(limits(within, support, 0.0, payload_drag).upward(), None, "{within}");
            assert!(limits(beyond, support, 0.0, payload_drag).upward().is_some(), "{beyond}");
        }
    }

    #[test]
    fn upward_acceleration_beyond_the_line_force_is_rejected() {
        let text = limits(80.0, 1500.0, 9600.0, None).upward().expect("beyond the lines' force");
        assert!(text.contains("1500.0 N") && text.contains("9600.0 N"), "{text}");
        assert_eq!(limits(1500.0 / 106.614 - 9.80665, 1500.0, 1500.0, None).upward(), None);
    }

    /// Both limits one hundredth of their margin to either side, with nonzero forces.
    #[test]
    fn both_limits_switch_at_their_margin() {
        let g = 9.80665;
        for (pull, lift) in [(-1000.0, 1500.0), (-200.0, 400.0)] {
            let mass = limits(0.0, pull, 0.0, None).mass;
            let least = pull / mass - g;
            for (share, refused) in [(0.99, false), (1.01, true)] {
                let down = least - share * DOWNWARD_MARGIN * g;
                assert_eq!(limits(down, pull, 0.0, None).downward().is_some(), refused, "{pull} N, {share}");
                let up = lift / mass - g + share * UPWARD_MARGIN * (g + lift / mass);
                assert_eq!(limits(up, lift, 0.0, None).upward().is_some(), refused, "{lift} N, {share}");
            }
        }
    }
}
