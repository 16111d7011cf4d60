//! `ripstop diff`: where two runs or recordings part.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;

use crate::history;
use crate::recording::compare::Comparison;
use crate::recording::{Event, Reader, stage_file};

/// What to compare, and how closely.
#[derive(clap::Args)]
pub struct DiffArgs {
    /// The reference: a folder that `ripstop run --record` wrote, or the results of a run
    a: PathBuf,
    /// The other one, of the same kind
    b: PathBuf,
    /// Largest difference that is none, as a share of the largest number of the field (or column)
    #[arg(long, value_name = "SHARE", default_value_t = 1e-9, value_parser = share)]
    tolerance: f64,
    /// Judge how many iterations each answer took (Newton, Krylov, ...): this share of the reference's
    /// count, rounded up, is no difference [default: other counts are told, not judged]
    #[arg(long, value_name = "SHARE", value_parser = share)]
    count_slack: Option<f64>,
    /// Folder for `<stage>-difference.csv` and `.svg`: how the differences grow
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if (0.0..1.0).contains(&s) => Ok(s),
        _ => Err("a share from 0 (the same to the bit, above each field's floor) to 1".into()),
    }
}

/// Compares stage by stage; whether all are the same, and the report.
///
/// # Errors
/// Folders that cannot be compared.
pub fn diff(args: &DiffArgs) -> Result<(bool, String), RunError> {
    let scene = scene_of(&args.a)?;
    scene_of(&args.b)?;
    let mut text = Vec::new();
    let mut same = true;
    for stage in &scene.stages {
        let files = [&args.a, &args.b].map(|f| stage_file(f, &stage.name));
        if files.iter().all(|f| f.is_file()) {
            let [a, b] = files;
            let comparison = recordings(&a, &b, args.tolerance, args.count_slack)?;
            text.push(format!("stage `{}`: {}", stage.name, comparison.report()));
            same &= comparison.same() && comparison.other_iterations.is_none();
            if let Some(out) = &args.out {
                write(out, &stage.name, &comparison)?;
            }
            continue;
        }
        let files = [&args.a, &args.b].map(|f| f.join(&stage.name).join("history.csv"));
        if files.iter().all(|f| f.is_file()) {
            let (equal, report) = histories(&files[0], &files[1], args.tolerance)?;
            text.push(format!("stage `{}`: {report}", stage.name));
            same &= equal;
        }
    }
    if text.is_empty() {
        return Err(RunError::Input(format!(
            "{} and {} have no stage in common: name two folders that `ripstop run --record` wrote, or two \
             folders of results",
            args.a.display(),
            args.b.display()
        )));
    }
    Ok((same, text.join("\n")))
}

fn scene_of(folder: &Path) -> Result<Scene, RunError> {
    let file = folder.join("scene.toml");
    if !file.is_file() {
        return Err(RunError::Input(format!(
            "{} is neither a recording nor a folder of results: {} is missing",
            folder.display(),
            file.display()
        )));
    }
    case::load(&file).map_err(|e| RunError::Input(e.to_string()))
}

/// Events of one window, in order.
struct Windows {
    reader: Reader,
}

impl Windows {
    fn next(&mut self) -> Result<Option<Vec<Event<Vec<f64>>>>, RunError> {
        let mut window = Vec::new();
        while let Some(event) = self.reader.next_event()? {
            let ends = matches!(event, Event::Accept { .. });
            window.push(event);
            if ends {
                return Ok(Some(window));
            }
        }
        Ok((!window.is_empty()).then_some(window))
    }
}

/// Compares the exchanges of a stage, window by window: iterations that both have, one
/// by one, and the last ones where their numbers differ.
///
/// # Errors
/// Recordings that cannot be read or are of different canopies.
pub fn recordings(
    a: &Path,
    b: &Path,
    tolerance: f64,
    count_slack: Option<f64>,
) -> Result<Comparison, RunError> {
    let mut both = [Windows { reader: Reader::open(a)? }, Windows { reader: Reader::open(b)? }];
    let canopies = [0, 1].map(|i| both[i].reader.header().canopy);
    if canopies[0] != canopies[1] {
        return Err(RunError::Input(format!(
            "{} has {} canopy nodes and {} faces, {} has {} and {}: they are of different meshes",
            a.display(),
            canopies[0].0,
            canopies[0].1,
            b.display(),
            canopies[1].0,
            canopies[1].1
        )));
    }
    let mut comparison = Comparison::new(tolerance).judging_counts(count_slack);
    loop {
        let [a, b] = &mut both;
        let (Some(x), Some(y)) = (a.next()?, b.next()?) else { return Ok(comparison) };
        let key = |e: &Event<Vec<f64>>| (e.kind(), e.at().iteration);
        for event in &x {
            if let Some(other) = y.iter().find(|o| key(o) == key(event)) {
                comparison.add(event, other);
            }
        }
        let count = |w: &[Event<Vec<f64>>]| w.iter().map(|e| e.at().iteration + 1).max().unwrap_or(0);
        if count(&x) != count(&y) {
            let index = x.first().map_or(0, |e| e.at().index);
            comparison.other_iterations.get_or_insert((index, [count(&x), count(&y)]));
            for kind in 0..3 {
                let last = |w: &[Event<Vec<f64>>]| w.iter().rposition(|e| e.kind() == kind);
                if let (Some(i), Some(j)) = (last(&x), last(&y)) {
                    comparison.add(&x[i], &y[j]);
                }
            }
        }
    }
}

/// Columns of a history that are measured times, not answers.
fn is_time_spent(name: &str) -> bool {
    name == "coupler_s"
        || ["wall", "busy", "wait", "assembly", "factorisation", "solve", "megabytes"]
            .iter()
            .any(|w| name.contains(w))
}

fn histories(a: &Path, b: &Path, tolerance: f64) -> Result<(bool, String), RunError> {
    let (a, b) = (history::read(a)?, history::read(b)?);
    let mut first: Option<(usize, &str, f64, f64, f64)> = None;
    let mut rows = 0;
    for (name, x) in a.iter().filter(|(n, _)| !is_time_spent(n)) {
        let Some((_, y)) = b.iter().find(|(n, _)| n == name) else { continue };
        let scale = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        rows = x.len().min(y.len());
        let beyond = |i: &usize| {
            let d = (x[*i] - y[*i]).abs();
            let same = d <= tolerance * scale || d == 0.0 || (x[*i].is_nan() && y[*i].is_nan());
            !same
        };
        if let Some(i) = (0..rows).find(beyond)
            && first.is_none_or(|f| i < f.0)
        {
            first = Some((i, name, x[i], y[i], (x[i] - y[i]).abs() / scale));
        }
    }
    Ok(match first {
        None => (true, format!("histories are the same to {tolerance:.0e} in {rows} windows")),
        Some((i, name, x, y, d)) => (
            false,
            format!(
                "histories part at window {i}, column {name}: {x:.9e} and {y:.9e}, {d:.1e} of its largest \
                 (tolerance {tolerance:.0e}); recordings (`ripstop run --record`) tell the channel and the node"
            ),
        ),
    })
}

/// Writes how the differences grow.
pub(crate) fn write(out: &Path, stage: &str, comparison: &Comparison) -> Result<(), RunError> {
    std::fs::create_dir_all(out).map_err(RunError::file("create", out))?;
    let path = out.join(format!("{stage}-difference.csv"));
    std::fs::write(&path, comparison.csv()).map_err(RunError::file("write", &path))?;
    let path = out.join(format!("{stage}-difference.svg"));
    crate::plot::difference(&path, stage, comparison)
}
