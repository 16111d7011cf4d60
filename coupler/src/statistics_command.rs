//! `ripstop statistics`: settled means and wake of complete, running or interrupted runs, and the mean of several.

use std::path::{Path, PathBuf};

use case::Scene;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use results::forced_oscillation::ForcedOscillation;
use results::history;
use results::opening::{Opening, OpeningReference};
use results::pooled::{self, PooledMean};
use results::settled::SettledMean;
use results::wake::Wake;
use serde::Serialize;

/// Arguments of `ripstop statistics`.
#[derive(clap::Args)]
pub struct StatisticsArgs {
    /// Results folder of a complete, running or interrupted run, or a history.csv. Several, such as runs of one scene with different seeds of a perturbation: also the mean of
    /// all of them, stage by stage
    #[arg(value_name = "RUN", required = true, num_args = 1..)]
    paths: Vec<PathBuf>,
    /// Print JSON: an array with an object for each stage; of several runs an object with the arrays `runs` and `pooled`
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

/// Statistics of a run.
#[derive(Serialize)]
struct RunStatistics {
    /// Results folder, or file.
    run: PathBuf,
    /// Stages with a flow.
    stages: Vec<StageStatistics>,
}

/// Means of all runs in the stages of one name.
#[derive(Serialize)]
struct PooledStage {
    /// Name of the stage.
    stage: String,
    /// Means of the quantities that have an interval in at least two runs.
    means: Vec<PooledMean>,
}

/// The statistics of `args.paths` as text or JSON.
///
/// # Errors
/// [`RunError::Input`]: a path has no history with a flow, or is named twice.
pub fn statistics(args: &StatisticsArgs) -> Result<String, RunError> {
    let mut runs = Vec::with_capacity(args.paths.len());
    for path in &args.paths {
        refuse_twice(&runs, path)?;
        runs.push(RunStatistics { run: path.clone(), stages: stages_of(path)? });
    }
    if let [run] = &runs[..] {
        return Ok(if args.json {
            serde_json::to_string_pretty(&run.stages).unwrap_or_default()
        } else {
            run.stages.iter().map(text).collect::<Vec<_>>().join("\n")
        });
    }
    let pooled = pooled_stages(&runs);
    if args.json {
        let all = serde_json::json!({ "runs": runs, "pooled": pooled });
        return Ok(serde_json::to_string_pretty(&all).unwrap_or_default());
    }
    let mut parts: Vec<String> = Vec::new();
    for run in &runs {
        parts.push(format!("{}:", run.run.display()));
        parts.extend(run.stages.iter().map(text));
    }
    parts.extend(pooled.iter().map(|stage| pooled_text(stage, runs.len())));
    Ok(parts.join("\n"))
}

/// A run that counts twice would narrow the interval without any new data.
fn refuse_twice(runs: &[RunStatistics], path: &Path) -> Result<(), RunError> {
    let place = |p: &Path| p.canonicalize().unwrap_or_else(|_| p.to_owned());
    if runs.iter().any(|r| place(&r.run) == place(path)) {
        return Err(RunError::Input(format!(
            "{} is named twice: name each run once, as the mean of several counts them as independent",
            path.display()
        )));
    }
    Ok(())
}

/// Means of all runs in each stage that at least two of them have, in the order of the first run.
fn pooled_stages(runs: &[RunStatistics]) -> Vec<PooledStage> {
    let names = runs[0].stages.iter().map(|s| s.stage.clone());
    names
        .map(|stage| {
            let same = || runs.iter().flat_map(|r| &r.stages).filter(|s| s.stage == stage);
            let means = results::settled::QUANTITIES
                .iter()
                .filter_map(|(quantity, _, _)| {
                    let of: Vec<&SettledMean> =
                        same().flat_map(|s| &s.settled).filter(|m| m.quantity == *quantity).collect();
                    PooledMean::of(&of)
                })
                .collect();
            PooledStage { stage, means }
        })
        .collect()
}

fn pooled_text(pooled: &PooledStage, runs: usize) -> String {
    let mut lines = vec![format!("stage `{}`, {runs} runs together:", pooled.stage)];
    lines.extend(pooled.means.iter().map(|mean| format!("  {}", mean.line())));
    lines.push(if pooled.means.is_empty() {
        "  no mean of several runs: no quantity has a mean with an interval in two of them".into()
    } else {
        format!("  method: {}", pooled::METHOD)
    });
    lines.join("\n")
}

/// The stages of a run with a flow and a completed window.
fn stages_of(path: &Path) -> Result<Vec<StageStatistics>, RunError> {
    let scene = path.is_dir().then(|| crate::diff_command::scene_of(path).ok()).flatten();
    let run = scene.as_ref().map(|scene| (scene, CanopyInterface::new(scene).ok()));
    let stages: Vec<StageStatistics> = histories(path)?
        .into_iter()
        .map(|(name, file)| of(name, &file, run.as_ref()))
        .collect::<Result<Vec<Option<StageStatistics>>, RunError>>()?
        .into_iter()
        .flatten()
        .collect();
    if stages.is_empty() {
        return Err(RunError::Input(format!(
            "{} has no stage with a flow and at least one completed window. Name the results folder of `ripstop run`, or a history.csv in it",
            path.display()
        )));
    }
    Ok(stages)
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
        StatisticsArgs { paths: vec![path], json }
    }

    /// 1999 windows of a canopy that swings about `mean`, m/s, and an incomplete row.
    fn write_history(file: &Path, mean: f64) {
        let mut rows =
            String::from("window,time_s,descent_speed_m_s,drag_n,force_x_n,force_y_n,stream_diameters\n");
        for k in 1..2000 {
            let t = 0.02 * f64::from(k);
            let swing = (3.0 * t).sin();
            let uneven = 0.05 * (11.3 * t * t.sqrt()).sin();
            rows += &format!(
                "{k},{t},{},{},{},0,{}\n",
                mean + 0.4 * swing + uneven,
                1046.0 - 90.0 * swing,
                200.0 * swing,
                0.5 * t
            );
        }
        std::fs::write(file, rows + "2000,40.0").expect("written");
    }

    #[test]
    fn statistics_of_a_history_file_state_mean_interval_and_warning() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("history.csv");
        write_history(&file, 4.6);
        let text = statistics(&arguments(file.clone(), false)).expect("statistics");
        for part in [
            "1999 windows",
            "descent speed 4.",
            "95 %",
            "swing ± 0.4",
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
    fn several_runs_have_a_mean_together() {
        let folder = tempfile::tempdir().expect("a folder");
        let files = ["one", "two"].map(|name| {
            let folder = folder.path().join(name).join("descent");
            std::fs::create_dir_all(&folder).expect("a folder");
            folder.join("history.csv")
        });
        write_history(&files[0], 4.6);
        write_history(&files[1], 4.6002);
        let of = |paths: &[PathBuf], json| statistics(&StatisticsArgs { paths: paths.to_vec(), json });
        let text = of(&files, false).expect("statistics");
        for part in [
            "one/descent/history.csv:",
            "stage `descent`, 2 runs together:",
            "descent speed 4.60",
            "95 %, 2 runs; scatter",
            "Particle Data Group",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        let json: serde_json::Value =
            serde_json::from_str(&of(&files, true).expect("statistics")).expect("JSON");
        let half = |run: &serde_json::Value| {
            run["stages"][0]["settled"][0]["interval_95"].as_f64().expect("an interval")
        };
        let [a, b] = [0, 1].map(|k| half(&json["runs"][k]));
        let pooled = &json["pooled"][0]["means"][0];
        assert_eq!((&pooled["quantity"], &pooled["runs"]), (&"descent_speed_m_s".into(), &2.into()));
        let together = pooled["interval_95"].as_f64().expect("an interval");
        assert!(together < a.min(b), "{together} {a} {b}");
        let error = of(&[files[0].clone(), files[0].clone()], false).expect_err("twice");
        assert!(error.to_string().contains("is named twice"), "{error}");
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
