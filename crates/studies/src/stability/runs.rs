//! Runs the samples in parallel, each as a separate `ripstop run`.

use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use coupling::error::{Location, RunError};
use results::history;
use serde::{Deserialize, Serialize};
use terminal::Console;

use super::family::{Point, Sample};
use super::verdict::{Observed, Verdict};
use crate::process::run_scene;

/// Stored result of a sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Completed {
    /// Point of the map.
    pub point: Point,
    /// Classification and errors.
    pub verdict: Verdict,
}

const RESULT: &str = "verdict.json";

/// Runs the samples without results, `jobs` at a time. Returns the results in the order of the samples.
///
/// # Errors
/// An interruption, or a sample that cannot be started. A failed sample is a result, not an error.
pub fn run_samples(
    samples: &[Sample],
    jobs: usize,
    rerun: bool,
    stop: &AtomicBool,
    console: &Console,
) -> Result<Vec<Completed>, RunError> {
    let mut results: Vec<Option<Completed>> =
        samples.iter().map(|m| if rerun { None } else { kept(m) }).collect();
    let open: Vec<usize> = (0..samples.len()).filter(|&i| results[i].is_none()).collect();
    if open.len() < samples.len() {
        console.line(&format!("{} of {} samples have results", samples.len() - open.len(), samples.len()));
    }
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let new: Mutex<Vec<(usize, Result<Completed, RunError>)>> = Mutex::new(Vec::new());
    let halt = AtomicBool::new(false);
    let work = || {
        loop {
            let Some(&at) = open.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
            if stop.load(Ordering::Relaxed) || halt.load(Ordering::Relaxed) {
                return;
            }
            let sample = &samples[at];
            let completed = one(sample, stop);
            let count = done.fetch_add(1, Ordering::Relaxed) + 1;
            match &completed {
                Ok(f) => console.line(&format!("{count:>4}/{}  {}", open.len(), line(f))),
                Err(_) => halt.store(true, Ordering::Relaxed),
            }
            if let Ok(mut new) = new.lock() {
                new.push((at, completed));
            }
        }
    };
    std::thread::scope(|scope| (0..jobs.max(1)).for_each(|_| drop(scope.spawn(work))));
    for (at, completed) in new.into_inner().unwrap_or_default() {
        results[at] = Some(completed?);
    }
    let all: Option<Vec<Completed>> = results.into_iter().collect();
    all.ok_or_else(|| RunError::Interrupted(Location { stage: "stability".into(), window: None }))
}

fn line(f: &Completed) -> String {
    let percent = |e: Option<f64>| e.map_or_else(|| "-".into(), |e| format!("{:+.1} %", 100.0 * e));
    let v = &f.verdict;
    format!(
        "mass ratio {:>6}  {:>5} windows per period  {:>3} substeps  {:<22} {:<10}  {:.1} iterations, frequency {}, \
         amplitude {}",
        f.point.mass_ratio,
        f.point.windows_per_period,
        f.point.substeps,
        f.point.scheme.0,
        v.class.name(),
        v.iterations,
        percent(v.frequency_error),
        percent(v.amplitude_error)
    )
}

fn kept(sample: &Sample) -> Option<Completed> {
    let text = std::fs::read_to_string(sample.folder.join(RESULT)).ok()?;
    serde_json::from_str(&text).ok()
}

fn one(sample: &Sample, stop: &AtomicBool) -> Result<Completed, RunError> {
    let folder = &sample.folder;
    std::fs::create_dir_all(folder).map_err(RunError::file("create", folder))?;
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, &sample.text).map_err(RunError::file("write", &scene))?;
    let failure = run(&scene, folder, stop)?;
    let name = &sample.scene.stages.last().map(|s| s.name.as_str()).unwrap_or_default();
    let observed = read(&folder.join(name).join("history.csv"))?;
    let first = read(&folder.join(&sample.scene.stages[0].name).join("history.csv"));
    let start = first.ok().and_then(|s| s.volume.last().copied()).filter(|v| v.is_finite() && *v != 0.0);
    let exact = match start {
        Some(volume) => sample.exact.clone().from_volume(volume),
        None => sample.exact.clone(),
    };
    let completed =
        Completed { point: sample.point.clone(), verdict: Verdict::new(&observed, &exact, failure) };
    let text = serde_json::to_string_pretty(&completed).unwrap_or_default();
    // Written to a temporary file first, so that the result is complete or missing.
    let (draft, place) = (folder.join("verdict.new"), folder.join(RESULT));
    std::fs::write(&draft, text + "\n").map_err(RunError::file("write", &draft))?;
    std::fs::rename(&draft, &place).map_err(RunError::file("rename", &place))?;
    Ok(completed)
}

/// Runs a sample. Returns the reason of a failure.
fn run(scene: &Path, folder: &Path, stop: &AtomicBool) -> Result<Option<String>, RunError> {
    let program = results::program::this_program()?;
    let log = folder.join("errors.txt");
    let status = run_scene(&program, [scene, folder], &[], &log, &mut || stop.load(Ordering::Relaxed))?;
    let words = std::fs::read_to_string(&log).unwrap_or_default();
    let words = words.trim().trim_start_matches("error: ");
    match status.code() {
        Some(0) => Ok(None),
        Some(1) => Ok(Some(words.to_owned())),
        Some(130) | None if stop.load(Ordering::Relaxed) => {
            Err(RunError::Interrupted(Location { stage: "stability".into(), window: None }))
        }
        _ => Err(RunError::Input(format!("{}: {words}", scene.display()))),
    }
}

/// Reads a history; empty if the file does not exist.
fn read(path: &Path) -> Result<Observed, RunError> {
    if !path.exists() {
        return Ok(Observed::default());
    }
    let columns = history::read(path)?;
    let column = |name: &str| {
        let found = columns.iter().find(|(n, _)| n == name);
        found
            .map(|(_, v)| v.clone())
            .ok_or_else(|| RunError::Input(format!("{} has no column `{name}`", path.display())))
    };
    Ok(Observed {
        time: column("time_s")?,
        volume: column("volume_m3")?,
        kinetic: column("structure_kinetic_energy_j")?,
        energy_error: column("interface_energy_error_sum_j").unwrap_or_default(),
        iterations: column("coupling_iterations").unwrap_or_default(),
    })
}
