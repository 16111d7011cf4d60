//! Stability derivatives of a body whose rotation oscillates as prescribed.
//!
//! A coefficient of the force or moment is fitted by least squares to
//! ```math
//! C = C_0 + C_\theta (\theta - \bar\theta) + C_{\dot\theta} \frac{\dot\theta l}{2 V}
//! ```
//! The part in phase with the angle is the static derivative, the part out of phase with it the damping derivative. An oscillation about a fixed axis changes
//! angle of attack and rate of rotation together, so the damping derivative is the sum $`C_{mq} + C_{m\dot\alpha}`$ of both; an oscillation alone cannot separate them.

use std::ops::Range;
use std::path::Path;

use case::{BodyMotion, ForceCoefficients, Forces, Pose, RigidMotion, Scene};
use serde::{Deserialize, Serialize};

use crate::history;
use crate::long_term::student;

/// The method in words, for tables and files.
pub const METHOD: &str = "least squares of C = C0 + C_a (a - mean) + C_q (da/dt) l/(2V) in each whole period, the first one left out; mean of the periods, 95 % interval by \
                          Student's t of their scatter, for at least three periods without serial correlation (von Neumann ratio at least 1); C_q is the sum of the \
                          derivatives by rate of rotation and by rate of the angle of attack";

/// Fewest whole periods of an interval.
const MIN_PERIODS: usize = 3;
/// Smallest von Neumann ratio of the periods, as of the batches of a settled mean: squared differences of successive periods over squared deviations from
/// their mean. Independent periods have 2 on average.
const MIN_VON_NEUMANN_RATIO: f64 = 1.0;
/// Scatter of the periods relative to the coefficients of the fit that is round-off.
const ROUND_OFF: f64 = 1e-9;
/// Fewest windows in a period.
const MIN_WINDOWS: usize = 12;
/// Largest difference of a period from the mean period, as a share.
const UNEQUAL: f64 = 0.02;
/// Share of a period that must have passed before one counts.
const STARTED: f64 = 0.9;

/// Derivatives of a coefficient.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Derivatives {
    /// Coefficient: `normal force`, `axial force`, or `moment` about the axis of the rotation.
    pub coefficient: String,
    /// Its value at the mean angle.
    pub mean: f64,
    /// Static derivative: the part in phase with the angle, 1/rad.
    pub static_per_rad: f64,
    /// Half width of its 95 % interval; `None` for fewer than three periods, or periods with serial correlation.
    pub static_interval_95: Option<f64>,
    /// Damping derivative: the part in phase with the rate of the angle, over l/(2V).
    pub damping_per_rad: f64,
    /// Half width of its 95 % interval; `None` for fewer than three periods, or periods with serial correlation.
    pub damping_interval_95: Option<f64>,
    /// Share of the variance of the coefficient that the fit explains.
    pub explained: f64,
}

/// Stability derivatives of a stage with a body whose rotation oscillates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ForcedOscillation {
    /// Entry of `[[flow.forces.coefficients]]`.
    pub entry: String,
    /// Mean angle of the rotation, degrees.
    pub mean_angle_deg: f64,
    /// Half of the difference of largest and smallest angle, degrees.
    pub amplitude_deg: f64,
    /// Period, s.
    pub period_s: f64,
    /// Whole periods that are fitted.
    pub periods: u64,
    /// Reference speed of the coefficients, m/s.
    pub speed_m_s: f64,
    /// Reduced frequency k = omega l / (2 V).
    pub reduced_frequency: f64,
    /// Of normal force, axial force and moment, as far as they are defined.
    pub derivatives: Vec<Derivatives>,
    /// Method of fit and interval.
    pub method: String,
}

/// Angle (rad), its rate (rad/s) and a coefficient at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AngleSample {
    /// Time, s.
    pub time_s: f64,
    /// Angle, rad.
    pub angle: f64,
    /// Rate of the angle, rad/s.
    pub rate: f64,
}

/// Whole periods of `samples`, without the first; `None` where the angle is not periodic, or has no whole period after the first.
pub fn whole_periods(samples: &[AngleSample]) -> Option<Vec<Range<usize>>> {
    let middle = middle(samples)?;
    let rises = |k: &usize| samples[k - 1].angle < middle && samples[*k].angle >= middle;
    let rises: Vec<usize> = (1..samples.len()).filter(rises).collect();
    let times: Vec<f64> = rises.iter().map(|&k| rise_time(samples, k, middle)).collect();
    let count = times.len().checked_sub(1).filter(|n| *n > 0)?;
    let period = (times[count] - times[0]) / count as f64;
    let equal = times.windows(2).all(|t| (t[1] - t[0] - period).abs() <= UNEQUAL * period);
    let begun = samples[0].time_s + STARTED * period;
    let whole: Vec<Range<usize>> =
        (0..count).filter(|&p| times[p] >= begun).map(|p| rises[p]..rises[p + 1]).collect();
    let resolved = whole.iter().all(|p| p.len() >= MIN_WINDOWS);
    (equal && resolved && !whole.is_empty()).then_some(whole)
}

/// Middle between the largest and the smallest angle of the second half of `samples`, rad; `None` where the angle is at rest.
fn middle(samples: &[AngleSample]) -> Option<f64> {
    let late = &samples[samples.len() / 2..];
    let (low, high) = late.iter().fold((f64::MAX, f64::MIN), |(l, h), s| (l.min(s.angle), h.max(s.angle)));
    (high > low).then_some(0.5 * (low + high))
}

/// Time at which the angle rises through `middle` between the samples `k - 1` and `k`, s: linear interpolation.
fn rise_time(samples: &[AngleSample], k: usize, middle: f64) -> f64 {
    let (a, b) = (&samples[k - 1], &samples[k]);
    a.time_s + (b.time_s - a.time_s) * (middle - a.angle) / (b.angle - a.angle)
}

/// Mean of whole `periods` of `samples`, s.
fn mean_period(samples: &[AngleSample], periods: &[Range<usize>]) -> Option<f64> {
    let middle = middle(samples)?;
    let [start, end] = [periods.first()?.start, periods.last()?.end].map(|k| rise_time(samples, k, middle));
    Some((end - start) / periods.len() as f64)
}

/// Half width of the 95 % interval of the mean of `values`, one of each period, by Student's t; `None` for fewer than three, and where they are serially
/// correlated: their scatter is then no measure of the error of their mean. Scatter up to `round_off` counts as none.
fn half_width(values: &[f64], round_off: f64) -> Option<f64> {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let square = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    let differences = values.windows(2).map(|v| (v[1] - v[0]).powi(2)).sum::<f64>();
    let independent = differences >= MIN_VON_NEUMANN_RATIO * square || square <= n * round_off * round_off;
    (values.len() >= MIN_PERIODS && independent)
        .then(|| student(values.len() - 1) * (square / (n * (n - 1.0))).sqrt())
}

/// Derivatives of the coefficient `values` (one for each of `samples`) in whole `periods`, about the angle `mean` (rad); `half_time`: l/(2V), s.
/// `None` where the angle is at rest in a period.
///
/// # Examples
///
/// ```
/// use results::forced_oscillation::{AngleSample, derivatives, whole_periods};
///
/// let sample = |k: u32| {
///     let t = 0.01 * f64::from(k);
///     AngleSample { time_s: t, angle: 0.1 * (3.0 * t).sin(), rate: 0.3 * (3.0 * t).cos() }
/// };
/// let samples: Vec<_> = (0..2000).map(sample).collect();
/// let moment: Vec<f64> = samples.iter().map(|s| 0.02 - 0.5 * s.angle - 2.0 * s.rate * 0.05).collect();
/// let periods = whole_periods(&samples).expect("periods");
/// let found = derivatives("moment", &samples, &moment, &periods, 0.0, 0.05).expect("a fit");
/// assert!((found.static_per_rad + 0.5).abs() < 1e-12 && (found.damping_per_rad + 2.0).abs() < 1e-12);
/// ```
pub fn derivatives(
    coefficient: &str,
    samples: &[AngleSample],
    values: &[f64],
    periods: &[Range<usize>],
    mean: f64,
    half_time: f64,
) -> Option<Derivatives> {
    let fits: Vec<[f64; 3]> = periods
        .iter()
        .map(|p| fit(&samples[p.clone()], &values[p.clone()], mean, half_time))
        .collect::<Option<_>>()?;
    let n = fits.len() as f64;
    let average = |i: usize| fits.iter().map(|f| f[i]).sum::<f64>() / n;
    let [constant, stiffness, damping] = [0, 1, 2].map(average);
    let round_off = ROUND_OFF * (constant.abs() + stiffness.abs() + damping.abs());
    let interval = |i: usize| half_width(&fits.iter().map(|f| f[i]).collect::<Vec<_>>(), round_off);
    let kept = || periods.iter().flat_map(Clone::clone);
    let centre = kept().map(|k| values[k]).sum::<f64>() / kept().count() as f64;
    let (mut left, mut all) = (0.0, 0.0);
    for k in kept() {
        let s = &samples[k];
        let model = constant + stiffness * (s.angle - mean) + damping * half_time * s.rate;
        left += (values[k] - model).powi(2);
        all += (values[k] - centre).powi(2);
    }
    Some(Derivatives {
        coefficient: coefficient.into(),
        mean: constant,
        static_per_rad: stiffness,
        static_interval_95: interval(1),
        damping_per_rad: damping,
        damping_interval_95: interval(2),
        explained: if all > 0.0 { 1.0 - left / all } else { 0.0 },
    })
}

/// Constant, static and damping derivative of one period by least squares.
fn fit(samples: &[AngleSample], values: &[f64], mean: f64, half_time: f64) -> Option<[f64; 3]> {
    let n = samples.len() as f64;
    let average = |of: &dyn Fn(usize) -> f64| (0..samples.len()).map(of).sum::<f64>() / n;
    let angle = average(&|k| samples[k].angle);
    let rate = average(&|k| half_time * samples[k].rate);
    let value = average(&|k| values[k]);
    let about = |k: usize| [samples[k].angle - angle, half_time * samples[k].rate - rate, values[k] - value];
    let moment = |i: usize, j: usize| average(&|k| about(k)[i] * about(k)[j]);
    let [aa, ar, rr, av, rv] = [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2)].map(|(i, j)| moment(i, j));
    let determinant = aa * rr - ar * ar;
    let stiffness = (av * rr - rv * ar) / determinant;
    let damping = (rv * aa - av * ar) / determinant;
    let constant = value - stiffness * (angle - mean) - damping * rate;
    [constant, stiffness, damping].iter().all(|x| x.is_finite()).then_some([constant, stiffness, damping])
}

type Vector = [f64; 3];

fn dot(a: Vector, b: Vector) -> f64 {
    a.iter().zip(&b).map(|(a, b)| a * b).sum()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn unit(a: Vector) -> Option<Vector> {
    let length = dot(a, a).sqrt();
    (length > 1e-9).then(|| a.map(|x| x / length))
}

/// Columns of a table by name.
struct Columns(Vec<(String, Vec<f64>)>);

impl Columns {
    fn get(&self, name: &str) -> Option<&[f64]> {
        self.0.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..])
    }

    /// Vector with the components `{prefix}_x{suffix}` and so on in row `k`.
    fn vector(&self, prefix: &str, suffix: &str, k: usize) -> Option<Vector> {
        let mut v = [0.0; 3];
        for (v, axis) in v.iter_mut().zip(["x", "y", "z"]) {
            *v = *self.get(&format!("{prefix}_{axis}_{suffix}"))?.get(k)?;
        }
        Some(v)
    }
}

/// What turns in a stage, and the entry of the forces on it.
struct Turning<'a> {
    forces: &'a Forces,
    entry: &'a ForceCoefficients,
    motion: RigidMotion,
    axis: Vector,
    point: Vector,
}

impl<'a> Turning<'a> {
    /// The first rotation of the stage whose patches all belong to an entry.
    fn of(scene: &'a Scene, stage: usize) -> Option<Self> {
        let forces = scene.flow.as_ref()?.forces.as_ref()?;
        let whole = |m: &&BodyMotion, e: &ForceCoefficients| m.patches.iter().all(|p| e.patches.contains(p));
        scene.stages.get(stage)?.body_motions.iter().filter(|m| m.rotation.is_some()).find_map(|m| {
            let entry = forces.coefficients.iter().find(|e| whole(&m, e))?;
            let rotation = m.rotation.as_ref()?;
            let axis = unit(rotation.axis)?;
            let motion = m.compiled().ok()?;
            Some(Self { forces, entry, motion, axis, point: rotation.point_m })
        })
    }

    fn sample(&self, time_s: f64, step: f64) -> AngleSample {
        let angle = |t: f64| self.motion.at(t).angle;
        let rate = (angle(time_s + step) - angle(time_s - step)) / (2.0 * step);
        AngleSample { time_s, angle: angle(time_s), rate }
    }

    /// Force that makes a coefficient of 1, N: the mean over the rows.
    fn scale(&self, columns: &Columns) -> Option<f64> {
        let of = |what: &str| columns.get(&format!("{}_{what}", self.entry.name));
        let rows = of("drag_n")?.iter().zip(of("cd")?).map(|(n, c)| n / c);
        let (sum, count) = rows.filter(|s| s.is_normal()).fold((0.0, 0), |(s, n), x| (s + x, n + 1));
        (count > 0).then(|| sum / f64::from(count))
    }

    /// Normal force, axial force (N) and moment about the axis (N m) in row `k`, in axes that turn with the body. The axial direction is that of
    /// the drag at an angle of zero, normal to the axis; the normal force is along axial x axis. It turns a body back that is downstream of its axis.
    fn loads(&self, columns: &Columns, k: usize, pose: &Pose) -> Option<[f64; 3]> {
        let name = &self.entry.name;
        let vector = |what: &str, unit: &str| columns.vector(&format!("{name}_{what}"), unit, k);
        let (pressure, shear) = (vector("pressure_force", "n")?, vector("shear_force", "n")?);
        let force = [0, 1, 2].map(|i| pressure[i] + shear[i]);
        let from = self.entry.moment_point(self.forces);
        let arm = [0, 1, 2].map(|i| from[i] - self.point[i] - pose.displacement[i]);
        let moment = dot(self.axis, vector("moment", "n_m")?) + dot(self.axis, cross(arm, force));
        let drag = self.entry.drag_direction.unwrap_or(self.forces.drag_direction);
        let along = dot(drag, self.axis);
        let across = unit([0, 1, 2].map(|i| drag[i] - along * self.axis[i]));
        let Some(axial) = across else { return Some([f64::NAN, f64::NAN, moment]) };
        let third = cross(self.axis, axial);
        let (sin, cos) = pose.angle.sin_cos();
        let axial = [0, 1, 2].map(|i| cos * axial[i] + sin * third[i]);
        Some([dot(cross(axial, self.axis), force), dot(axial, force), moment])
    }
}

impl ForcedOscillation {
    /// Of `stage` of `scene` with its results in `folder`; `None` without a rotation that oscillates, an entry of forces that contains what turns, or a
    /// whole period after the first.
    pub fn of(scene: &Scene, stage: usize, folder: &Path) -> Option<Self> {
        let turning = Turning::of(scene, stage)?;
        let columns = Columns(history::read_complete_rows(&folder.join("forces.csv")).ok()?.0);
        let step = 1e-3 * scene.stages[stage].window_s;
        let times = columns.get("time_s")?;
        let samples: Vec<AngleSample> = times.iter().map(|t| turning.sample(*t, step)).collect();
        let periods = whole_periods(&samples)?;
        let kept = periods[0].start..periods[periods.len() - 1].end;
        let angles = samples[kept.clone()].iter().map(|s| s.angle);
        let (low, high) = angles.clone().fold((f64::MAX, f64::MIN), |(l, h), a| (l.min(a), h.max(a)));
        let mean = angles.sum::<f64>() / kept.len() as f64;
        let period_s = mean_period(&samples, &periods)?;
        let entry = turning.entry;
        let scale = turning.scale(&columns)?;
        let density = scene.for_stage(stage).flow?.density_kg_m3;
        let speed_m_s = (2.0 * scale / (density * entry.reference_area_m2)).sqrt();
        let half_time = entry.reference_length_m / (2.0 * speed_m_s);
        let loads: Vec<[f64; 3]> = (0..samples.len())
            .map(|k| turning.loads(&columns, k, &turning.motion.at(samples[k].time_s)))
            .collect::<Option<_>>()?;
        let named = [("normal force", 1.0), ("axial force", 1.0), ("moment", entry.reference_length_m)];
        let of = |(i, (name, length)): (usize, &(&str, f64))| {
            let values: Vec<f64> = loads.iter().map(|l| l[i] / (scale * length)).collect();
            derivatives(name, &samples, &values, &periods, mean, half_time)
        };
        let derivatives: Vec<Derivatives> = named.iter().enumerate().filter_map(of).collect();
        (!derivatives.is_empty()).then(|| Self {
            entry: entry.name.clone(),
            mean_angle_deg: mean.to_degrees(),
            amplitude_deg: 0.5 * (high - low).to_degrees(),
            period_s,
            periods: periods.len() as u64,
            speed_m_s,
            reduced_frequency: std::f64::consts::TAU / period_s * half_time,
            derivatives,
            method: METHOD.into(),
        })
    }

    /// The derivatives in words, a line for the oscillation and one for each coefficient.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "forced oscillation of \"{}\": {:.2} ± {:.2} deg in {:.4} s (reduced frequency {:.4}), {} whole periods after the first",
            self.entry,
            self.mean_angle_deg,
            self.amplitude_deg,
            self.period_s,
            self.reduced_frequency,
            self.periods
        )];
        let without = if self.periods < MIN_PERIODS as u64 {
            format!("fewer than {MIN_PERIODS} periods")
        } else {
            "periods are serially correlated".into()
        };
        let value = |v: f64, interval: Option<f64>| match interval {
            Some(i) => format!("{v:.4} ± {i:.4}"),
            None => format!("{v:.4} (no interval: {without})"),
        };
        lines.extend(self.derivatives.iter().map(|d| {
            format!(
                "{} coefficient: {:.4} at the mean angle, static derivative {} /rad, damping derivative {} (rate l/(2V)); fit explains {:.0} % of the variance",
                d.coefficient,
                d.mean,
                value(d.static_per_rad, d.static_interval_95),
                value(d.damping_per_rad, d.damping_interval_95),
                100.0 * d.explained
            )
        }));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HALF_TIME: f64 = 0.05;

    /// 10 periods of 2 s about 0.2 rad, an amplitude of 0.1 rad, in windows of 10 ms.
    fn samples() -> Vec<AngleSample> {
        let omega = std::f64::consts::PI;
        let sample = |k: u32| {
            let t = 0.01 * f64::from(k);
            AngleSample {
                time_s: t,
                angle: 0.2 - 0.1 * (omega * t).cos(),
                rate: 0.1 * omega * (omega * t).sin(),
            }
        };
        (1..=2000).map(sample).collect()
    }

    fn noise(seed: u64) -> impl FnMut() -> f64 {
        let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
        move || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        }
    }

    fn found(value: impl FnMut(&AngleSample) -> f64) -> Derivatives {
        let samples = samples();
        let values: Vec<f64> = samples.iter().map(value).collect();
        let periods = whole_periods(&samples).expect("periods");
        derivatives("moment", &samples, &values, &periods, 0.2, HALF_TIME).expect("a fit")
    }

    #[test]
    fn periods_are_whole_equal_and_without_the_first() {
        let samples = samples();
        let periods = whole_periods(&samples).expect("periods");
        // The angle rises through its middle at 0.5, 2.5, ... 18.5 s; the period from 0.5 s on is not yet one after the start.
        assert_eq!(periods.len(), 8);
        assert!(periods.iter().all(|p| (199..=201).contains(&p.len())), "{periods:?}");
        assert!((samples[periods[0].start].time_s - 2.5).abs() < 0.011);
        // A chirp has no period, and one period is the first.
        let chirp = |s: &AngleSample| AngleSample { angle: (s.time_s * s.time_s).sin(), ..*s };
        assert_eq!(whole_periods(&samples.iter().map(chirp).collect::<Vec<_>>()), None);
        assert_eq!(whole_periods(&samples[..240]), None);
        let at_rest = |s: &AngleSample| AngleSample { angle: 0.1, ..*s };
        assert_eq!(whole_periods(&samples.iter().map(at_rest).collect::<Vec<_>>()), None);
    }

    /// The start, which is 100 times too large, does not count.
    #[test]
    fn derivatives_of_a_linear_coefficient_are_exact() {
        let found = found(|s| {
            let linear = 0.3 - 0.8 * (s.angle - 0.2) + 1.7 * s.rate * HALF_TIME;
            if s.time_s < 2.0 { 100.0 * linear } else { linear }
        });
        for (value, exact) in [(found.mean, 0.3), (found.static_per_rad, -0.8), (found.damping_per_rad, 1.7)]
        {
            assert!((value - exact).abs() < 1e-12, "{found:?}");
        }
        assert!(found.explained > 1.0 - 1e-12, "{found:?}");
        // A part that neither follows has its share: 0.2 cos(4 omega t) has the variance 0.02, the rest 0.08^2/2 + (0.17 omega HALF_TIME)^2/2.
        let (stiffness, damping) = (0.08f64, 0.17 * std::f64::consts::PI * HALF_TIME);
        let linear = 0.5 * (stiffness * stiffness + damping * damping);
        let disturbed = self::found(|s| {
            let phase = std::f64::consts::PI * s.time_s;
            -0.8 * (s.angle - 0.2) + 1.7 * s.rate * HALF_TIME + 0.2 * (4.0 * phase).cos()
        });
        assert!((disturbed.explained - linear / (linear + 0.02)).abs() < 1e-3, "{disturbed:?} {linear}");
        assert!(found.static_interval_95.is_some_and(|i| i < 1e-12), "{found:?}");
    }

    /// Of 200 noisy series the share whose interval holds the derivative is its nominal one: 95 % of those that have one, with a deviation of 1.6 % of a share of
    /// 200. Eight independent periods have a von Neumann ratio below 1 in 5 %. The interval of a much more accurate fit excludes a fault of 1 %.
    #[test]
    fn interval_has_its_coverage_and_excludes_faults() {
        let (mut held, mut held_damping) = ([0.0; 2], [0.0; 2]);
        for seed in 1..=200 {
            let mut random = noise(seed);
            let d = found(|s| -0.8 * (s.angle - 0.2) + 1.7 * s.rate * HALF_TIME + 0.02 * random());
            let add = |[held, count]: [f64; 2], value: f64, interval: Option<f64>, exact: f64| {
                let within = interval.is_some_and(|i| (value - exact).abs() <= i);
                [held + f64::from(within), count + f64::from(interval.is_some())]
            };
            held = add(held, d.static_per_rad, d.static_interval_95, -0.8);
            held_damping = add(held_damping, d.damping_per_rad, d.damping_interval_95, 1.7);
        }
        println!("static {held:?}, damping {held_damping:?} of 200");
        for [held, count] in [held, held_damping] {
            assert!(
                (0.90..0.99).contains(&(held / count)) && (176.0..200.0).contains(&count),
                "{held} {count}"
            );
        }
        let mut random = noise(7);
        let d = found(|s| -0.8 * (s.angle - 0.2) + 1.7 * s.rate * HALF_TIME + 5e-4 * random());
        let interval = d.static_interval_95.expect("eight periods");
        assert!((d.static_per_rad + 0.8).abs() < interval && interval < 0.008, "{d:?}");
    }

    /// A derivative that changes slowly from period to period has no interval, though its scatter has a size; eight periods that change at random have one.
    #[test]
    fn correlated_periods_have_no_interval() {
        let found = found(|s| -0.8 * (1.0 + 0.02 * s.time_s) * (s.angle - 0.2) + 1.7 * s.rate * HALF_TIME);
        assert_eq!(found.static_interval_95, None, "{found:?}");
        assert_eq!(half_width(&[1.0, 2.0, 3.0, 4.0], 0.0), None);
        assert_eq!(half_width(&[1.0, 2.0], 0.0), None);
        // Deviation sqrt(2/3), t = 3.182 for three degrees of freedom, four periods; squared differences 3, deviations 2.
        let exact = 3.182 * (2.0f64 / 3.0 / 4.0).sqrt();
        assert!((half_width(&[1.0, 2.0, 3.0, 2.0], 0.0).expect("an interval") - exact).abs() < 1e-12);
    }

    /// A load that lags by a time tau changes the damping derivative by -C_a tau 2V/l: an error of order (omega tau)^2 of both remains.
    #[test]
    fn load_that_lags_changes_the_damping_derivative_by_its_sign() {
        let (omega, lag) = (std::f64::consts::PI, 0.01);
        let found = found(|s| {
            let phase = omega * (s.time_s - lag);
            let (angle, rate) = (0.2 - 0.1 * phase.cos(), 0.1 * omega * phase.sin());
            0.5 * (angle - 0.2) + 1.7 * rate * HALF_TIME
        });
        let change = found.damping_per_rad - 1.7;
        assert!((change + 0.5 * lag / HALF_TIME).abs() < 1.7 * (omega * lag).powi(2), "{found:?}");
    }

    /// A scene with a canopy that is turned about y through (0, 0, -1) and has this `displacement_m`, in a stream of 10 m/s along z.
    fn scene(displacement: &str) -> Scene {
        let text = include_str!("../../../cases/validation/rigid-cup/scene.toml");
        let motion = "[[stage]]\nname = \"turn\"\nkind = \"prescribed\"\nduration_s = 20.0\nwindow_s = 1e-2\n[[stage.body_motion]]\npatches = [\"canopy\"]\n\
                      rotation = { axis = [0, 2, 0], point_m = [0, 0, -1], angle_rad = \"0.2*sin(pi*t)\" }\n";
        let text = format!("{text}\n{motion}{displacement}");
        case::parse(Path::new("scene.toml"), &text).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Force that makes a coefficient of 1 in air of 10 m/s at sea level on 0.785398 m2, N.
    const SCALE: f64 = 48.105_627_5;

    /// Writes the table of a body whose normal force is N = 2 theta + 0.3 dtheta/dt and whose axial force is 5 N, both at its middle, 1.5 m from the axis along
    /// the body: forces along x, y, z and the moment about the moment point, from which the axis is at `from` of time (x and z, m).
    fn write_table(folder: &Path, scale: f64, from: impl Fn(f64) -> [f64; 2]) {
        let omega = std::f64::consts::PI;
        let names = [
            "pressure_force_x_n",
            "pressure_force_y_n",
            "pressure_force_z_n",
            "shear_force_x_n",
            "shear_force_y_n",
            "shear_force_z_n",
            "moment_x_n_m",
            "moment_y_n_m",
            "moment_z_n_m",
            "drag_n",
            "cd",
        ];
        let mut text = format!("time_s,{}\n", names.map(|n| format!("cup_{n}")).join(","));
        for k in 1..=2000 {
            let t = 0.01 * f64::from(k);
            let (angle, rate) = (0.2 * (omega * t).sin(), 0.2 * omega * (omega * t).cos());
            let (sin, cos) = angle.sin_cos();
            let (normal, axial) = (2.0 * angle + 0.3 * rate, 5.0);
            // Axial along (sin, 0, cos), normal along (-cos, 0, sin).
            let (x, z) = (axial * sin - normal * cos, axial * cos + normal * sin);
            // The arm is 1.5 m along the body, and from the moment point to the axis.
            let [right, up] = from(t);
            let moment = 1.5 * (cos * x - sin * z) + up * x - right * z;
            text += &format!("{t},{},0,{z},{},0,0,0,{moment},0,{z},{}\n", 0.75 * x, 0.25 * x, z / scale);
        }
        std::fs::write(folder.join("forces.csv"), text).expect("written");
    }

    /// Derivatives of that body, whose reference speed is 10 m/s.
    fn assert_derivatives(found: &ForcedOscillation, scale: f64) {
        let [normal, axial, moment] = &found.derivatives[..] else { panic!("{found:?}") };
        for (d, (stiffness, damping)) in [(normal, (2.0, 0.3)), (moment, (-3.0, -0.45))] {
            let exact = [stiffness / scale, damping / scale / 0.05];
            assert!((d.static_per_rad / exact[0] - 1.0).abs() < 1e-5, "{d:?} {exact:?}");
            assert!((d.damping_per_rad / exact[1] - 1.0).abs() < 1e-5, "{d:?} {exact:?}");
        }
        assert!((axial.mean - 5.0 / scale).abs() < 1e-8 && axial.static_per_rad.abs() < 1e-8, "{axial:?}");
    }

    #[test]
    fn table_of_forces_gives_derivatives_in_body_axes() {
        let folder = tempfile::tempdir().expect("a folder");
        let scene = scene("");
        write_table(folder.path(), SCALE, |_| [0.0; 2]);
        let found = ForcedOscillation::of(&scene, 1, folder.path()).expect("an oscillation");
        assert_eq!((found.entry.as_str(), found.periods), ("cup", 8));
        assert!(
            (found.amplitude_deg - 0.2f64.to_degrees()).abs() < 1e-3 && (found.period_s - 2.0).abs() < 1e-9
        );
        assert!(found.mean_angle_deg.abs() < 1e-6, "{found:?}");
        let k = std::f64::consts::PI * 0.05;
        assert!((found.speed_m_s - 10.0).abs() < 1e-5 && (found.reduced_frequency - k).abs() < 1e-6);
        assert_derivatives(&found, SCALE);
        let lines = found.lines().join("\n");
        for part in ["forced oscillation of \"cup\"", "normal force", "damping derivative", "8 whole periods"]
        {
            assert!(lines.contains(part), "{part}: {lines}");
        }
        // A stage at rest has none.
        assert_eq!(ForcedOscillation::of(&scene, 0, folder.path()), None);
    }

    /// The moment is about the axis, which moves, and not about the moment point of the table.
    #[test]
    fn moment_is_about_the_axis_that_moves() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut scene = scene("displacement_m = [\"0.1*t\", \"0\", \"-0.2*t\"]\n");
        let forces = scene.flow.as_mut().and_then(|f| f.forces.as_mut()).expect("forces");
        forces.coefficients[0].moment_point_m = Some([0.3, 0.0, -0.4]);
        forces.coefficients[0].reference_length_m = 2.0;
        write_table(folder.path(), SCALE, |t| [0.1 * t - 0.3, -0.2 * t - 0.6]);
        let mut found = ForcedOscillation::of(&scene, 1, folder.path()).expect("an oscillation");
        assert!((found.reduced_frequency - std::f64::consts::PI * 0.1).abs() < 1e-6);
        // Twice the length: half of the damping derivative of a force, of the static derivative of the moment, and a quarter of its damping derivative.
        found.derivatives.iter_mut().for_each(|d| d.damping_per_rad *= 2.0);
        let moment = &mut found.derivatives[2];
        (moment.static_per_rad, moment.damping_per_rad) =
            (2.0 * moment.static_per_rad, 2.0 * moment.damping_per_rad);
        assert_derivatives(&found, SCALE);
    }

    /// In a stage at another altitude the reference speed is that of its thinner air.
    #[test]
    fn air_is_that_of_the_altitude_of_the_stage() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut scene = scene("");
        scene.flow.as_mut().expect("a flow").altitude_m = Some(0.0);
        scene.stages[1].altitude_m = Some(10_000.0);
        let density = |h: f64| case::StandardAir::at(h).density_kg_m3;
        let scale = SCALE * density(10_000.0) / density(0.0);
        write_table(folder.path(), scale, |_| [0.0; 2]);
        let found = ForcedOscillation::of(&scene, 1, folder.path()).expect("an oscillation");
        assert!((found.speed_m_s - 10.0).abs() < 1e-5, "{found:?}");
        assert_derivatives(&found, scale);
    }

    /// A period of 2.2 s in windows of 0.15 s: the times of the samples alone would give 2.25 or 2.1 s.
    #[test]
    fn period_is_that_between_the_windows() {
        let omega = std::f64::consts::TAU / 2.2;
        let sample = |k: u32| {
            let t = 0.15 * f64::from(k);
            AngleSample { time_s: t, angle: (omega * t).sin(), rate: omega * (omega * t).cos() }
        };
        let samples: Vec<AngleSample> = (1..=45).map(sample).collect();
        let periods = whole_periods(&samples).expect("periods");
        // Linear interpolation of a sine displaces its zero by up to h (omega h)^2 / 16 and the middle of the largest and smallest of its samples.
        let found = mean_period(&samples, &periods).expect("a period");
        assert!((found - 2.2).abs() < 0.01, "{found} {periods:?}");
    }

    /// Windows without a force, as after a failure, give no derivatives instead of values that are not numbers.
    #[test]
    fn table_without_numbers_has_no_derivatives() {
        let samples = samples();
        let periods = whole_periods(&samples).expect("periods");
        let values = vec![f64::NAN; samples.len()];
        assert_eq!(derivatives("moment", &samples, &values, &periods, 0.2, HALF_TIME), None);
    }
}
