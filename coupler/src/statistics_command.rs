//! `ripstop statistics`: settled means and wake of a complete, running or interrupted run.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use results::forced_oscillation::ForcedOscillation;
use results::history;
use results::opening::{Opening, OpeningReference};
use results::settled::SettledMean;
use results::wake::Wake;
use serde::Serialize;

/// Arguments of `ripstop statistics`.
#[derive(clap::Args)]
pub struct StatisticsArgs {
    /// Results folder of a complete, running or interrupted run, or a history.csv
    path: PathBuf,
    /// Print JSON: an array with an object for each stage
    #[arg(long)]
    json: bool,
}

/// Statistics of a stage.
#[derive(Serialize)]
struct StageStatistics {
    /// Name of the stage; of the folder where a file was named.
    stage: String,
    /// Accepted windows.
    windows: usize,
    /// Settled means.
    settled: Vec<SettledMean>,
    /// Wake of the last half of the windows; `None` where it is not assessed.
    wake: Option<Wake>,
    /// Line stretch, filling and largest force of a canopy that opens in the stage; `None` in any other stage, and for a file.
    opening: Option<Opening>,
    /// Stability derivatives of a body whose rotation oscillates; `None` in any other stage, and for a file.
    forced_oscillation: Option<ForcedOscillation>,
    /// Why the means are not those of a developed wake.
    warning: Option<String>,
}

/// The statistics of `args.path` as text or JSON.
///
/// # Errors
/// [`RunError::Input`]: the path has no history with a flow.
pub fn statistics(args: &StatisticsArgs) -> Result<String, RunError> {
    let scene = args.path.is_dir().then(|| crate::diff_command::scene_of(&args.path).ok()).flatten();
    let run = scene.as_ref().map(|scene| (scene, CanopyInterface::new(scene).ok()));
    let stages: Vec<StageStatistics> = histories(&args.path)?
        .into_iter()
        .map(|(name, file)| of(name, &file, run.as_ref()))
        .collect::<Result<Vec<Option<StageStatistics>>, RunError>>()?
        .into_iter()
        .flatten()
        .collect();
    if stages.is_empty() {
        return Err(RunError::Input(format!(
            "{} has no stage with a flow and at least one completed window. Name the results folder of `ripstop run`, or a history.csv in it",
            args.path.display()
        )));
    }
    if args.json {
        return Ok(serde_json::to_string_pretty(&stages).unwrap_or_default());
    }
    Ok(stages.iter().map(text).collect::<Vec<_>>().join("\n"))
}

/// Name and history file of each stage of `path`.
fn histories(path: &Path) -> Result<Vec<(String, PathBuf)>, RunError> {
    if path.is_file() {
        let folder = path.canonicalize().ok();
        let name =
            folder.as_deref().and_then(|p| Some(p.parent()?.file_name()?.to_string_lossy().into_owned()));
        return Ok(vec![(name.unwrap_or_default(), path.to_owned())]);
    }
    let scene = crate::diff_command::scene_of(path)?;
    let file = |index: usize| case::stage_folder(path, &scene, index).join("history.csv");
    let names = scene.stages.iter().enumerate().map(|(i, stage)| (stage.name.clone(), file(i)));
    Ok(names.filter(|(_, file)| file.is_file()).collect())
}

/// Of a history, with the scene and the canopy of its run; `None` for a stage without a flow or a completed window.
fn of(
    stage: String,
    file: &Path,
    run: Option<&(&Scene, Option<CanopyInterface>)>,
) -> Result<Option<StageStatistics>, RunError> {
    let (columns, _) = history::read_complete_rows(file)?;
    let windows = columns.iter().find(|(name, _)| name == "drag_n").map_or(0, |(_, values)| values.len());
    if windows == 0 {
        return Ok(None);
    }
    let wake = Wake::of_history(&columns);
    let settled = SettledMean::all(&columns);
    // A warning about means stands where there is one.
    let verdict = wake.as_ref().filter(|_| !settled.is_empty()).and_then(Wake::verdict);
    let warning = verdict.map(|verdict| verdict.warning(&stage));
    let place = run.and_then(|(scene, canopy)| {
        let index = scene.stages.iter().position(|s| s.name == stage)?;
        // The air is that of the stage.
        Some((scene.for_stage(index), index, canopy.as_ref()))
    });
    let reference =
        place.as_ref().and_then(|(scene, _, canopy)| OpeningReference::of(scene, canopy.as_ref()?));
    let opening = reference.and_then(|r| Opening::of_history(&columns, &r));
    let forced_oscillation = place
        .as_ref()
        .zip(file.parent())
        .and_then(|((scene, index, _), folder)| ForcedOscillation::of(scene, *index, folder));
    Ok(Some(StageStatistics { stage, windows, settled, wake, opening, forced_oscillation, warning }))
}

fn text(stage: &StageStatistics) -> String {
    let mut lines =
        vec![format!("stage `{}`, {}:", stage.stage, terminal::counted(stage.windows as u64, "window"))];
    lines.extend(stage.settled.iter().map(|mean| format!("  {}", mean.line())));
    lines.extend(stage.wake.iter().map(|wake| format!("  {}", wake.line())));
    lines.extend(stage.opening.iter().map(|opening| format!("  {}", opening.line())));
    let oscillation = stage.forced_oscillation.iter().flat_map(ForcedOscillation::lines);
    lines.extend(oscillation.map(|line| format!("  {line}")));
    lines.extend(stage.warning.iter().map(|warning| format!("  warning: {warning}")));
    if let Some(mean) = stage.settled.first() {
        lines.push(format!("  method: {}", mean.method));
    } else {
        lines.push("  no settled mean: fewer than 40 windows".into());
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arguments(path: PathBuf, json: bool) -> StatisticsArgs {
        StatisticsArgs { path, json }
    }

    #[test]
    fn statistics_of_a_history_file_state_mean_interval_and_warning() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("history.csv");
        let mut rows =
            String::from("window,time_s,descent_speed_m_s,drag_n,force_x_n,force_y_n,stream_diameters\n");
        for k in 1..2000 {
            let t = 0.02 * f64::from(k);
            let swing = (3.0 * t).sin();
            rows += &format!(
                "{k},{t},{},{},{},0,{}\n",
                4.6 + 0.4 * swing,
                1046.0 - 90.0 * swing,
                200.0 * swing,
                0.5 * t
            );
        }
        std::fs::write(&file, rows + "2000,40.0").expect("written");
        let text = statistics(&arguments(file.clone(), false)).expect("statistics");
        for part in [
            "1999 windows",
            "descent speed 4.",
            "95 %",
            "swing ± 0.40",
            "drag 104",
            "side force rms",
            "method: ",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let json: serde_json::Value =
            serde_json::from_str(&statistics(&arguments(file, true)).expect("statistics")).expect("JSON");
        assert_eq!(json[0]["settled"][0]["stationary"], true);
        assert!(json[0]["wake"]["side_force_share"].as_f64().is_some_and(|share| share > 0.1));
    }

    #[test]
    fn path_without_a_history_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let error = statistics(&arguments(folder.path().into(), false)).expect_err("no run");
        assert!(error.to_string().contains("scene.toml"), "{error}");
        let file = folder.path().join("history.csv");
        std::fs::write(&file, "window,time_s\n0,1\n").expect("written");
        let error = statistics(&arguments(file, false)).expect_err("no flow");
        assert!(error.to_string().contains("no stage with a flow"), "{error}");
    }
}
