//! What no physics allows a falling frame to do.
//!
//! Lines, weight and drag are all that acts on the payload. A frame that accelerates downwards by more than gravity and
//! the measured downward forces, or upwards by more than the measured force of the lines allows, follows a
//! force that does not act on it. The equation of momentum takes the measured force itself; the paper's
//! equation, which takes that of the air on the canopy, can do both.

use crate::descent::{DescentModel, WindowForces};

/// Margin, in shares of gravity: the converged descent speed leaves less (at a coupling tolerance of 0.1, 1 %).
pub const DOWNWARD_MARGIN: f64 = 0.1;
/// Margin upwards, in shares of gravity and of the acceleration that the lines give: the force of the air at the end of a
/// window differs from the mean of the lines' force over it as far as forces change over a window.
pub const UPWARD_MARGIN: f64 = 0.5;

/// Acceleration of the frame and what the measured forces allow.
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
    /// Of a window in which the frame of `model` accelerated by `acceleration` (m/s2) to `velocity` (m/s).
    pub fn of(model: &DescentModel, acceleration: f64, velocity: f64, forces: &WindowForces<'_>) -> Self {
        let (support, mass) = model.support(forces);
        Self {
            acceleration,
            support,
            drag: model.payload_drag.map_or(0.0, |d| d.force(velocity)),
            canopy: forces.canopy,
            mass,
            gravity: model.gravity_m_s2,
        }
    }

    /// Why the frame falls faster than anything pulls it, if it does.
    pub fn downward(&self) -> Option<String> {
        let pull = self.support.min(0.0) + self.drag.min(0.0);
        let least = pull / self.mass - self.gravity;
        (self.acceleration < least - DOWNWARD_MARGIN * self.gravity).then(|| {
            format!(
                "the frame accelerates downwards by {:.4} m/s2, but gravity and the measured downward forces on its {:.4} kg \
                 allow {:.4} m/s2: the lines bear {:.1} N (upwards), the air on the canopy {:.1} N. The force on an \
                 accelerating canopy is not that on the payload. Remedies: descent.equation = \"momentum\" with a structure \
                 that reports the force on the payload, an initial state nearer to balance, a shorter window_s",
                -self.acceleration, self.mass, -least, self.support, self.canopy
            )
        })
    }

    /// Why it rises faster than its lines pull it, if it does.
    pub fn upward(&self) -> Option<String> {
        let lift = (self.support.max(0.0) + self.drag.max(0.0)) / self.mass;
        let most = lift - self.gravity;
        let margin = UPWARD_MARGIN * (self.gravity + lift);
        (self.acceleration > most + margin).then(|| {
            format!(
                "the frame accelerates upwards by {:.4} m/s2, but its lines bear {:.1} N on {:.4} kg, which allows {:.4} m/s2; \
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

    /// The ATPS released at 20 m/s with the paper's equation: figures of issue and run.
    fn limits(acceleration: f64, support: f64, canopy: f64, payload_drag: Option<PayloadDrag>) -> Limits {
        let model = DescentModel {
            mass_kg: 106.614,
            payload_kg: 100.6975,
            equation: DescentEquation::QuasiSteady,
            weight: Weight::Frame,
            gravity_m_s2: 9.80665,
            reference_area_m2: 41.3614,
            reference_speed_m_s: 20.0,
            air_density_kg_m3: 1.225,
            payload_drag,
            drag_in_structure: false,
            support_known: true,
        };
        let mut structure = Stats::default();
        structure.values[structure_stats::SUPPORT_FORCE] = support;
        let forces = WindowForces { canopy, structure: &structure, frame_acceleration: 0.0 };
        Limits::of(&model, acceleration, -20.0, &forces)
    }

    #[test]
    fn nothing_falls_faster_than_what_pulls_it() {
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

    /// Both sides of the bounds: gravity, the force upon it and the margins, by hand.
    #[test]
    fn bounds_are_those_of_forces_and_margins() {
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
        // 1500 N on 106.614 kg are 14.0695 m/s2: less g, and half of both more; 90 m/s from below are 4860 N.
        for (within, beyond, support, payload_drag) in
            [(16.20, 16.21, 1500.0, None), (63.47, 63.48, 0.0, drag(70.0))]
        {
            assert_eq!(limits(within, support, 0.0, payload_drag).upward(), None, "{within}");
            assert!(limits(beyond, support, 0.0, payload_drag).upward().is_some(), "{beyond}");
        }
    }

    #[test]
    fn nothing_rises_faster_than_its_lines_pull() {
        let text = limits(80.0, 1500.0, 9600.0, None).upward().expect("beyond the lines' force");
        assert!(text.contains("1500.0 N") && text.contains("9600.0 N"), "{text}");
        assert_eq!(limits(1500.0 / 106.614 - 9.80665, 1500.0, 1500.0, None).upward(), None);
    }

    /// Both limits a hundredth of their margin to either side, with forces that count.
    #[test]
    fn limits_are_the_forces_over_the_mass_and_their_margin() {
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
