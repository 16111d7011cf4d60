//! Swing of a canopy about its payload in two directions: in a plane, or along a cone.

use serde::{Deserialize, Serialize};

use crate::long_term::long_term;

/// Minimum number of windows.
const MIN_POINTS: usize = 40;
/// Root mean square of the swing, degrees, below which a canopy is at rest: round-off and the tolerance of the coupling have no direction.
const AT_REST: f64 = 1e-6;

/// Direction from the payload to the centroid of the canopy, at the end of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tilt {
    /// Time since the start of the stage, s.
    pub time_s: f64,
    /// Components of the angle to the vertical along x and y, degrees.
    pub xy_deg: [f64; 2],
}

/// Swing of a canopy over a part of a stage, about its mean tilt.
///
/// # Examples
///
/// A cone of 10 degrees about the vertical that turns clockwise, seen from above, once in 4 s:
///
/// ```
/// use results::pendulum::{PendulumSwing, Tilt};
///
/// let tilt = |k: u32| {
///     let t = 0.02 * f64::from(k);
///     let phase = std::f64::consts::TAU * t / 4.0;
///     Tilt { time_s: t, xy_deg: [10.0 * phase.cos(), -10.0 * phase.sin()] }
/// };
/// let swing = PendulumSwing::of(&(0..1000).map(tilt).collect::<Vec<_>>()).expect("a swing");
/// assert!((swing.axis_ratio - 1.0).abs() < 1e-6);
/// assert!((swing.turn_rate_deg_s + 90.0).abs() < 0.1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PendulumSwing {
    /// Mean tilt along x and y, degrees.
    pub mean_tilt_deg: [f64; 2],
    /// Root mean square of the swing about it along the axis of its largest and of its smallest variance, degrees: square roots of the
    /// eigenvalues of the covariance of both components. The amplitude of a harmonic swing is the square root of two times it.
    pub principal_rms_deg: [f64; 2],
    /// Direction of the axis of the largest variance, degrees from x towards y, above -90 and up to 90.
    pub azimuth_deg: f64,
    /// The smaller over the larger of both. 0: the canopy swings in a plane; 1: along a circular cone (or without any order).
    pub axis_ratio: f64,
    /// Mean rate of turn about the mean tilt, degrees/s, right-handed about the upward vertical: area swept over the mean square of the distance,
    /// of which a swing in a plane has none.
    pub turn_rate_deg_s: f64,
    /// Root mean square of the swing in the second half of the part over that in its first half, both about the mean of the part. A swing that decays has a
    /// value below 1; a value of an irregular swing, or of a few periods, also differs from 1 by chance.
    pub growth: f64,
    /// Main period along the axis of the largest variance, s; `None` where no period has a quarter of the variance.
    pub period_s: Option<f64>,
}

impl PendulumSwing {
    /// Of the ends of the windows of a part of a stage; `None` for fewer than 40, or a canopy at rest (rms below 1e-6 degrees).
    pub fn of(tilts: &[Tilt]) -> Option<Self> {
        if tilts.len() < MIN_POINTS {
            return None;
        }
        let n = tilts.len() as f64;
        let mean = [0, 1].map(|i| tilts.iter().map(|t| t.xy_deg[i]).sum::<f64>() / n);
        let about: Vec<(f64, [f64; 2])> =
            tilts.iter().map(|t| (t.time_s, [0, 1].map(|i| t.xy_deg[i] - mean[i]))).collect();
        let moment = |i: usize, j: usize| about.iter().map(|(_, d)| d[i] * d[j]).sum::<f64>() / n;
        let (xx, xy, yy) = (moment(0, 0), moment(0, 1), moment(1, 1));
        let (middle, radius) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let major = (middle + radius).sqrt();
        if !(major > AT_REST && major.is_finite()) {
            return None;
        }
        let minor = (middle - radius).max(0.0).sqrt();
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let (sin, cos) = angle.sin_cos();
        let along: Vec<(f64, f64)> = about.iter().map(|(t, [x, y])| (*t, cos * x + sin * y)).collect();
        let (early, late) = about.split_at(about.len() / 2);
        Some(Self {
            mean_tilt_deg: mean,
            principal_rms_deg: [major, minor],
            azimuth_deg: angle.to_degrees(),
            axis_ratio: minor / major,
            turn_rate_deg_s: turn_rate(&about).to_degrees(),
            growth: distance_rms(late) / distance_rms(early).max(AT_REST),
            period_s: long_term(&along).and_then(|l| l.swing).map(|s| s.period),
        })
    }

    /// The swing in words.
    pub fn line(&self) -> String {
        let ([x, y], [major, minor]) = (self.mean_tilt_deg, self.principal_rms_deg);
        let period = self.period_s.map_or("no main period".into(), |p| format!("period {p:.2} s"));
        format!(
            "swing about a mean tilt of ({x:.2}, {y:.2}) deg: rms {major:.2} and {minor:.2} deg along its principal axes (ratio {:.2}; 0 plane, 1 cone), \
             turns at {:+.1} deg/s, {period}, rms of the second half over that of the first {:.2}",
            self.axis_ratio, self.turn_rate_deg_s, self.growth
        )
    }
}

/// Mean rate of turn of the points about the origin, rad/s: twice the area swept over the integral of the squared distance.
fn turn_rate(points: &[(f64, [f64; 2])]) -> f64 {
    let square = |[x, y]: [f64; 2]| x * x + y * y;
    let (mut swept, mut weight) = (0.0, 0.0);
    for pair in points.windows(2) {
        let [(t0, a), (t1, b)] = [pair[0], pair[1]];
        swept += a[0] * b[1] - a[1] * b[0];
        weight += 0.5 * (square(a) + square(b)) * (t1 - t0);
    }
    swept / weight
}

fn distance_rms(points: &[(f64, [f64; 2])]) -> f64 {
    (points.iter().map(|(_, [x, y])| x * x + y * y).sum::<f64>() / points.len() as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// 48 s at a mean tilt of (3, -2) degrees, in steps of 20 ms.
    fn swing(at: impl Fn(f64) -> [f64; 2]) -> PendulumSwing {
        let tilt = |k: u32| {
            let t = 0.02 * f64::from(k);
            let [x, y] = at(t);
            Tilt { time_s: t, xy_deg: [3.0 + x, y - 2.0] }
        };
        PendulumSwing::of(&(0..2400).map(tilt).collect::<Vec<_>>()).expect("a swing")
    }

    /// Semi-axes `a` and `b` (degrees), the first at `azimuth` (degrees), in 6 s: right-handed for positive b.
    fn ellipse(a: f64, b: f64, azimuth: f64) -> impl Fn(f64) -> [f64; 2] {
        let (sin, cos) = azimuth.to_radians().sin_cos();
        move |t: f64| {
            let (along, across) = (a * (TAU * t / 6.0).cos(), b * (TAU * t / 6.0).sin());
            [cos * along - sin * across, sin * along + cos * across]
        }
    }

    #[test]
    fn plane_swing_has_one_axis_and_does_not_turn() {
        let found = swing(ellipse(8.0, 0.0, 30.0));
        let [major, minor] = found.principal_rms_deg;
        assert!((major - 8.0 / 2f64.sqrt()).abs() < 1e-9 && minor < 1e-6, "{found:?}");
        assert!((found.azimuth_deg - 30.0).abs() < 1e-9 && found.axis_ratio < 1e-6, "{found:?}");
        assert!(found.turn_rate_deg_s.abs() < 1e-9 && (found.growth - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found.mean_tilt_deg[0] - 3.0).abs() < 1e-9 && (found.mean_tilt_deg[1] + 2.0).abs() < 1e-9);
        assert!((found.period_s.expect("a period") - 6.0).abs() < 0.03, "{found:?}");
    }

    /// A chord of 1.2 degrees sweeps the sine of it, a factor of 1 - 7e-5.
    #[test]
    fn cone_has_equal_axes_and_its_rate_with_its_sign() {
        for sign in [1.0, -1.0] {
            let found = swing(ellipse(8.0, 8.0 * sign, 0.0));
            assert!((found.axis_ratio - 1.0).abs() < 1e-9, "{found:?}");
            assert!((found.turn_rate_deg_s - 60.0 * sign).abs() < 6e-3, "{found:?}");
        }
    }

    /// The rate of an ellipse is that of its phase times 2ab / (a^2 + b^2).
    #[test]
    fn ellipse_has_its_axes_and_mean_rate() {
        let found = swing(ellipse(10.0, -4.0, -50.0));
        let [major, minor] = found.principal_rms_deg.map(|s| s * 2f64.sqrt());
        assert!((major - 10.0).abs() < 1e-9 && (minor - 4.0).abs() < 1e-9, "{found:?}");
        assert!((found.azimuth_deg + 50.0).abs() < 1e-9 && (found.axis_ratio - 0.4).abs() < 1e-9);
        // Eight periods less one step.
        assert!((found.turn_rate_deg_s + 60.0 * 80.0 / 116.0).abs() < 0.02, "{found:?}");
    }

    /// 8 degrees in 6 s at 60 degrees and 6 degrees in 4 s across: at -60 degrees, 120 degrees away, the second would be larger, 5.2 over 4 degrees.
    #[test]
    fn period_is_that_of_the_larger_axis() {
        let (sin, cos) = 60f64.to_radians().sin_cos();
        let found = swing(|t| {
            let (along, across) = (8.0 * (TAU * t / 6.0).cos(), 6.0 * (TAU * t / 4.0).sin());
            [cos * along - sin * across, sin * along + cos * across]
        });
        assert!((found.azimuth_deg - 60.0).abs() < 1e-6, "{found:?}");
        assert!((found.period_s.expect("a period") - 6.0).abs() < 0.03, "{found:?}");
    }

    /// Pseudo-random numbers between -1 and 1 (xorshift).
    fn noise() -> impl FnMut() -> f64 {
        let mut state = 0x9e37_79b9_7f4a_7c15u64;
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    /// Noise of up to 2 degrees adds its variance, 4/3, to both axes, and no turn: 2400 steps leave about 1 degree/s of a rate that would be
    /// 180 degrees a step at random.
    #[test]
    fn noise_adds_its_variance_and_no_turn() {
        let random = std::cell::RefCell::new(noise());
        let clean = ellipse(10.0, 4.0, 20.0);
        let found = swing(|t| clean(t).map(|c| c + 2.0 * random.borrow_mut()()));
        let expected = [50.0f64, 8.0].map(|variance| (variance + 4.0 / 3.0).sqrt());
        for (found, expected) in found.principal_rms_deg.iter().zip(expected) {
            assert!((found / expected - 1.0).abs() < 0.02, "{found} {expected}");
        }
        let rate = 60.0 * 80.0 / (116.0 + 16.0 / 3.0);
        assert!((found.turn_rate_deg_s - rate).abs() < 4.0, "{found:?} {rate}");
    }

    /// exp(-t / 24 s) over 48 s: each value of the second half is exp(-1) times that of the first, four periods earlier. The mean, 0.07 % of the amplitude, changes the
    /// squares by its square and by its product with the means of the halves, less than 1e-5.
    #[test]
    fn decay_is_seen_in_the_halves() {
        let clean = ellipse(10.0, 0.0, 0.0);
        let found = swing(|t| clean(t).map(|c| c * (-t / 24.0).exp()));
        assert!((found.growth / (-1f64).exp() - 1.0).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn canopy_at_rest_and_short_stage_have_no_swing() {
        let at_rest = [Tilt { time_s: 0.0, xy_deg: [1.0, 2.0] }; 100];
        assert_eq!(PendulumSwing::of(&at_rest), None);
        let noise = |k: u32| Tilt { time_s: f64::from(k), xy_deg: [1.0 + 1e-9 * f64::from(k % 7), 2.0] };
        assert_eq!(PendulumSwing::of(&(0..100).map(noise).collect::<Vec<_>>()), None);
        let short: Vec<Tilt> =
            (0..39).map(|k| Tilt { time_s: f64::from(k), xy_deg: [f64::from(k), 0.0] }).collect();
        assert_eq!(PendulumSwing::of(&short), None);
    }
}
