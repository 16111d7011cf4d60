//! Runs the outstanding samples in parallel, each as a separate `ripstop run`.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use coupling::error::{Location, RunError};
use coupling::interface::CanopyInterface;
use results::provenance;
use serde::{Deserialize, Serialize};
use terminal::Console;

use super::cost::{self, Cost, Sizes};
use super::estimate;
use super::running::Progress;
use super::study::{Sample, Study};
use crate::process::run_scene;

const RESULT: &str = "result.json";
/// File with the build of the programs, in the folder of a run.
const BUILD_FILE: &str = "programs.txt";

/// Stored result of a sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Build of the programs, see [`provenance::build`].
    pub build: String,
    /// Reason of a failure.
    pub failure: Option<String>,
    /// Note on the values.
    pub note: Option<String>,
    /// Cost of each run.
    pub runs: Vec<Cost>,
    /// Time limit at which it was stopped, s.
    #[serde(default)]
    pub limit_s: Option<f64>,
}

/// How samples are run.
#[derive(Clone, Debug)]
pub struct Execution {
    /// Folder of the study.
    pub out: PathBuf,
    /// Number of parallel runs.
    pub jobs: usize,
    /// Number of runs of each sample.
    pub repeat: usize,
    /// Reuse results of other builds.
    pub any_build: bool,
    /// Maximum wall time of a sample, s.
    pub limit_s: Option<f64>,
}

/// Folder of a sample.
pub fn folder(out: &Path, sample: &Sample) -> PathBuf {
    out.join("samples").join(&sample.key)
}

/// Folder of the run of a sample.
pub fn run_folder(out: &Path, sample: &Sample) -> PathBuf {
    folder(out, sample).join("run")
}

/// The stored result of a sample. A result stopped at a shorter time limit than the present one is ignored.
pub fn kept(execution: &Execution, sample: &Sample, build: &str) -> Option<Record> {
    let text = std::fs::read_to_string(folder(&execution.out, sample).join(RESULT)).ok()?;
    let record: Record = serde_json::from_str(&text).ok()?;
    let longer = record.limit_s.is_some_and(|then| execution.limit_s.is_none_or(|now| now > then));
    (!longer && (execution.any_build || record.build == build)).then_some(record)
}

/// Stored results and outstanding runs.
pub struct Queue {
    /// Records in the order of the samples.
    pub records: Vec<Record>,
    /// Samples to run, in order: one round after another, so that repeated timings of all samples are interleaved.
    pub open: Vec<usize>,
    /// Wall time of a run of the base, s, and whether it was measured.
    pub base_s: (f64, bool),
}

/// Reads the stored results. A failed base is run again.
///
/// # Errors
/// A program is missing.
pub fn queue(study: &Study, execution: &Execution) -> Result<Queue, RunError> {
    let build = provenance::build()?;
    let found = |(i, m): (usize, &Sample)| {
        kept(execution, m, &build)
            .filter(|r| i > 0 || r.failure.is_none())
            .unwrap_or_else(|| Record { build: build.clone(), ..Record::default() })
    };
    let records: Vec<Record> = study.samples.iter().enumerate().map(found).collect();
    let missing = |i: usize| match records[i].failure {
        Some(_) => 0,
        None => execution.repeat.saturating_sub(records[i].runs.len()),
    };
    // Base first, then by decreasing cost, which balances the load of the cores at the end.
    let mut order: Vec<usize> = (0..study.samples.len()).collect();
    order.sort_by(|&a, &b| {
        (b == 0).cmp(&(a == 0)).then(study.samples[b].ratio.total_cmp(&study.samples[a].ratio))
    });
    let mut open = Vec::new();
    for round in 0..execution.repeat {
        open.extend(order.iter().copied().filter(|&i| missing(i) > round));
    }
    let known =
        records.iter().zip(&study.samples).filter_map(|(r, m)| Some((r.runs.first()?.wall_s, m.ratio)));
    let (wall, ratio) = known.fold((0.0, 0.0), |sum, k| (sum.0 + k.0, sum.1 + k.1));
    let base_s =
        if ratio > 0.0 { (wall / ratio, true) } else { (estimate::seconds(&study.samples[0].scene), false) };
    Ok(Queue { records, open, base_s })
}

/// Runs the outstanding samples, the base first and alone. Returns the records in the order of the samples. `judge`
/// returns the reason why a completed base cannot be used.
///
/// # Errors
/// The base fails or cannot be used (no other sample runs then), an interruption, or a sample that cannot be started. A
/// failed sample is a result, not an error.
pub fn run_samples(
    study: &Study,
    execution: &Execution,
    queue: Queue,
    judge: &dyn Fn(&Record) -> Option<String>,
    stop: &AtomicBool,
    console: &Console,
) -> Result<Vec<Record>, RunError> {
    let runs = study.samples.len() * execution.repeat;
    if queue.open.len() < runs {
        console.line(&format!("{} runs have results", runs - queue.open.len()));
    }
    let team = Team {
        study,
        execution,
        stop,
        console,
        records: queue.records.into_iter().map(Mutex::new).collect(),
        progress: Progress::new(study, &execution.out, console, execution.jobs, &queue.open, queue.base_s.0),
        ended: AtomicUsize::new(0),
        all: queue.open.len(),
    };
    let (base, others) = queue.open.split_at(usize::from(queue.open.first() == Some(&0)));
    team.run(base, 1)?;
    let record = team.record(0).clone();
    if let Some(why) = record.failure.clone().or_else(|| judge(&record)) {
        return Err(no_base(&why, &run_folder(&execution.out, &study.samples[0])));
    }
    team.run(others, execution.jobs)?;
    let Team { records, .. } = team;
    Ok(records.into_iter().map(|r| r.into_inner().unwrap_or_else(PoisonError::into_inner)).collect())
}

/// The error of a failed base.
fn no_base(why: &str, run: &Path) -> RunError {
    RunError::Study(format!(
        "the base sample failed: {}\nThe study needs the base for all errors, so no other sample was run. Results and logs: \
         {}. Make the scene run to completion with `ripstop run`, then start the study again.",
        why.trim(),
        run.display()
    ))
}

/// Threads that run samples in parallel.
struct Team<'a> {
    study: &'a Study,
    execution: &'a Execution,
    stop: &'a AtomicBool,
    console: &'a Console,
    records: Vec<Mutex<Record>>,
    progress: Progress<'a>,
    ended: AtomicUsize,
    all: usize,
}

impl Team<'_> {
    fn record(&self, sample: usize) -> MutexGuard<'_, Record> {
        self.records[sample].lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs the samples of `open`, `jobs` at a time.
    fn run(&self, open: &[usize], jobs: usize) -> Result<(), RunError> {
        let (next, halt) = (AtomicUsize::new(0), AtomicBool::new(false));
        let error: Mutex<Option<RunError>> = Mutex::new(None);
        let work = || {
            while !self.stop.load(Ordering::Relaxed) && !halt.load(Ordering::Relaxed) {
                let Some(&at) = open.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
                if let Err(e) = self.sample(at) {
                    halt.store(true, Ordering::Relaxed);
                    error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
                }
            }
        };
        std::thread::scope(|scope| (0..jobs.max(1)).for_each(|_| drop(scope.spawn(work))));
        if let Some(error) = error.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        if self.stop.load(Ordering::Relaxed) { Err(interrupted()) } else { Ok(()) }
    }

    /// Runs a sample once, unless it has failed before.
    fn sample(&self, at: usize) -> Result<(), RunError> {
        let sample = &self.study.samples[at];
        // Locked during the run, because all runs of a sample use the same folder.
        let mut kept = self.record(at);
        self.progress.begin(at);
        let result = if kept.failure.is_some() {
            Ok(kept.clone())
        } else {
            one(sample, self.execution, kept.clone(), self.stop, &|| self.progress.tick())
        };
        self.progress.end(at, result.as_ref().is_ok_and(|r| r.failure.is_none()));
        *kept = result?;
        let ended = self.ended.fetch_add(1, Ordering::Relaxed) + 1;
        self.console.line(&format!("{ended:>4}/{}  {}", self.all, line(sample, &kept)));
        Ok(())
    }
}

fn interrupted() -> RunError {
    RunError::Interrupted(Location {
        stage: "accuracy (run it again with the same --out to resume)".into(),
        window: None,
    })
}

fn line(sample: &Sample, record: &Record) -> String {
    match (&record.failure, record.runs.last()) {
        (Some(why), _) => format!("{:<28} failed: {}", sample.label, why.lines().next().unwrap_or_default()),
        (None, Some(cost)) => {
            format!("{:<28} {:>9.2} s, work {:.2} s", sample.label, cost.wall_s, cost.counts().work())
        }
        (None, None) => sample.label.clone(),
    }
}

fn one(
    sample: &Sample,
    execution: &Execution,
    before: Record,
    stop: &AtomicBool,
    tick: &dyn Fn(),
) -> Result<Record, RunError> {
    let folder = folder(&execution.out, sample);
    std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, &sample.text).map_err(RunError::file("write", &scene))?;
    let run_folder = run_folder(&execution.out, sample);
    let mut record = before;
    let ended = run(&scene, &run_folder, &record.build, execution.limit_s, stop, tick)?;
    record.limit_s = execution.limit_s.filter(|_| matches!(ended, End::Late(_)));
    record.failure = match ended {
        End::Complete => None,
        End::Late(why) | End::Failed(why) => Some(why),
    };
    let sizes = CanopyInterface::new(&sample.scene).map(|i| Sizes {
        elements: (i.sizes.triangles + i.sizes.cables) as f64,
        nodes: i.sizes.nodes as f64,
        ..Sizes::default()
    })?;
    match cost::read(&run_folder, sizes) {
        Ok(cost) => record.runs.push(cost),
        // A run that failed early has no summary.
        Err(_) if record.failure.is_some() => {}
        Err(why) => record.failure = Some(why),
    }
    record.note = above_tolerance(&run_folder);
    prune(&run_folder, &sample.scene);
    let text = serde_json::to_string_pretty(&record).unwrap_or_default();
    // Written to a temporary file first, so that the result is complete or missing.
    let (draft, place) = (folder.join("result.new"), folder.join(RESULT));
    std::fs::write(&draft, text + "\n").map_err(RunError::file("write", &draft))?;
    std::fs::rename(&draft, &place).map_err(RunError::file("rename", &place))?;
    Ok(record)
}

/// Note on windows that did not converge.
fn above_tolerance(out: &Path) -> Option<String> {
    let text = std::fs::read_to_string(out.join("summary.json")).ok()?;
    let summary: serde_json::Value = serde_json::from_str(&text).ok()?;
    let stages = summary["stages"].as_array()?;
    let parts = ["coupling", "structure", "flow", "mesh", "turbulence", "cells"];
    let of = |part: &&str| -> Option<String> {
        let counts = stages.iter().filter_map(|s| s["convergence"][*part]["windows"].as_u64());
        let count: u64 = counts.sum();
        (count > 0).then(|| format!("{part} not converged in {count} windows"))
    };
    let found: Vec<String> = parts.iter().filter_map(of).collect();
    (!found.is_empty()).then(|| found.join(", "))
}

/// Removes the saved states of the solvers, which are large and not needed.
fn prune(out: &Path, scene: &case::Scene) {
    for stage in 0..scene.stages.len() {
        let state = case::state_folder(out, scene, stage);
        for name in ["structure.bin", "flow.bin", "mesh.bin", "canopy.bin"] {
            drop(std::fs::remove_file(state.join(name)));
        }
    }
}

/// Whether `out` contains an interrupted run of this build, which can be resumed.
fn interrupted_in(out: &Path, build: &str) -> bool {
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap_or_default();
    let summary: serde_json::Value = serde_json::from_str(&read("summary.json")).unwrap_or_default();
    // A summary without `ended` is that of a killed run.
    let how = summary["ended"].as_str().unwrap_or("interrupted");
    out.join("resume.json").exists() && how.starts_with("interrupted") && read(BUILD_FILE) == build
}

/// How a run ended.
enum End {
    Complete,
    Late(String),
    Failed(String),
}

/// Runs a sample.
fn run(
    scene: &Path,
    out: &Path,
    build: &str,
    limit_s: Option<f64>,
    stop: &AtomicBool,
    tick: &dyn Fn(),
) -> Result<End, RunError> {
    let program = results::program::this_program()?;
    let resumes = interrupted_in(out, build);
    if !resumes {
        if out.exists() {
            std::fs::remove_dir_all(out).map_err(RunError::file("clear", out))?;
        }
        std::fs::create_dir_all(out).map_err(RunError::file("create", out))?;
        let by = out.join(BUILD_FILE);
        std::fs::write(&by, build).map_err(RunError::file("write", &by))?;
    }
    let log = scene.with_file_name("errors.txt");
    let (begun, mut late) = (Instant::now(), false);
    let options: &[&str] = if resumes { &["--resume"] } else { &[] };
    let status = run_scene(&program, [scene, out], options, &log, &mut || {
        late |= limit_s.is_some_and(|l| begun.elapsed().as_secs_f64() > l);
        tick();
        late || stop.load(Ordering::Relaxed)
    })?;
    if stop.load(Ordering::Relaxed) {
        return Err(interrupted());
    }
    if late {
        return Ok(End::Late(format!(
            "stopped at the wall time --limit {:.0} s",
            limit_s.unwrap_or_default()
        )));
    }
    let words = std::fs::read_to_string(&log).unwrap_or_default();
    // Reports must not contain folders of this machine.
    let own = format!("{}/", out.display());
    let words = words.trim().trim_start_matches("error: ").replace(&own, "");
    Ok(match status.code() {
        Some(0) => End::Complete,
        _ if words.is_empty() => End::Failed(format!("ended with {status}")),
        _ => End::Failed(words),
    })
}
