//! The table of a sweep: what each run gave.

use std::path::Path;

use case::Scene;
use coupling::error::RunError;
use results::history;
use results::settled::{QUANTITIES, SettledMean};
use results::wake::Wake;

use super::plan::{Point, Variation};

/// A column of a table of a run, whose mean the sweep collects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Quantity {
    /// Name of the column.
    pub column: String,
    /// Name for people.
    pub label: String,
    /// Unit.
    pub unit: &'static str,
    /// Whether it is a coefficient of an entry of `[[flow.forces.coefficients]]`, in `forces.csv`; otherwise in `history.csv`.
    pub of_forces: bool,
}

impl Quantity {
    /// Name and unit, with these characters around the unit; a number without unit has none.
    pub fn title(&self, before: &str, after: &str) -> String {
        if self.of_forces {
            self.label.clone()
        } else {
            format!("{}{before}{}{after}", self.label, self.unit)
        }
    }
}

/// Coefficients of an entry: end of the column, name.
const COEFFICIENTS: [(&str, &str); 6] = [
    ("cd", "drag coefficient"),
    ("cl", "lift coefficient"),
    ("cm_pitch", "pitching moment coefficient"),
    ("cs", "side force coefficient"),
    ("cm_roll", "rolling moment coefficient"),
    ("cm_yaw", "yawing moment coefficient"),
];

/// The quantities of runs of `scenes`: those of the history, and the coefficients of all entries of forces.
pub fn quantities(scenes: &[Scene]) -> Vec<Quantity> {
    let of_history = QUANTITIES.iter().map(|(column, label, unit)| Quantity {
        column: (*column).into(),
        label: (*label).into(),
        unit,
        of_forces: false,
    });
    let mut all: Vec<Quantity> = of_history.collect();
    let forces = scenes.iter().filter_map(|s| s.flow.as_ref()?.forces.as_ref());
    for entry in forces.flat_map(|f| &f.coefficients) {
        for (end, what) in COEFFICIENTS {
            let column = format!("{}_{end}", entry.name);
            if !all.iter().any(|q| q.column == column) {
                let label = format!("{what} of {}", entry.name);
                all.push(Quantity { column, label, unit: "-", of_forces: true });
            }
        }
    }
    all
}

/// The mean of a quantity of a run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Value {
    /// Settled mean, or mean of the last half of the windows where there is no settled one.
    pub mean: f64,
    /// Half width of the 95 % interval; `None`: not settled.
    pub interval: Option<f64>,
}

/// Results of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// How it ended; `not run`.
    pub ended: String,
    /// Whether all its stages are complete.
    pub complete: bool,
    /// Simulated time of the main stage, s.
    pub time_s: f64,
    /// Wall time, s.
    pub wall_s: f64,
    /// Number of warnings, before and during the run.
    pub warnings: usize,
    /// Check of the wake that the means do not pass, such as `wake.periods`; empty: none.
    pub wake: String,
    /// Mean of each of the [`quantities`]; `None`: the run has none.
    pub values: Vec<Option<Value>>,
}

/// Whether `folder` has a complete run of `scene`.
pub fn is_complete(folder: &Path, scene: &Scene) -> bool {
    summary(folder).is_some_and(|s| s["ended"] == "complete") && is_of(folder, scene)
}

/// Whether the run in `folder` is one of `scene`: its file or other settings may have changed since.
fn is_of(folder: &Path, scene: &Scene) -> bool {
    let values = |scene: &Scene| serde_json::to_value(scene).ok();
    case::load(&folder.join("scene.toml")).is_ok_and(|kept| values(&kept) == values(scene))
}

fn summary(folder: &Path) -> Option<serde_json::Value> {
    let text = std::fs::read_to_string(folder.join("summary.json")).ok()?;
    serde_json::from_str(&text).ok()
}

/// The results in the `folder` of a run of `scene`.
pub fn row(folder: &Path, scene: &Scene, quantities: &[Quantity]) -> Row {
    if folder.join("scene.toml").exists() && !is_of(folder, scene) {
        return Row {
            ended: "a run of another scene: remove its folder, or give another --out".into(),
            complete: false,
            time_s: 0.0,
            wall_s: 0.0,
            warnings: 0,
            wake: String::new(),
            values: vec![None; quantities.len()],
        };
    }
    let stage = case::stage_folder(folder, scene, scene.main_stage());
    let read = |name: &str| {
        history::read_complete_rows(&stage.join(name)).map_or_else(|_| Vec::new(), |(columns, _)| columns)
    };
    let (columns, forces) = (read("history.csv"), read("forces.csv"));
    let last = |name: &str| {
        let (_, values) = columns.iter().find(|(n, _)| n == name)?;
        values.last().copied()
    };
    let count = |v: &serde_json::Value| v.as_array().map_or(0, Vec::len);
    let found = summary(folder);
    let ended = found.as_ref().and_then(|s| s["ended"].as_str()).map(str::to_owned);
    let started = if columns.is_empty() { "not run" } else { "running or killed" };
    Row {
        complete: ended.as_deref() == Some("complete"),
        // The first line of an error.
        ended: ended.as_deref().and_then(|e| e.lines().next()).unwrap_or(started).to_owned(),
        time_s: last("time_s").unwrap_or(0.0),
        wall_s: found.as_ref().and_then(|s| s["wall_s"].as_f64()).unwrap_or(0.0),
        warnings: found.as_ref().map_or(0, |s| count(&s["warnings"]) + count(&s["inspection"])),
        wake: Wake::of_history(&columns)
            .and_then(|w| w.verdict())
            .map_or_else(String::new, |v| v.check.into()),
        values: quantities
            .iter()
            .map(|q| value(&q.column, if q.of_forces { &forces } else { &columns }))
            .collect(),
    }
}

/// Mean of a column of a table with times.
fn value(name: &str, columns: &[(String, Vec<f64>)]) -> Option<Value> {
    if let Some(SettledMean { mean, interval_95: Some(half_width), .. }) = SettledMean::of(name, columns) {
        return Some(Value { mean, interval: Some(half_width) });
    }
    let (_, values) = columns.iter().find(|(n, _)| n == name)?;
    let late: Vec<f64> = values[values.len() / 2..].iter().copied().filter(|v| v.is_finite()).collect();
    (!late.is_empty()).then(|| Value { mean: late.iter().sum::<f64>() / late.len() as f64, interval: None })
}

/// Whether any run has a value of the quantity at this position.
pub fn is_known(rows: &[Row], quantity: usize) -> bool {
    rows.iter().any(|r| r.values[quantity].is_some())
}

/// The table as CSV, a row for each run.
///
/// # Errors
/// The file cannot be written.
pub fn write(
    path: &Path,
    variations: &[Variation],
    quantities: &[Quantity],
    points: &[Point],
    rows: &[Row],
) -> Result<(), RunError> {
    let quoted = |text: &str| {
        if text.contains([',', '"', '\n']) {
            format!("\"{}\"", text.replace('"', "\"\""))
        } else {
            text.into()
        }
    };
    let known: Vec<usize> = (0..quantities.len()).filter(|q| is_known(rows, *q)).collect();
    let mut names: Vec<String> = vec!["run".into()];
    names.extend(variations.iter().map(|v| v.key.clone()));
    names.extend(["ended", "time_s", "wall_s", "warnings", "wake"].map(String::from));
    for &q in &known {
        let column = &quantities[q].column;
        names.extend([column.clone(), format!("{column}_interval_95")]);
    }
    let mut text = names.iter().map(|n| quoted(n)).collect::<Vec<_>>().join(",") + "\n";
    for (point, row) in points.iter().zip(rows) {
        let mut cells = vec![quoted(&point.name)];
        cells.extend(point.values.iter().map(|v| quoted(v)));
        cells.extend([
            quoted(&row.ended),
            row.time_s.to_string(),
            row.wall_s.to_string(),
            row.warnings.to_string(),
            row.wake.clone(),
        ]);
        for &q in &known {
            let of = |v: Option<f64>| v.map_or_else(String::new, |v| format!("{v:.8e}"));
            cells.push(of(row.values[q].map(|v| v.mean)));
            cells.push(of(row.values[q].and_then(|v| v.interval)));
        }
        text += &(cells.join(",") + "\n");
    }
    std::fs::write(path, text).map_err(RunError::file("write", path))
}
