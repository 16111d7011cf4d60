//! State of the wake of a canopy over a stage, and whether the means of the stage are those of a developed wake.
//!
//! U is the speed of the undisturbed air relative to the falling frame, D the diameter of a circle with the projected area of the
//! canopy. A time in units of D/U counts the diameters of stream that have passed the canopy.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

use crate::long_term::{MIN_BATCHES, long_term};
use crate::pendulum::{PendulumSwing, Tilt};

/// Root mean square of the side force over the mean drag below which a wake counts as symmetric: the geometric mean of 0.9 %,
/// a symmetric wake of the ATPS (9 N of 1 050 N), and 10 %, the least of its developed wakes (100 to 500 N).
pub const SYMMETRIC_SHARE: f64 = 0.03;
/// Strouhal number by which periods are counted where the side force has no main period: that of a disk across the stream, Berger,
/// Scholz and Schumm, J. Fluids Struct. 4 (1990).
pub const DISK_STROUHAL: f64 = 0.135;
/// Largest Strouhal number that counts as that of a wake: twice that of a disk, and above those of spheres (0.2) and cylinders (0.12 to
/// 0.22). A faster side force is that of a canopy that vibrates or breathes.
pub const LARGEST_STROUHAL: f64 = 0.3;
/// Periods in a mean below which it has no confidence interval: one batch of each.
pub const MIN_PERIODS: f64 = MIN_BATCHES as f64;

/// Checks of this module in the table of checks.
const SYMMETRIC: &str = "wake.symmetric";
const PERIODS: &str = "wake.periods";

/// Wake at the end of a window.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Time since the start of the stage, s.
    pub time_s: f64,
    /// Drag of the canopy, N.
    pub drag_n: f64,
    /// Force of the air on the canopy across the axis of descent, along x and y, N.
    pub side_n: [f64; 2],
    /// Angle between the vertical and the line from the payload to the centroid of the canopy, degrees; `None` where the payload
    /// is not at rest in the frame.
    pub pendulum_deg: Option<f64>,
    /// Components of that angle along x and y, degrees.
    pub pendulum_xy_deg: Option<[f64; 2]>,
    /// Diameters of stream since the start of the stage, the integral of U/D.
    pub diameters: f64,
    /// Speed U of the undisturbed air relative to the frame, m/s.
    pub speed_m_s: f64,
}

/// Statistics of the wake over the last half of the windows of a stage, as those of the means.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Wake {
    /// Diameters of stream that passed the canopy in the stage: the integral of U/D, with the speed U of the air relative to the frame and
    /// the diameter D of a circle of the projected area.
    pub stream_diameters: f64,
    /// The same in the last half of the windows.
    pub mean_stream_diameters: f64,
    /// Root mean square of the side force, N.
    pub side_force_rms_n: f64,
    /// The same over the mean drag.
    pub side_force_share: f64,
    /// Root mean square of the angle between the vertical and the line from the payload to the centroid of the canopy, degrees; `None`
    /// where the payload moves in the frame.
    pub pendulum_rms_deg: Option<f64>,
    /// Largest such angle, degrees.
    pub pendulum_largest_deg: Option<f64>,
    /// Swing in both directions; `None` as the angle, for fewer than 80 windows, and for a history of earlier versions.
    pub pendulum_swing: Option<PendulumSwing>,
    /// Strouhal number f D/U of the main period of the side force along its principal axis; `None` with fewer than four periods,
    /// with a side force below 3 % of the drag, or above 0.3, where it is not that of a wake.
    pub strouhal: Option<f64>,
    /// Share of that period in the variance.
    pub strouhal_share: Option<f64>,
    /// Periods of the side force; without a main period, with a Strouhal number above 0.3, or with a side force below 3 % of the drag,
    /// those of a disk: 0.135 times the diameters.
    pub periods: f64,
    /// Whether the periods are those of a main period that was found.
    pub periods_measured: bool,
}

/// Why a mean of a stage is not that of a developed wake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verdict {
    /// Identifier of the check.
    pub check: &'static str,
    /// The figure with its bound.
    pub figure: String,
    /// What the user does.
    pub remedy: &'static str,
}

impl Verdict {
    /// The warning about the means of `stage`.
    pub fn warning(&self, stage: &str) -> String {
        format!("means of stage `{stage}`: {} [{}]. Remedy: {}", self.figure, self.check, self.remedy)
    }
}

/// Diameter of a circle of `area` (m2), m.
pub fn diameter(area: f64) -> f64 {
    2.0 * (area.max(0.0) / PI).sqrt()
}

/// Component of the side force along its principal axis, at each time, N: the direction of largest variance in the plane of x and y.
fn principal(samples: &[Sample]) -> Vec<(f64, f64)> {
    let n = samples.len() as f64;
    let mean: [f64; 2] = std::array::from_fn(|i| samples.iter().map(|s| s.side_n[i]).sum::<f64>() / n);
    let moment = |i: usize, j: usize| {
        samples.iter().map(|s| (s.side_n[i] - mean[i]) * (s.side_n[j] - mean[j])).sum::<f64>() / n
    };
    let (sin, cos) = (0.5 * (2.0 * moment(0, 1)).atan2(moment(0, 0) - moment(1, 1))).sin_cos();
    samples.iter().map(|s| (s.time_s, cos * s.side_n[0] + sin * s.side_n[1])).collect()
}

fn root_mean_square(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = values.len().max(1) as f64;
    (values.map(|v| v * v).sum::<f64>() / n).sqrt()
}

impl Wake {
    /// Of the windows of a stage so far; `None` without a window or a stream.
    pub fn of(samples: &[Sample]) -> Option<Self> {
        let late = &samples[samples.len() / 2..];
        let end = late.last().filter(|s| s.diameters > 0.0)?;
        let before = samples[..samples.len() / 2].last().copied().unwrap_or_default();
        let (time, diameters) = (end.time_s - before.time_s, end.diameters - before.diameters);
        let drag = late.iter().map(|s| s.drag_n).sum::<f64>() / late.len() as f64;
        let rms = root_mean_square(late.iter().map(|s| s.side_n[0].hypot(s.side_n[1])));
        let angles: Vec<f64> = late.iter().filter_map(|s| s.pendulum_deg).collect();
        let angle = |value: f64| (!angles.is_empty()).then_some(value);
        let tilts: Vec<Tilt> =
            late.iter().filter_map(|s| Some(Tilt { time_s: s.time_s, xy_deg: s.pendulum_xy_deg? })).collect();
        let share = rms / drag.abs().max(f64::MIN_POSITIVE);
        // In a symmetric wake the side force oscillates with the canopy, not with the wake.
        let force = (share >= SYMMETRIC_SHARE).then(|| principal(late));
        let of_a_wake = |s: &(f64, f64)| time < LARGEST_STROUHAL * diameters * s.0;
        let period =
            force.and_then(|force| long_term(&force)?.swing).map(|s| (s.period, s.share)).filter(of_a_wake);
        let periods = period.map_or(DISK_STROUHAL * diameters, |(p, _)| time / p);
        let enough = period.filter(|_| periods >= MIN_PERIODS && diameters > 0.0);
        Some(Self {
            stream_diameters: end.diameters,
            mean_stream_diameters: diameters,
            side_force_rms_n: rms,
            side_force_share: share,
            pendulum_rms_deg: angle(root_mean_square(angles.iter().copied())),
            pendulum_largest_deg: angle(angles.iter().copied().fold(0.0, f64::max)),
            pendulum_swing: PendulumSwing::of(&tilts),
            strouhal: enough.map(|(p, _)| time / (p * diameters)),
            strouhal_share: enough.map(|(_, share)| share),
            periods,
            periods_measured: period.is_some(),
        })
    }

    /// Of the columns of a `history.csv`; `None` where it has no wake.
    pub fn of_history(columns: &[(String, Vec<f64>)]) -> Option<Self> {
        let get = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..]);
        let (time, drag) = (get("time_s")?, get("drag_n")?);
        let (x, y, diameters) = (get("force_x_n")?, get("force_y_n")?, get("stream_diameters")?);
        let angle = get("pendulum_angle_deg");
        let swing = get("pendulum_x_deg").zip(get("pendulum_y_deg"));
        let samples: Vec<Sample> = (0..time.len())
            .filter(|&k| diameters[k].is_finite())
            .map(|k| Sample {
                time_s: time[k],
                drag_n: drag[k],
                side_n: [x[k], y[k]],
                pendulum_deg: angle.map(|a| a[k]).filter(|a| a.is_finite()),
                pendulum_xy_deg: swing
                    .map(|(x, y)| [x[k], y[k]])
                    .filter(|xy| xy.iter().all(|c| c.is_finite())),
                diameters: diameters[k],
                // Not needed for the statistics.
                speed_m_s: 0.0,
            })
            .collect();
        Self::of(&samples)
    }

    /// Why the means of the stage are not those of a developed wake; `None` for a developed wake with enough periods. A stage with
    /// too few periods cannot distinguish a symmetric wake from an undeveloped one: this is one verdict, with the side force.
    pub fn verdict(&self) -> Option<Verdict> {
        if self.periods < MIN_PERIODS {
            let counted = if self.periods_measured {
                "of the side force"
            } else {
                "at the Strouhal number 0.135 of a disk"
            };
            return Some(Verdict {
                check: PERIODS,
                figure: format!(
                    "the mean of the last half covers {:.2} periods {counted} ({:.1} U/D), a confidence interval needs {MIN_PERIODS}; \
                     rms side force {:.3} N, {:.2} % of the drag",
                    self.periods,
                    self.mean_stream_diameters,
                    self.side_force_rms_n,
                    100.0 * self.side_force_share
                ),
                remedy: "lengthen the stage, and do not compare its mean with a steady value",
            });
        }
        (self.side_force_share < SYMMETRIC_SHARE).then(|| Verdict {
            check: SYMMETRIC,
            figure: format!(
                "the wake is still symmetric, its drag may be a third too low: rms side force {:.3} N, {:.2} % of the drag (below {} %), \
                 after {:.1} U/D",
                self.side_force_rms_n,
                100.0 * self.side_force_share,
                100.0 * SYMMETRIC_SHARE,
                self.stream_diameters
            ),
            remedy: "add [stage.perturbation] to a stage with flow, or lengthen the stage: by round-off alone a wake needs 30 to 60 U/D",
        })
    }

    /// The statistics in words.
    pub fn line(&self) -> String {
        let angle = match (self.pendulum_rms_deg, self.pendulum_largest_deg) {
            (Some(rms), Some(largest)) => {
                format!(", pendulum angle rms {rms:.2} deg, largest {largest:.2} deg")
            }
            _ => String::new(),
        };
        let strouhal = self.strouhal.map_or(String::new(), |st| format!(", Strouhal number {st:.3}"));
        let swing = self.pendulum_swing.map_or(String::new(), |s| format!("; {}", s.line()));
        format!(
            "wake of the last half: side force rms {:.3} N ({:.2} % of the drag){angle}{strouhal}; {:.1} U/D in the stage{swing}",
            self.side_force_rms_n,
            100.0 * self.side_force_share,
            self.stream_diameters
        )
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    /// A stage of `end` s with a stream of 0.5 diameters a second, a drag of 1 000 N, and side forces (N) along (0.6, 0.8) and across.
    fn stage(end: f64, along: impl Fn(f64) -> f64, across: impl Fn(f64) -> f64) -> Vec<Sample> {
        let count = (end / 0.02) as u32;
        let at = |k: u32| {
            let t = 0.02 * f64::from(k);
            let (a, b) = (along(t), across(t));
            Sample {
                time_s: t,
                drag_n: 1000.0 + 50.0 * (7.0 * t).sin(),
                side_n: [0.6 * a - 0.8 * b, 0.8 * a + 0.6 * b],
                pendulum_deg: Some((3.0 * (0.4 * t).sin()).abs()),
                pendulum_xy_deg: Some([0.0, 3.0 * (0.4 * t).sin()]),
                diameters: 0.5 * t,
                speed_m_s: 1.0,
            }
        };
        (1..=count).map(at).collect()
    }

    fn check(wake: &Wake) -> Option<&'static str> {
        wake.verdict().map(|v| v.check)
    }

    fn warning(wake: &Wake) -> String {
        wake.verdict().expect("a verdict").warning("descent")
    }

    /// 200 s are 100 diameters; a period of 14 s is a Strouhal number of 1 / (14 * 0.5).
    #[test]
    fn settled_wake_has_its_strouhal_number_and_no_warning() {
        // What the first half had does not count.
        let along = |t: f64| if t > 100.0 { 300.0 * (TAU * t / 14.0).sin() } else { 5000.0 };
        let wake = Wake::of(&stage(200.0, along, |t| 20.0 * (3.0 * t).sin()));
        let wake = wake.expect("a wake");
        assert!(
            (wake.stream_diameters - 100.0).abs() < 1e-9 && (wake.mean_stream_diameters - 50.0).abs() < 1e-9
        );
        let strouhal = wake.strouhal.expect("seven periods");
        assert!((strouhal * 7.0 - 1.0).abs() < 0.02, "{strouhal}");
        assert!(wake.strouhal_share.expect("a share") > 0.9 && (wake.periods - 100.0 / 14.0).abs() < 0.2);
        let rms = (300f64.powi(2) + 20f64.powi(2)).sqrt() / 2f64.sqrt();
        assert!((wake.side_force_rms_n / rms - 1.0).abs() < 0.03, "{wake:?}");
        assert!((wake.side_force_share - wake.side_force_rms_n / 1000.0).abs() < 2e-3);
        let (mean, largest) =
            (wake.pendulum_rms_deg.expect("rms"), wake.pendulum_largest_deg.expect("largest"));
        assert!((mean - 3.0 / 2f64.sqrt()).abs() < 0.1 && (largest - 3.0).abs() < 1e-3, "{wake:?}");
        let swing = wake.pendulum_swing.expect("a swing");
        assert!((swing.principal_rms_deg[0] - mean).abs() < 0.01 && swing.azimuth_deg == 90.0, "{swing:?}");
        assert_eq!(check(&wake), None);
    }

    /// The symmetric descent of the ATPS: below 9 N of 1 050 N.
    #[test]
    fn symmetric_wake_is_reported_with_its_side_force() {
        let wake = Wake::of(&stage(200.0, |t| 9.0 * (TAU * t / 14.0).sin(), |_| 0.0)).expect("a wake");
        assert_eq!(check(&wake), Some("wake.symmetric"));
        let text = warning(&wake);
        for part in [
            "stage `descent`",
            "0.64 % of the drag (below 3 %)",
            "100.0 U/D",
            "[stage.perturbation]",
            "[wake.symmetric]",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        // On both sides of the bound.
        for (side, symmetric) in [(29.0, true), (31.0, false)] {
            let wake = Wake::of(&stage(200.0, |_| side, |_| 0.0)).expect("a wake");
            assert_eq!(check(&wake) == Some("wake.symmetric"), symmetric, "{side}: {wake:?}");
        }
    }

    #[test]
    fn mean_over_too_few_periods_is_reported_with_their_number() {
        // Three periods of 14 s in the last half, and no Strouhal number.
        let wake = Wake::of(&stage(84.0, |t| 300.0 * (TAU * t / 14.0).sin(), |_| 0.0)).expect("a wake");
        assert!(
            wake.periods_measured && (wake.periods - 3.0).abs() < 0.3 && wake.strouhal.is_none(),
            "{wake:?}"
        );
        assert_eq!(check(&wake), Some("wake.periods"));
        assert!(warning(&wake).contains("U/D), a confidence interval needs 4"), "{wake:?}");
        // Without a main period those of a disk count: 4 of them are 29.6 diameters.
        for (end, short) in [(116.0, true), (121.0, false)] {
            let wake = Wake::of(&stage(end, |_| 300.0, |_| 0.0)).expect("a wake");
            assert!(!wake.periods_measured, "{wake:?}");
            assert_eq!(check(&wake) == Some("wake.periods"), short, "{end}: {wake:?}");
        }
    }

    /// A large side force with a period of 0.5 s, a Strouhal number of 4: the wake has had 1.35 of its periods in 10 diameters.
    #[test]
    fn vibration_of_the_canopy_does_not_count_as_periods_of_the_wake() {
        let at = |end: f64, period: f64| {
            Wake::of(&stage(end, |t| 300.0 * (TAU * t / period).sin(), |_| 0.0)).expect("a wake")
        };
        let wake = at(40.0, 0.5);
        assert_eq!((wake.periods_measured, wake.strouhal, check(&wake)), (false, None, Some("wake.periods")));
        assert!((wake.periods - 1.35).abs() < 0.01, "{wake:?}");
        // On both sides of the bound, with a stream of 0.5 diameters a second.
        for (strouhal, measured) in [(0.32, false), (0.28, true)] {
            let wake = at(200.0, 2.0 / strouhal);
            assert_eq!((wake.periods_measured, wake.strouhal.is_some()), (measured, measured), "{wake:?}");
        }
    }

    /// A short stage with a small side force: its symmetry is not known, whatever the period of the breathing canopy.
    #[test]
    fn short_stage_has_one_verdict_with_the_side_force() {
        for end in [10.0, 116.0] {
            let wake = Wake::of(&stage(end, |t| 9.0 * (TAU * t / 0.5).sin(), |_| 0.0)).expect("a wake");
            assert_eq!(
                (wake.periods_measured, check(&wake)),
                (false, Some("wake.periods")),
                "{end}: {wake:?}"
            );
            let text = warning(&wake);
            assert!(text.contains("rms side force 6.3") && text.contains("0.64 % of the drag"), "{text}");
        }
        let long = Wake::of(&stage(121.0, |t| 9.0 * (TAU * t / 0.5).sin(), |_| 0.0)).expect("a wake");
        assert_eq!(check(&long), Some("wake.symmetric"));
    }

    #[test]
    fn no_wake_without_a_stream() {
        assert_eq!(Wake::of(&[]), None);
        assert_eq!(Wake::of(&[Sample { time_s: 1.0, ..Sample::default() }]), None);
        let one = Sample {
            time_s: 1.0,
            diameters: 0.5,
            drag_n: 10.0,
            side_n: [3.0, 4.0],
            pendulum_deg: None,
            pendulum_xy_deg: None,
            speed_m_s: 1.0,
        };
        let wake = Wake::of(&[one]).expect("a wake");
        assert_eq!((wake.side_force_rms_n, wake.pendulum_rms_deg, wake.strouhal), (5.0, None, None));
    }
}
