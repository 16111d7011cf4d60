//! Flies the members that have no result yet, some at a time, each as a `ripstop run` of its own.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use super::cost::{self, Cost, Sizes};
use super::study::{Member, Study};
use crate::error::{Place, RunError};
use crate::interface::CanopyInterface;
use crate::launch::{Console, program_folder};
use crate::progress::clock;

const RESULT: &str = "result.json";
/// Which programs fly a member, in the folder of its run.
const FLOWN_BY: &str = "programs.txt";

/// What is kept of a member beside the files of its run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// The programs that flew it, see [`build`].
    pub build: String,
    /// Why it has no values.
    pub failure: Option<String>,
    /// What is to be known about its values.
    pub note: Option<String>,
    /// Cost of each time that it was flown.
    pub runs: Vec<Cost>,
}

/// How members are flown.
#[derive(Clone, Debug)]
pub struct Flight {
    /// Folder of the study.
    pub out: PathBuf,
    /// Members at the same time.
    pub jobs: usize,
    /// How often each is flown.
    pub repeat: usize,
    /// Takes results of other builds of the programs too.
    pub any_build: bool,
    /// Longest wall time of a member, s.
    pub limit_s: Option<f64>,
}

/// Name of a text: its length and two sums.
pub fn key_of(text: &str) -> String {
    let reversed: Vec<u8> = text.bytes().rev().collect();
    format!("{:08x}{:08x}", crc32fast::hash(text.as_bytes()), crc32fast::hash(&reversed))
}

/// Sums of the programs: results of other programs are not mixed with theirs.
///
/// # Errors
/// Programs that are missing.
pub fn build() -> Result<String, RunError> {
    let folder = program_folder()?;
    let mut sums = Vec::new();
    for name in ["ripstop", "structure-solver", "flow-solver", "mesh-mover"] {
        let path = folder.join(name);
        // A program that is missing is told by the run that needs it.
        let bytes = std::fs::read(&path).unwrap_or_default();
        sums.push(format!("{:08x}", crc32fast::hash(&bytes)));
    }
    Ok(format!("{} {}", env!("CARGO_PKG_VERSION"), sums.join(" ")))
}

/// Folder of a member.
pub fn folder(out: &Path, member: &Member) -> PathBuf {
    out.join("members").join(&member.key)
}

/// Folder of its run.
pub fn run_folder(out: &Path, member: &Member) -> PathBuf {
    folder(out, member).join("run")
}

/// The result of a member that was flown before.
pub fn kept(flight: &Flight, member: &Member, build: &str) -> Option<Record> {
    let text = std::fs::read_to_string(folder(&flight.out, member).join(RESULT)).ok()?;
    let record: Record = serde_json::from_str(&text).ok()?;
    (flight.any_build || record.build == build).then_some(record)
}

/// Flies what is missing: round after round, so that repeated timings of all members lie side by
/// side in time; results in the order of the members.
///
/// # Errors
/// An interruption, and whatever keeps a member from being started: a member that fails is a result.
pub fn fly(
    study: &Study,
    flight: &Flight,
    stop: &AtomicBool,
    console: &Console,
) -> Result<Vec<Record>, RunError> {
    let build = build()?;
    let records: Vec<Mutex<Record>> = study
        .members
        .iter()
        .map(|m| {
            Mutex::new(
                kept(flight, m, &build)
                    .unwrap_or_else(|| Record { build: build.clone(), ..Record::default() }),
            )
        })
        .collect();
    let lock = |i: usize| records[i].lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let missing = |i: usize| {
        let r = lock(i);
        if r.failure.is_some() { 0 } else { flight.repeat.saturating_sub(r.runs.len()) }
    };
    // Long members first: the last ones then share the cores evenly. The base comes first of all.
    let mut order: Vec<usize> = (0..study.members.len()).collect();
    order.sort_by(|&a, &b| {
        (b == 0).cmp(&(a == 0)).then(study.members[b].ratio.total_cmp(&study.members[a].ratio))
    });
    let mut open = Vec::new();
    for round in 0..flight.repeat {
        open.extend(order.iter().copied().filter(|&i| missing(i) > round));
    }
    if open.len() < study.members.len() * flight.repeat {
        console.line(&format!("{} runs are there already", study.members.len() * flight.repeat - open.len()));
    }
    let (next, begun) = (AtomicUsize::new(0), Instant::now());
    let progress = Mutex::new((0usize, 0.0f64));
    let total: f64 = open.iter().map(|&i| study.members[i].ratio).sum();
    let halt = AtomicBool::new(false);
    let errors: Mutex<Option<RunError>> = Mutex::new(None);
    let work = || {
        while !stop.load(Ordering::Relaxed) && !halt.load(Ordering::Relaxed) {
            let Some(&at) = open.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
            let member = &study.members[at];
            // Held while it flies: its folder is one.
            let mut kept = lock(at);
            if kept.failure.is_some() {
                continue;
            }
            match one(member, flight, kept.clone(), stop) {
                Ok(record) => {
                    let mut done = progress.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
                    done.0 += 1;
                    done.1 += member.ratio;
                    let rest = begun.elapsed().as_secs_f64() * (total - done.1).max(0.0) / done.1;
                    let rest = if done.0 < open.len() {
                        format!(", about {} to go", clock(rest))
                    } else {
                        String::new()
                    };
                    console.line(&format!("{:>4}/{}  {}{rest}", done.0, open.len(), line(member, &record)));
                    *kept = record;
                }
                Err(error) => {
                    halt.store(true, Ordering::Relaxed);
                    errors.lock().unwrap_or_else(std::sync::PoisonError::into_inner).get_or_insert(error);
                }
            }
        }
    };
    std::thread::scope(|scope| (0..flight.jobs.max(1)).for_each(|_| drop(scope.spawn(work))));
    if let Some(error) = errors.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        return Err(error);
    }
    if stop.load(Ordering::Relaxed) {
        return Err(interrupted());
    }
    Ok(records
        .into_iter()
        .map(|r| r.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner))
        .collect())
}

fn interrupted() -> RunError {
    RunError::Interrupted(Place {
        stage: "accuracy (start it again with the same --out to go on)".into(),
        window: None,
    })
}

fn line(member: &Member, record: &Record) -> String {
    match (&record.failure, record.runs.last()) {
        (Some(why), _) => format!("{:<28} failed: {}", member.label, why.lines().next().unwrap_or_default()),
        (None, Some(cost)) => {
            format!("{:<28} {:>9.2} s, work {:.2} s", member.label, cost.wall_s, cost.counts().work())
        }
        (None, None) => member.label.clone(),
    }
}

fn one(member: &Member, flight: &Flight, before: Record, stop: &AtomicBool) -> Result<Record, RunError> {
    let folder = folder(&flight.out, member);
    std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
    let scene = folder.join("scene.toml");
    std::fs::write(&scene, &member.text).map_err(RunError::file("write", &scene))?;
    let run_folder = run_folder(&flight.out, member);
    let mut record = before;
    record.failure = run(&scene, &run_folder, &record.build, flight.limit_s, stop)?;
    let sizes = CanopyInterface::new(&member.scene).map(|i| Sizes {
        elements: (i.sizes.triangles + i.sizes.cables) as f64,
        nodes: i.sizes.nodes as f64,
        ..Sizes::default()
    })?;
    match cost::read(&run_folder, sizes) {
        Ok(cost) => record.runs.push(cost),
        // What fails at once has no summary.
        Err(_) if record.failure.is_some() => {}
        Err(why) => record.failure = Some(why),
    }
    record.note = above_tolerance(&run_folder);
    prune(&run_folder, &member.scene);
    let text = serde_json::to_string_pretty(&record).unwrap_or_default();
    // Beside its place first: a result is whole, or it is not there.
    let (draft, place) = (folder.join("result.new"), folder.join(RESULT));
    std::fs::write(&draft, text + "\n").map_err(RunError::file("write", &draft))?;
    std::fs::rename(&draft, &place).map_err(RunError::file("rename", &place))?;
    Ok(record)
}

/// Windows that the coupling left above its tolerance.
fn above_tolerance(out: &Path) -> Option<String> {
    let text = std::fs::read_to_string(out.join("summary.json")).ok()?;
    let summary: serde_json::Value = serde_json::from_str(&text).ok()?;
    let stages = summary["stages"].as_array()?;
    let count: u64 = stages.iter().filter_map(|s| s["not_converged"].as_u64()).sum();
    (count > 0).then(|| format!("{count} windows above the coupling's tolerance"))
}

/// States of solvers and logs are most of a run and of no use to a study.
fn prune(out: &Path, scene: &case::Scene) {
    for stage in 0..scene.stages.len() {
        let state = case::state_folder(out, scene, stage);
        for name in ["structure.bin", "flow.bin", "mesh.bin", "canopy.bin"] {
            drop(std::fs::remove_file(state.join(name)));
        }
    }
}

/// Whether a run of these programs was broken off in `out`, and can be gone on with.
fn broken_off(out: &Path, build: &str) -> bool {
    let read = |name: &str| std::fs::read_to_string(out.join(name)).unwrap_or_default();
    let summary: serde_json::Value = serde_json::from_str(&read("summary.json")).unwrap_or_default();
    // Beside an interruption only a run that was killed with all its programs has no word on its end.
    let how = summary["ended"].as_str().unwrap_or("interrupted");
    out.join("resume.json").exists() && how.starts_with("interrupted") && read(FLOWN_BY) == build
}

/// Runs a member to its end; why it failed, if it did.
fn run(
    scene: &Path,
    out: &Path,
    build: &str,
    limit_s: Option<f64>,
    stop: &AtomicBool,
) -> Result<Option<String>, RunError> {
    let program = std::env::current_exe().map_err(RunError::file("find", "ripstop"))?;
    let goes_on = broken_off(out, build);
    if !goes_on {
        if out.exists() {
            std::fs::remove_dir_all(out).map_err(RunError::file("clear", out))?;
        }
        std::fs::create_dir_all(out).map_err(RunError::file("create", out))?;
        let by = out.join(FLOWN_BY);
        std::fs::write(&by, build).map_err(RunError::file("write", &by))?;
    }
    let log = scene.with_file_name("errors.txt");
    let file = std::fs::File::create(&log).map_err(RunError::file("create", &log))?;
    let begun = Instant::now();
    let mut child = Command::new(&program)
        .arg("run")
        .arg(scene)
        .arg("--out")
        .arg(out)
        .arg("--quiet")
        .args(goes_on.then_some("--resume"))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(file)
        .spawn()
        .map_err(RunError::file("start", &program))?;
    let (mut told, mut late) = (false, false);
    let status = loop {
        if let Some(status) = child.try_wait().map_err(RunError::file("wait for", &program))? {
            break status;
        }
        late |= limit_s.is_some_and(|l| begun.elapsed().as_secs_f64() > l);
        if (late || stop.load(Ordering::Relaxed)) && !told {
            // It ends its programs by itself.
            // SAFETY: a signal to a child that has not been waited for.
            unsafe { libc::kill(child.id() as libc::pid_t, libc::SIGTERM) };
            told = true;
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    if stop.load(Ordering::Relaxed) {
        return Err(interrupted());
    }
    if late {
        return Ok(Some(format!("longer than --limit {:.0} s", limit_s.unwrap_or_default())));
    }
    let words = std::fs::read_to_string(&log).unwrap_or_default();
    // Reasons stand on pages that are kept: not with the folders of this machine.
    let own = format!("{}/", out.display());
    let words = words.trim().trim_start_matches("error: ").replace(&own, "");
    Ok(match status.code() {
        Some(0) => None,
        _ if words.is_empty() => Some(format!("ended with {status}")),
        _ => Some(words),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_tell_texts_apart() {
        assert_ne!(key_of("a = 1"), key_of("a = 2"));
        assert_eq!(key_of("x").len(), 16);
    }
}
