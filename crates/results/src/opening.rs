//! Opening of a canopy in a stage: line stretch, filling, largest force, in the quantities of Knacke, Parachute Recovery Systems Design Manual (1991), chapter 5.
//!
//! - **Line stretch:** the first window whose riser force reaches 5 % of the largest of the stage.
//! - **Filling** ends at the first full opening: the first maximum of the projected area that reaches nine tenths of the largest of the stage and is not exceeded
//!   within a tenth of the time since line stretch. The filling constant is $`n = t_f v_s / D_0`$ with the speed $`v_s`$ of the air at line stretch.
//! - **Largest force** F of the risers, over the dynamic pressure at line stretch and the nominal area: $`F / (q_s S_0)`$. Divided by the drag coefficient of the
//!   open canopy on $`S_0`$ it is the opening force coefficient $`C_X X_1`$.
//! - **Mean force:** the largest mean of the riser force over a tenth of $`D_0 / v_s`$. Where the largest force is larger by more than a tenth and the force swings about its mean there with a period
//!   below half of that time, it is that of a vibration. A single short peak (a snatch, a pulse that the payload feels) is none.
//! - **Force coefficient** of the moment, $`C_F = F / (q S_0)`$ with the dynamic pressure of the same window. Its largest value from line stretch to a quarter of the filling
//!   time after the first full opening, over the drag coefficient of the open canopy, is the inflation factor of Lingard: that of a canopy in a wind tunnel, from which
//!   the payload's loss of speed is taken out. Where the stream falls below a fifth of its speed at line stretch in that time, the canopy carries the air that it holds and not
//!   the stream, and there is no such coefficient.

use coupling::interface::CanopyInterface;
use serde::{Deserialize, Serialize};

use crate::wake::diameter;

/// Growth of the projected area over a stage from which on it is an opening.
const GROWTH: f64 = 1.5;
/// Share of the largest riser force that is line stretch.
const STRETCHED: f64 = 0.05;
/// Share of the largest projected area that a first full opening has at least.
const FULL: f64 = 0.9;
/// Time in which the projected area does not exceed its first maximum, as a share of the time since line stretch.
const HELD: f64 = 0.1;
/// Time after the first full opening in which the force coefficient has its largest value, as a share of the filling time: the force of a canopy in a wind tunnel follows its area by a tenth.
const AFTER: f64 = 0.25;

/// Least share of the speed at line stretch at which forces are compared with the dynamic pressure of the same window.
const STREAMING: f64 = 0.2;

/// Time over which the mean force is taken, in $`D_0 / v_s`$. A canopy fills in three to ten $`D_0 / v_s`$.
const AVERAGING: f64 = 0.1;
/// Ratio of the largest force at an instant to the largest mean from which the former may be a vibration. Nine openings have 1.01 to 1.17, the larger ones by single pulses; a light canopy on stiff risers
/// has 1.57.
const VIBRATES: f64 = 1.1;
/// Crossings of the mean within the averaging time of the largest force, before and after it, from which on it is one: four periods. The nine have 3 and 4 where they exceed the ratio, the light one 35.
const CROSSINGS: usize = 8;
/// Check of the table that this is.
const CHECK: &str = "opening.vibrating-force";

/// Air and canopy that the figures of an opening refer to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OpeningReference {
    /// Density of the undisturbed air, kg/m3.
    pub density_kg_m3: f64,
    /// Nominal area $`S_0`$, m2: of gores with vent and gaps, else of the fabric.
    pub nominal_area_m2: f64,
    /// Mass of payload, fabric and lines, kg; `None` where the confluence point is held.
    pub mass_kg: Option<f64>,
}

impl OpeningReference {
    /// Of a scene; `None` without a canopy or a flow.
    pub fn of(scene: &case::Scene, interface: &CanopyInterface) -> Option<Self> {
        let nominal_area_m2 = match &scene.canopy {
            case::Canopy::Gored(g) => g.nominal_area(),
            _ => interface.sizes.fabric_area,
        };
        let flow = scene.flow.as_ref().filter(|_| nominal_area_m2 > 0.0)?;
        let mass_kg = scene.descent.as_ref().map(|d| d.payload_mass_kg + interface.masses.suspended());
        Some(Self { density_kg_m3: flow.density_kg_m3, nominal_area_m2, mass_kg })
    }

    /// Nominal diameter $`D_0`$, m.
    pub fn nominal_diameter(&self) -> f64 {
        diameter(self.nominal_area_m2)
    }

    /// Mass over the air in a cube of the nominal diameter, $`m / (\rho D_0^3)`$.
    pub fn mass_ratio(&self) -> Option<f64> {
        self.mass_kg.map(|m| m / (self.density_kg_m3 * self.nominal_diameter().powi(3)))
    }
}

/// The opening of a canopy in a stage.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Opening {
    /// Time of line stretch, s from the start of the stage.
    pub line_stretch_s: f64,
    /// Speed of the undisturbed air relative to the frame at line stretch, m/s.
    pub speed_m_s: f64,
    /// Time of the first full opening, s; `None` where the canopy is still opening at the end.
    pub opened_s: Option<f64>,
    /// Projected area then, m2.
    pub opened_area_m2: Option<f64>,
    /// Filling time from line stretch, s.
    pub filling_time_s: Option<f64>,
    /// Filling constant $`t_f v_s / D_0`$.
    pub filling_constant: Option<f64>,
    /// Largest force of the risers at the end of a window, N.
    pub largest_force_n: f64,
    /// Its time, s.
    pub largest_force_s: f64,
    /// The same over dynamic pressure at line stretch and nominal area.
    pub largest_force_share: f64,
    /// Largest mean of the force of the risers over `averaging_s`, N; `None` where a window is longer, or the stage shorter.
    #[serde(default)]
    pub largest_mean_force_n: Option<f64>,
    /// A tenth of the nominal diameter over the speed at line stretch, s.
    #[serde(default)]
    pub averaging_s: f64,
    /// How often the force crosses its mean within `averaging_s` of the largest one, before and after it.
    #[serde(default)]
    pub force_crossings: usize,
    /// Largest force coefficient $`F / (q S_0)`$ with the dynamic pressure of the same window; `None` where the canopy is still opening at the end, and
    /// where the stream falls below a fifth of its speed at line stretch.
    pub largest_coefficient: Option<f64>,
    /// Its time, s.
    pub largest_coefficient_s: Option<f64>,
    /// Mass ratio $`m / (\rho D_0^3)`$; `None` where the confluence point is held (infinite mass).
    pub mass_ratio: Option<f64>,
    /// Nominal diameter, m.
    pub nominal_diameter_m: f64,
}

/// Value and place of the largest of `values`.
fn largest(values: &[f64]) -> Option<(usize, f64)> {
    let finite = values.iter().copied().enumerate().filter(|(_, v)| v.is_finite());
    finite.max_by(|a, b| a.1.total_cmp(&b.1))
}

impl Opening {
    /// Of the columns of a `history.csv`; `None` where the stage has no opening: its projected area grows by less than half.
    pub fn of_history(columns: &[(String, Vec<f64>)], reference: &OpeningReference) -> Option<Self> {
        let get = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..]);
        let (time, area, force) = (get("time_s")?, get("projected_area_m2")?, get("riser_force_n")?);
        let (_, widest) = largest(area)?;
        let (peak, most) = largest(force)?;
        if widest < GROWTH * area.first()? || most <= 0.0 {
            return None;
        }
        let start = force.iter().position(|f| *f >= STRETCHED * most)?;
        let speeds = get("stream_speed_m_s")?;
        let speed = *speeds.get(start).filter(|v| **v > 0.0)?;
        let full = first_opening(time, area, start, FULL * widest);
        let filling = full.map(|k| time[k] - time[start]);
        let area_force =
            |speed: f64| 0.5 * reference.density_kg_m3 * speed * speed * reference.nominal_area_m2;
        let coefficient = full.and_then(|k| {
            let until = time[k] + AFTER * (time[k] - time[start]);
            let windows = start..time.iter().position(|t| *t > until).unwrap_or(time.len());
            let streams = speeds[windows.clone()].iter().all(|v| *v >= STREAMING * speed);
            let values: Vec<f64> = windows.map(|k| force[k] / area_force(speeds[k])).collect();
            largest(&values).filter(|_| streams).map(|(k, value)| (time[start + k], value))
        });
        let averaging = AVERAGING * reference.nominal_diameter() / speed;
        Some(Self {
            largest_mean_force_n: largest_mean(time, force, averaging),
            averaging_s: averaging,
            force_crossings: crossings(time, force, peak, averaging),
            line_stretch_s: time[start],
            speed_m_s: speed,
            opened_s: full.map(|k| time[k]),
            opened_area_m2: full.map(|k| area[k]),
            filling_time_s: filling,
            filling_constant: filling.map(|t| t * speed / reference.nominal_diameter()),
            largest_force_n: most,
            largest_force_s: time[peak],
            largest_force_share: most / area_force(speed),
            largest_coefficient: coefficient.map(|(_, value)| value),
            largest_coefficient_s: coefficient.map(|(time, _)| time),
            mass_ratio: reference.mass_ratio(),
            nominal_diameter_m: reference.nominal_diameter(),
        })
    }

    /// The largest force at an instant where it is a vibration, and the largest mean, in words.
    pub fn vibration(&self) -> Option<String> {
        let mean = self.largest_mean_force_n.filter(|mean| self.largest_force_n > VIBRATES * mean)?;
        let vibrates = self.force_crossings >= CROSSINGS;
        vibrates.then(|| {
            format!(
                "the largest riser force is {:.0} N at an instant and {mean:.0} N in the mean over {:.4} s, a tenth of D0/v ({:.0} % less); it crosses its mean {} times within that time before \
                 and after",
                self.largest_force_n,
                self.averaging_s,
                100.0 * (1.0 - mean / self.largest_force_n),
                self.force_crossings
            )
        })
    }

    /// The warning about `stage`; `None` where the largest force is no vibration.
    pub fn warning(&self, stage: &str) -> Option<String> {
        let vibration = self.vibration()?;
        Some(format!(
            "stage `{stage}`: {vibration} [{CHECK}]. Lines and risers vibrate: line stretch, force coefficients and safety factors of this stage are those of instants. Remedy: state the \
             mean with its averaging time; give light canopies lines and risers of their size"
        ))
    }

    /// The figures in words.
    pub fn line(&self) -> String {
        let filled = match (self.filling_time_s, self.filling_constant) {
            (Some(time), Some(n)) => format!("filled in {time:.3} s, {n:.2} D0/v"),
            _ => "still filling at the end".into(),
        };
        let mass = self.mass_ratio.map_or("infinite mass".into(), |r| format!("mass ratio {r:.3}"));
        let coefficient = self
            .largest_coefficient
            .map_or_else(String::new, |c| format!(", {c:.3} at most with q of the moment"));
        let mean = self.largest_mean_force_n.map_or_else(String::new, |force| {
            format!(", {force:.0} N in the mean over {:.4} s", self.averaging_s)
        });
        format!(
            "line stretch at {:.3} s with {:.2} m/s; {filled}; largest riser force {:.0} N at {:.3} s, {:.3} of q S0{coefficient}{mean} ({mass}, D0 {:.3} m)",
            self.line_stretch_s,
            self.speed_m_s,
            self.largest_force_n,
            self.largest_force_s,
            self.largest_force_share,
            self.nominal_diameter_m
        )
    }
}

/// Largest mean of `force` over `averaging` s, with the force of each window as that of its whole length; `None` where no window is short enough.
fn largest_mean(time: &[f64], force: &[f64], averaging: f64) -> Option<f64> {
    let lengths: Vec<f64> = time
        .iter()
        .enumerate()
        .map(|(k, t)| t - k.checked_sub(1).map_or(0.0, |before| time[before]))
        .collect();
    if averaging.is_nan() || averaging <= 0.0 || lengths.iter().any(|dt| *dt > averaging) {
        return None;
    }
    // Impulse from the start to the end of each window.
    let mut impulse = vec![0.0];
    force.iter().zip(&lengths).for_each(|(f, dt)| impulse.push(impulse[impulse.len() - 1] + f * dt));
    let until = |at: f64| {
        let k = time.partition_point(|t| *t < at).min(time.len() - 1);
        impulse[k + 1] - (time[k] - at) * force[k]
    };
    let means = time.iter().enumerate().filter(|(_, t)| **t >= averaging);
    largest(&means.map(|(k, t)| (impulse[k + 1] - until(t - averaging)) / averaging).collect::<Vec<_>>())
        .map(|(_, mean)| mean)
}

/// How often `force` crosses its mean over the windows within `reach` s of window `peak`.
fn crossings(time: &[f64], force: &[f64], peak: usize, reach: f64) -> usize {
    let near: Vec<f64> =
        time.iter().zip(force).filter(|(t, _)| (*t - time[peak]).abs() < reach).map(|(_, f)| *f).collect();
    let mean = near.iter().sum::<f64>() / near.len().max(1) as f64;
    near.windows(2).filter(|pair| (pair[0] > mean) != (pair[1] > mean)).count()
}

/// Mean drag over mean dynamic pressure in the last half of the windows of a history, the drag area $`C_D S`$, m2; `None` without a stream.
pub fn drag_area(columns: &[(String, Vec<f64>)], density: f64) -> Option<f64> {
    let get = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..]);
    let (drag, speed) = (get("drag_n")?, get("stream_speed_m_s")?);
    let late = drag.len() / 2..drag.len();
    let pressure: f64 = speed[late.clone()].iter().map(|v| 0.5 * density * v * v).sum();
    (pressure > 0.0).then(|| drag[late].iter().sum::<f64>() / pressure)
}

/// The first window from `start` on whose area is at least `least` and is not exceeded within a tenth of the time since `start`.
fn first_opening(time: &[f64], area: &[f64], start: usize, least: f64) -> Option<usize> {
    let end = time[time.len() - 1];
    (start + 1..time.len()).filter(|&k| area[k] >= least).find(|&k| {
        let until = time[k] + HELD * (time[k] - time[start]);
        let held = area[k + 1..].iter().zip(&time[k + 1..]).take_while(|(_, t)| **t <= until);
        until <= end && held.into_iter().all(|(a, _)| *a <= area[k])
    })
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    const REFERENCE: OpeningReference =
        OpeningReference { density_kg_m3: 1.2, nominal_area_m2: 0.25 * PI * 64.0, mass_kg: Some(122.88) };

    /// A canopy of D0 = 8 m in a stream of 20 m/s whose area grows to 32 m2 in 0.9 s from 0.1 s on, and swings by 2 m2 afterwards.
    fn history(end: f64) -> Vec<(String, Vec<f64>)> {
        let dt = 0.005;
        let time: Vec<f64> = (1..=(end / dt).round() as usize).map(|k| k as f64 * dt).collect();
        let area = |t: f64| {
            let share = ((t - 0.1) / 0.9).clamp(0.0, 1.0);
            let after = (t - 1.0).max(0.0);
            2.0 + 30.0 * share * share - (1.0 - (6.0 * after).cos())
        };
        let force = |t: f64| if t < 0.1 { 0.0 } else { 500.0 + 9000.0 * (-((t - 0.8) / 0.2).powi(2)).exp() };
        vec![
            ("stream_speed_m_s".into(), vec![20.0; time.len()]),
            ("projected_area_m2".into(), time.iter().map(|&t| area(t)).collect()),
            ("riser_force_n".into(), time.iter().map(|&t| force(t)).collect()),
            ("time_s".into(), time),
        ]
    }

    #[test]
    fn opening_is_measured_from_line_stretch() {
        let o = Opening::of_history(&history(3.0), &REFERENCE).expect("an opening");
        assert!((o.line_stretch_s - 0.1).abs() < 0.006, "{o:?}");
        assert!((o.speed_m_s - 20.0).abs() < 1e-9, "{o:?}");
        assert!((o.filling_time_s.unwrap() - 0.9).abs() < 0.006, "{o:?}");
        assert!((o.filling_constant.unwrap() - 0.9 * 20.0 / 8.0).abs() < 0.02, "{o:?}");
        assert!((o.largest_force_n - 9500.0).abs() < 1.0 && (o.largest_force_s - 0.8).abs() < 0.006);
        assert!((o.largest_force_share - 9500.0 / (240.0 * REFERENCE.nominal_area_m2)).abs() < 1e-4);
        assert!((o.mass_ratio.unwrap() - 0.2).abs() < 1e-12);
        assert!(o.line().contains("filled in 0.9"), "{}", o.line());
    }

    /// The mean over 40 ms of a peak with a standard deviation of 0.14 s is 0.35 % smaller. A vibration of 100 Hz on it leaves the mean and is warned of where it adds more than a tenth; a single pulse of
    /// 20 ms is no vibration, however large.
    #[test]
    fn vibration_of_the_risers_is_no_opening_load() {
        let quiet = Opening::of_history(&history(3.0), &REFERENCE).expect("an opening");
        let mean = quiet.largest_mean_force_n.expect("windows of 5 ms");
        assert!((quiet.averaging_s - 0.04).abs() < 1e-12 && quiet.warning("opening").is_none());
        assert!((mean - (500.0 + 9000.0 * (1.0 - 0.04f64.powi(2) / (24.0 * 0.02)))).abs() < 25.0, "{mean}");
        for (amplitude, warned) in [(800.0, false), (3000.0, true)] {
            let mut columns = history(3.0);
            let time = columns[3].1.clone();
            // Windows of 5 ms see it at two phases.
            columns[2]
                .1
                .iter_mut()
                .zip(&time)
                .for_each(|(f, t)| *f += amplitude * (PI * 200.0 * (t + 0.0025)).sin());
            let o = Opening::of_history(&columns, &REFERENCE).expect("an opening");
            assert!(o.largest_force_n > quiet.largest_force_n + 0.95 * amplitude, "{o:?}");
            assert!((o.largest_mean_force_n.unwrap() / mean - 1.0).abs() < 0.002, "{o:?} {mean}");
            assert_eq!(o.warning("opening").is_some(), warned, "{amplitude}: {o:?}");
            assert!(o.line().contains("in the mean over 0.0400 s"), "{}", o.line());
        }
        let mut pulse = history(3.0);
        let time = pulse[3].1.clone();
        pulse[2]
            .1
            .iter_mut()
            .zip(&time)
            .filter(|(_, t)| (*t - 0.8).abs() < 0.0101)
            .for_each(|(f, _)| *f += 5000.0);
        let o = Opening::of_history(&pulse, &REFERENCE).expect("an opening");
        assert!(
            o.largest_force_n > 1.15 * o.largest_mean_force_n.unwrap() && o.force_crossings <= 2,
            "{o:?}"
        );
        assert_eq!(o.vibration(), None);
        // Windows longer than the averaging time say nothing.
        let mut coarse = history(3.0);
        coarse.iter_mut().for_each(|(_, v)| *v = v.iter().copied().step_by(10).collect());
        let o = Opening::of_history(&coarse, &REFERENCE).expect("an opening");
        assert_eq!((o.largest_mean_force_n, o.vibration()), (None, None));
    }

    /// A payload that slows down: the largest force coefficient comes after the largest force, and neither before line stretch nor long after the opening does a
    /// slow stream count.
    #[test]
    fn force_coefficient_has_the_pressure_of_its_moment() {
        let mut columns = history(3.0);
        let time = columns[3].1.clone();
        let slow = |t: f64| if (0.1..1.3).contains(&t) { 20.0 - 10.0 * (t - 0.1) } else { 0.5 };
        columns[0].1 = time.iter().map(|&t| slow(t)).collect();
        let o = Opening::of_history(&columns, &REFERENCE).expect("an opening");
        let of = |t: f64| {
            (500.0 + 9000.0 * (-((t - 0.8) / 0.2).powi(2)).exp())
                / (0.6 * slow(t) * slow(t) * REFERENCE.nominal_area_m2)
        };
        let expected = time.iter().filter(|t| **t > 0.1 && **t < 1.22).map(|&t| of(t)).fold(0.0, f64::max);
        let found = o.largest_coefficient.unwrap();
        assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        assert!(o.largest_coefficient_s.unwrap() > o.largest_force_s + 0.02, "{o:?}");
        assert!(found > 1.5 * o.largest_force_share, "{o:?}");
        assert!(o.line().contains("with q of the moment"), "{}", o.line());
    }

    /// A payload that the canopy stops, and that bounces: no dynamic pressure to divide by, and no coefficient.
    #[test]
    fn a_payload_that_stops_has_no_force_coefficient() {
        for (slowest, stated) in [(4.1, true), (3.9, false), (-2.0, false)] {
            let mut columns = history(3.0);
            let late: Vec<bool> = columns[3].1.iter().map(|t| *t > 0.9).collect();
            columns[0].1.iter_mut().zip(late).filter(|(_, late)| *late).for_each(|(v, _)| *v = slowest);
            let o = Opening::of_history(&columns, &REFERENCE).expect("an opening");
            assert_eq!(o.largest_coefficient.is_some(), stated, "{slowest} m/s: {o:?}");
            assert_eq!(o.line().contains("with q of the moment"), stated, "{}", o.line());
        }
    }

    /// The drag area of a canopy with a constant drag of 6 kN in air of 20 m/s.
    #[test]
    fn drag_area_is_drag_over_dynamic_pressure() {
        let mut columns = history(3.0);
        columns.push(("drag_n".into(), vec![6000.0; columns[0].1.len()]));
        assert!((drag_area(&columns, 1.2).unwrap() - 25.0).abs() < 1e-9);
    }

    /// A stage that ends before the area has stopped to grow states no filling time; one without growth is no opening.
    #[test]
    fn openings_that_have_not_ended_are_no_figures() {
        let o = Opening::of_history(&history(0.9), &REFERENCE).expect("an opening");
        assert_eq!((o.filling_time_s, o.filling_constant, o.largest_coefficient), (None, None, None));
        assert!(o.line().contains("still filling"), "{}", o.line());
        let mut open = history(3.0);
        open.iter_mut().for_each(|(_, v)| *v = v.split_off(190));
        assert_eq!(Opening::of_history(&open, &REFERENCE), None);
    }
}
