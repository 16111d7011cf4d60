//! `ripstop diff`: compares two runs or recordings and plots the growth of their differences.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;
use results::diff::{histories, recordings};
use results::recording::stage_file;

/// The folders to compare, and tolerances.
#[derive(clap::Args)]
pub struct DiffArgs {
    /// The reference: a folder that `ripstop run --record` wrote, or the results of a run
    a: PathBuf,
    /// The folder to compare with it, of the same kind
    b: PathBuf,
    /// Relative tolerance of the comparison; the scale is the largest value of the field (or column)
    #[arg(long, value_name = "RATIO", default_value_t = 1e-9, value_parser = crate::arguments::ratio)]
    tolerance: f64,
    /// Relative tolerance of iteration counts (Newton, Krylov, ...), rounded up [default: differences of counts are
    /// reported, not judged]
    #[arg(long, value_name = "RATIO", value_parser = crate::arguments::ratio)]
    iteration_tolerance: Option<f64>,
    /// Folder for `<stage>-difference.csv` and `.svg`: differences over time
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Compares stage by stage: whether all agree within the tolerances, and the report.
///
/// # Errors
/// [`RunError::Input`]: the folders cannot be compared.
pub fn diff(args: &DiffArgs) -> Result<(bool, String), RunError> {
    let scene = scene_of(&args.a)?;
    scene_of(&args.b)?;
    let mut text = Vec::new();
    let mut same = true;
    for stage in &scene.stages {
        let files = [&args.a, &args.b].map(|f| stage_file(f, &stage.name));
        if files.iter().all(|f| f.is_file()) {
            let [a, b] = files;
            let comparison = recordings(&a, &b, args.tolerance, args.iteration_tolerance)?;
            text.push(format!("stage `{}`: {}", stage.name, comparison.report()));
            same &= comparison.same() && comparison.other_iterations.is_none();
            if let Some(out) = &args.out {
                figures::plot::differences(out, &stage.name, &comparison)?;
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

/// The scene of a recording or a folder of results.
pub(crate) fn scene_of(folder: &Path) -> Result<Scene, RunError> {
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
