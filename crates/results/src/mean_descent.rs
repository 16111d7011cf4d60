//! Mean motion of a coupled stage relative to the air: what a trajectory continues.

use std::path::Path;

use case::{AirMotion, Scene, StageTimes};
use coupling::error::RunError;

use crate::history;
use crate::settled::SettledMean;
use crate::wake::Wake;

/// Mean velocity of the air past the frame over the settled part of a stage.
#[derive(Clone, Debug, PartialEq)]
pub struct MeanDescent {
    /// Mean velocity of the undisturbed air relative to the frame, m/s.
    pub air_m_s: [f64; 3],
    /// Start and end of the mean, s since the start of the stage.
    pub from_s: f64,
    /// End, s.
    pub to_s: f64,
    /// Half width of the 95 % interval of the mean descent speed, m/s; `None`: not settled.
    pub interval_95: Option<f64>,
    /// Why the mean is not that of a settled descent: it has no interval, or the wake is not developed.
    pub doubt: Option<String>,
}

impl MeanDescent {
    /// Of `stage` of the run in `out`: over the settled part of its descent speed, over its last half where that has no
    /// settled part.
    ///
    /// # Errors
    /// The stage has no history with a window.
    pub fn of_stage(scene: &Scene, out: &Path, stage: usize) -> Result<Self, RunError> {
        let file = case::stage_folder(out, scene, stage).join("history.csv");
        let (columns, _) = history::read_complete_rows(&file)?;
        let undisturbed = scene.air_motion(stage, &StageTimes::completed(scene, out, stage));
        let air = |t: f64, z: f64| air_over_ground(scene, &undisturbed, t, z);
        Self::of_history(&columns, scene.resolved().initial_velocity_m_s, air).ok_or_else(|| {
            RunError::Input(format!(
                "{} has no window whose mean velocity a trajectory could continue: run stage `{}` first, with the same --out",
                file.display(),
                scene.stages[stage].name
            ))
        })
    }

    /// Of the columns of a history, where `air` gives the velocity of the air over ground (m/s) at a time (s) and a position of
    /// the frame (m); a frame that moves vertically keeps the horizontal part of `held` (m/s). `None` without a window.
    fn of_history(
        columns: &[(String, Vec<f64>)],
        held: [f64; 3],
        air: impl Fn(f64, f64) -> [f64; 3],
    ) -> Option<Self> {
        let column = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..]);
        let (time, speed) = (column("time_s")?, column("descent_speed_m_s")?);
        let value = |name: &str, k: usize, other: f64| {
            column(name).and_then(|v| v.get(k)).copied().filter(|v| v.is_finite()).unwrap_or(other)
        };
        let to_s = *time.last()?;
        let settled = SettledMean::of("descent_speed_m_s", columns);
        let from_s = settled.as_ref().map_or(0.5 * to_s, |s| s.from_s);
        // The history begins with the end of the first window.
        let (mut sum, mut whole) = ([0.0; 3], 0.0);
        for k in (0..time.len()).filter(|k| time[*k] > from_s) {
            let dt = time[k] - if k == 0 { 0.0 } else { time[k - 1] };
            let air = air(time[k], value("frame_z_m", k, 0.0));
            let frame = [value("frame_vx_m_s", k, held[0]), value("frame_vy_m_s", k, held[1]), -speed[k]];
            sum = std::array::from_fn(|i| sum[i] + dt * (air[i] - frame[i]));
            whole += dt;
        }
        (whole > 0.0).then(|| Self {
            air_m_s: sum.map(|s| s / whole),
            from_s,
            to_s,
            interval_95: settled.as_ref().and_then(|s| s.interval_95),
            doubt: doubt(settled.as_ref(), columns),
        })
    }
}

/// Why the mean of a history is not that of a settled descent.
fn doubt(settled: Option<&SettledMean>, columns: &[(String, Vec<f64>)]) -> Option<String> {
    let Some(settled) = settled else { return Some("it has fewer than 40 windows".into()) };
    let no_interval = settled.no_interval.as_ref().map(|why| format!("it has no interval, since {why}"));
    let undeveloped = || {
        let verdict = Wake::of_history(columns)?.verdict()?;
        Some(format!("{} [{}]", verdict.figure, verdict.check))
    };
    no_interval.or_else(undeveloped)
}

/// Velocity over ground (m/s) of the undisturbed air at `t` (s since the start of the stage of `air`) around a frame at `z` (m, relative to
/// its release).
pub fn air_over_ground(scene: &Scene, air: &AirMotion, t: f64, z: f64) -> [f64; 3] {
    // At the start of a stage the wind is its own.
    air.at(t.max(f64::MIN_POSITIVE)).over_ground(scene.release_height().unwrap_or(0.0) + z)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history(end: f64, drift: bool) -> Vec<(String, Vec<f64>)> {
        let time: Vec<f64> = (1..=(end / 0.02) as u32).map(|k| 0.02 * f64::from(k)).collect();
        let swing =
            |t: f64| 0.6 * (std::f64::consts::TAU * t / 2.2).sin() + 0.1 * (11.3 * t * t.sqrt()).sin();
        let speed = time.iter().map(|t| 4.6 + swing(*t)).collect();
        let mut columns = vec![("descent_speed_m_s".into(), speed)];
        if drift {
            columns.push(("frame_vx_m_s".into(), time.iter().map(|t| 1.5 - 0.5 * swing(*t)).collect()));
            columns.push(("frame_vy_m_s".into(), vec![-0.25; time.len()]));
            columns.push(("frame_z_m".into(), time.iter().map(|t| -4.6 * t).collect()));
        }
        columns.insert(0, ("time_s".into(), time));
        columns
    }

    /// The settled part of a drifting frame in a wind that grows with height; the horizontal velocity of one that is held.
    #[test]
    fn mean_is_relative_to_the_air_at_its_height() {
        let wind = |_: f64, z: f64| [2.0 + 0.01 * z, 0.0, 0.3];
        let mean = MeanDescent::of_history(&history(60.0, true), [0.0; 3], wind).expect("windows");
        let z = -4.6 * 0.5 * (mean.from_s + mean.to_s);
        let half = mean.interval_95.expect("an interval");
        assert!((mean.air_m_s[0] - (2.0 + 0.01 * z - 1.5)).abs() < 0.5 * half + 1e-3, "{mean:?}");
        assert!((mean.air_m_s[1] - 0.25).abs() < 1e-12, "{mean:?}");
        assert!((mean.air_m_s[2] - 4.9).abs() < half, "{mean:?}");
        let held = MeanDescent::of_history(&history(60.0, false), [0.5, 0.0, 0.0], |_, _| [2.0, 0.0, 0.0]);
        assert!((held.expect("windows").air_m_s[0] - 1.5).abs() < 1e-12);
    }

    /// A settled mean of a wake that is still symmetric is not one of a settled descent.
    #[test]
    fn undeveloped_wake_is_a_doubt() {
        let mut columns = history(60.0, false);
        let windows = columns[0].1.len();
        assert_eq!(
            MeanDescent::of_history(&columns, [0.0; 3], |_, _| [0.0; 3]).expect("windows").doubt,
            None
        );
        let passed = (0..windows).map(|k| 1e-2 * k as f64).collect();
        let constant = |value: f64| vec![value; windows];
        columns.extend([
            ("drag_n".into(), constant(1000.0)),
            ("force_x_n".into(), constant(1.0)),
            ("force_y_n".into(), constant(0.0)),
            ("stream_diameters".into(), passed),
            ("stream_speed_m_s".into(), constant(4.6)),
        ]);
        let mean = MeanDescent::of_history(&columns, [0.0; 3], |_, _| [0.0; 3]).expect("windows");
        assert!(mean.interval_95.is_some(), "{mean:?}");
        assert!(mean.doubt.as_ref().is_some_and(|why| why.contains("[wake.")), "{mean:?}");
    }

    #[test]
    fn short_stage_gives_the_mean_of_its_last_half_and_says_why() {
        let mean = MeanDescent::of_history(&history(0.4, false), [0.0; 3], |_, _| [0.0; 3]).expect("windows");
        assert_eq!((mean.interval_95, mean.from_s), (None, 0.2));
        assert_eq!(mean.doubt.as_deref(), Some("it has fewer than 40 windows"));
        let none = vec![("time_s".into(), vec![]), ("descent_speed_m_s".into(), vec![])];
        assert_eq!(MeanDescent::of_history(&none, [0.0; 3], |_, _| [0.0; 3]), None);
    }
}
