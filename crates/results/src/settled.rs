//! Settled means of the quantities of a stage, from its `history.csv`.

use serde::{Deserialize, Serialize};

use crate::long_term::{LongTerm, METHOD, MIN_BATCHES, State, long_term};

/// Column of `history.csv`, name and unit of the quantities that have a settled mean.
pub const QUANTITIES: [(&str, &str, &str); 10] = [
    ("descent_speed_m_s", "descent speed", "m/s"),
    ("horizontal_speed_m_s", "horizontal speed", "m/s"),
    ("glide_ratio", "glide ratio", "-"),
    ("drag_n", "drag", "N"),
    ("cd", "drag coefficient at the reference speed", "-"),
    ("projected_area_m2", "projected area", "m2"),
    ("volume_m3", "volume", "m3"),
    ("riser_force_n", "riser force", "N"),
    ("max_line_tension_n", "maximum line tension", "N"),
    ("structure_strain_energy_j", "elastic energy", "J"),
];

/// Mean of a quantity over the settled part of a stage.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SettledMean {
    /// Column of `history.csv`; mean, interval, drift and amplitude have its unit.
    pub quantity: String,
    /// Mean of the settled part.
    pub mean: f64,
    /// Half width of the 95 % confidence interval of the mean; `None` unless the mean is stationary.
    pub interval_95: Option<f64>,
    /// Why there is no interval.
    pub no_interval: Option<String>,
    /// Method of start, interval and test of stationarity.
    pub method: String,
    /// Start of the settled part, s from the start of the stage.
    pub from_s: f64,
    /// End of the settled part: the last window, s.
    pub to_s: f64,
    /// Number of batches.
    pub batches: u64,
    /// Whether the batch means have neither a trend nor serial correlation; `None` with fewer than four batches.
    pub stationary: Option<bool>,
    /// Change of the mean over the settled part, by the line of least squares through the batch means; `None` with fewer than four batches.
    pub drift: Option<f64>,
    /// Amplitude of the swing: half of the difference of largest and smallest value in a main period, averaged over whole periods; `None`
    /// without a main period.
    pub swing_amplitude: Option<f64>,
    /// Main period, s; `None` where no period has a quarter of the variance.
    pub swing_period_s: Option<f64>,
    /// Share of the main period in the variance.
    pub swing_share: Option<f64>,
}

impl SettledMean {
    /// Of a column of a history; `None` for a column with fewer than 40 values or a constant one.
    pub fn of(quantity: &str, columns: &[(String, Vec<f64>)]) -> Option<Self> {
        let get = |name: &str| columns.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..]);
        let (time, values) = (get("time_s")?, get(quantity)?);
        let points: Vec<(f64, f64)> = time.iter().copied().zip(values.iter().copied()).collect();
        let LongTerm { from, mean, batches, state, half_width, drift, swing } = long_term(&points)?;
        Some(Self {
            quantity: quantity.into(),
            mean,
            interval_95: half_width,
            no_interval: reason(state, batches, drift, from),
            method: METHOD.into(),
            from_s: from,
            to_s: *time.last()?,
            batches: batches as u64,
            stationary: (state != State::TooShort).then_some(state == State::Stationary),
            drift,
            swing_amplitude: swing.map(|s| s.amplitude),
            swing_period_s: swing.map(|s| s.period),
            swing_share: swing.map(|s| s.share),
        })
    }

    /// Of all [`QUANTITIES`] of a history that have one.
    pub fn all(columns: &[(String, Vec<f64>)]) -> Vec<Self> {
        QUANTITIES.iter().filter_map(|(name, _, _)| Self::of(name, columns)).collect()
    }

    /// Name and unit of the quantity.
    pub fn label(&self) -> (&str, &str) {
        label(&self.quantity)
    }

    /// What the mean is: a settled one has an interval.
    pub fn kind(&self) -> &'static str {
        if self.interval_95.is_some() { "settled mean" } else { "mean" }
    }

    /// Mean and half width of its interval with two digits of it, without unit; `None` without an interval.
    pub fn mean_and_interval(&self) -> Option<String> {
        let half_width = self.interval_95?;
        let places = decimals(half_width);
        Some(format!("{:.places$} ± {half_width:.places$}", self.mean))
    }

    /// Mean and interval, or why there is none, in words.
    pub fn line(&self) -> String {
        let (label, unit) = self.label();
        // Two digits of the interval; the mean to the same place.
        let places = self.interval_95.map_or(4, decimals);
        let interval = match (self.interval_95, &self.no_interval) {
            (Some(half_width), _) => {
                let batches = format!("{} batches of {:.2} s", self.batches, self.batch_s());
                format!(" ± {half_width:.places$} {unit} (95 %, {batches})")
            }
            (None, Some(why)) => format!(" {unit}, no interval: {why}"),
            (None, None) => format!(" {unit}"),
        };
        let swing = match (self.swing_amplitude, self.swing_period_s) {
            (Some(amplitude), Some(period)) => format!("; swing ± {amplitude:.3} in {period:.2} s"),
            _ => String::new(),
        };
        let (mean, from, to) = (self.mean, self.from_s, self.to_s);
        format!("{label} {mean:.places$}{interval}, from {from:.2} to {to:.2} s{swing}")
    }

    /// Length of a batch, s.
    fn batch_s(&self) -> f64 {
        (self.to_s - self.from_s) / self.batches.max(1) as f64
    }
}

/// Name and unit of a column of `history.csv`; the column itself where it is none of [`QUANTITIES`].
pub fn label(column: &str) -> (&str, &str) {
    QUANTITIES
        .iter()
        .find(|(name, _, _)| *name == column)
        .map_or((column, "-"), |(_, label, unit)| (label, unit))
}

/// Decimals that show two digits of `half_width`.
pub fn decimals(half_width: f64) -> usize {
    (1.0 - half_width.abs().max(1e-9).log10().floor()).clamp(0.0, 10.0) as usize
}

/// Why a mean has no interval; `None` where it has one.
fn reason(state: State, batches: usize, drift: Option<f64>, from: f64) -> Option<String> {
    match state {
        State::Stationary => None,
        State::TooShort => {
            Some(format!("{batches} batches of whole main periods, an interval needs {MIN_BATCHES}"))
        }
        State::Drift => Some(format!("the mean drifts, by {:+.3e} since {from:.2} s", drift.unwrap_or(0.0))),
        State::Correlated => Some(format!("the means of {batches} batches are serially correlated")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn history(end: f64, speed: impl Fn(f64) -> f64) -> Vec<(String, Vec<f64>)> {
        let time: Vec<f64> = (1..=(end / 0.02) as u32).map(|k| 0.02 * f64::from(k)).collect();
        let speeds = time.iter().map(|t| speed(*t)).collect();
        vec![("time_s".into(), time), ("descent_speed_m_s".into(), speeds)]
    }

    fn swing(t: f64) -> f64 {
        0.6 * (std::f64::consts::TAU * t / 2.2).sin() + 0.1 * (11.3 * t * t.sqrt()).sin()
    }

    #[test]
    fn settled_mean_states_interval_method_start_and_batches() {
        let all = SettledMean::all(&history(60.0, |t| 4.6 + swing(t)));
        let [mean] = &all[..] else { panic!("one column: {all:?}") };
        assert!((mean.mean - 4.6).abs() < mean.interval_95.expect("an interval"), "{mean:?}");
        assert_eq!((mean.stationary, &mean.no_interval, mean.kind()), (Some(true), &None, "settled mean"));
        assert!(mean.batches >= 4 && mean.from_s < 31.0 && (mean.to_s - 60.0).abs() < 1e-9, "{mean:?}");
        assert!((mean.swing_period_s.expect("a period") - 2.2).abs() < 0.02);
        for part in ["MSER", "batch means", "Student's t"] {
            assert!(mean.method.contains(part), "{}", mean.method);
        }
        assert!(
            mean.line().starts_with("descent speed 4.6") && mean.line().contains(" m/s (95 %, "),
            "{}",
            mean.line()
        );
        let exact = SettledMean { mean: 4.51873, interval_95: Some(0.071_49), ..mean.clone() };
        assert_eq!(exact.mean_and_interval().as_deref(), Some("4.519 ± 0.071"));
    }

    #[test]
    fn mean_without_an_interval_states_why() {
        let drift = SettledMean::all(&history(60.0, |t| 4.0 + 0.05 * t + swing(t)));
        assert_eq!((drift[0].stationary, drift[0].interval_95), (Some(false), None));
        assert!(drift[0].line().contains("no interval: the mean drifts, by +"), "{}", drift[0].line());
        assert_eq!(drift[0].kind(), "mean");
        let short = SettledMean::all(&history(6.0, |t| 4.6 + swing(t)));
        assert_eq!((short[0].stationary, short[0].interval_95), (None, None));
        assert!(short[0].line().contains("an interval needs 4"), "{}", short[0].line());
    }

    /// The last line of a history that is being written may be incomplete.
    #[test]
    fn history_of_a_running_stage_is_read_to_its_last_complete_row() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("history.csv");
        let mut text = String::from("window,time_s,descent_speed_m_s\n");
        for k in 0..3000 {
            let t = 0.02 * f64::from(k);
            text += &format!("{k},{t},{}\n", 4.6 + swing(t));
        }
        std::fs::write(&file, &text).expect("written");
        let means = || SettledMean::all(&crate::history::read_complete_rows(&file).expect("a history").0);
        let complete = means();
        std::fs::write(&file, text + "3000,60.0,4").expect("written");
        assert_eq!(means(), complete);
        std::fs::write(&file, "").expect("written");
        assert_eq!(means(), []);
    }
}
