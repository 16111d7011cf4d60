//! Runs the test programs of a build, two at a time.
//!
//! `test-lanes MESSAGES` reads what `cargo test --no-run --message-format=json` printed, runs each test program in the folder of
//! its crate, and prints the output of a program as a whole when it has ended, with the headings of `cargo test`. Cargo itself
//! runs one program after the other, and a core waits wherever a program has one long test left.
//!
//! Two lanes take one test each, because most tests start the programs of a scene. Programs that inspect the machine run first and
//! alone. The long ones of `ripstop-tests` follow, so that neither lane has a long program left at the end. Exit code 1 where a program fails.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, ExitStatus};
use std::sync::{Mutex, PoisonError};

use serde::Deserialize;

/// Programs that run at the same time.
const LANES: usize = 2;
/// Test programs that look at all processes, at all shared memory or at the load of the machine.
const ALONE: [&str; 6] = ["fault_leftovers", "fault_long", "faults", "fuzz_states", "hosts", "load"];
/// The package whose test programs are the longest.
const LONG: &str = "ripstop-tests";

/// A line of Cargo's messages, as far as it names test programs.
#[derive(Deserialize)]
struct Message {
    executable: Option<PathBuf>,
    manifest_path: Option<PathBuf>,
    target: Option<Target>,
    profile: Option<Profile>,
}

#[derive(Deserialize)]
struct Target {
    kind: Vec<String>,
    name: String,
    src_path: PathBuf,
}

#[derive(Deserialize)]
struct Profile {
    test: bool,
}

/// A test program and where it comes from.
struct Program {
    executable: PathBuf,
    /// Folder of the crate.
    folder: PathBuf,
    package: String,
    target: Target,
}

impl Program {
    /// The test program that a line of Cargo's messages names, if it names one.
    fn of_message(line: &str) -> Result<Option<Self>, String> {
        let message: Message = serde_json::from_str(line).map_err(|e| format!("{e}: {line}"))?;
        let (Some(executable), Some(manifest), Some(target), Some(Profile { test: true })) =
            (message.executable, message.manifest_path, message.target, message.profile)
        else {
            return Ok(None);
        };
        let text = std::fs::read_to_string(&manifest).map_err(|e| format!("{}: {e}", manifest.display()))?;
        let package =
            text.lines().find_map(|l| l.strip_prefix("name = \"")).and_then(|l| l.strip_suffix('"'));
        let package = package.ok_or_else(|| format!("{}: no name", manifest.display()))?.to_owned();
        let folder = manifest.parent().ok_or("a manifest without a folder")?.to_path_buf();
        Ok(Some(Self { executable, folder, package, target }))
    }

    fn is_alone(&self) -> bool {
        self.package == LONG && ALONE.contains(&self.target.name.as_str())
    }

    /// Place in the order: alone, long, other integration tests, tests within crates.
    fn order(&self) -> usize {
        if self.is_alone() {
            0
        } else if !self.is_integration() {
            3
        } else if self.package == LONG {
            1
        } else {
            2
        }
    }

    fn is_integration(&self) -> bool {
        self.target.kind.iter().any(|k| k == "test")
    }

    /// As `cargo test` prints it.
    fn heading(&self) -> String {
        let source = self.target.src_path.strip_prefix(&self.folder).unwrap_or(&self.target.src_path);
        let unit = if self.is_integration() { "" } else { "unittests " };
        format!("     Running {unit}{} ({})\n", source.display(), self.executable.display())
    }

    /// What selects this program again.
    fn selection(&self) -> String {
        let kind = if self.is_integration() {
            format!("--test {}", self.target.name)
        } else if self.target.kind.iter().any(|k| k == "bin") {
            format!("--bin {}", self.target.name)
        } else {
            "--lib".to_owned()
        };
        format!("-p {} {kind}", self.package)
    }

    /// Runs it with its output in `output`.
    fn run(&self, threads: usize, output: &File) -> std::io::Result<ExitStatus> {
        let mut command = Command::new(&self.executable);
        command.arg(format!("--test-threads={threads}")).current_dir(&self.folder);
        command.env("CARGO_MANIFEST_DIR", &self.folder).env("CARGO_PKG_NAME", &self.package);
        command.stdin(std::process::Stdio::null());
        command.stdout(output.try_clone()?).stderr(output.try_clone()?);
        command.status()
    }

    /// Runs it and prints the whole of its output. Returns whether it passed.
    fn report(&self, threads: usize) -> std::io::Result<bool> {
        let mut output = tempfile::tempfile()?;
        let status = self.run(threads, &output)?;
        output.rewind()?;
        let mut text = Vec::new();
        output.read_to_end(&mut text)?;
        let mut out = std::io::stdout().lock();
        out.write_all(self.heading().as_bytes())?;
        out.write_all(&text)?;
        if !status.success() {
            writeln!(out, "error: test failed, to rerun pass `{}`\n", self.selection())?;
            // 101 is the code of a test program in which a test failed.
            if status.code() != Some(101) {
                writeln!(out, "Caused by:\n  {} ended: {status}\n", self.executable.display())?;
            }
        }
        out.flush()?;
        Ok(status.success())
    }
}

/// Test programs that Cargo's messages in `file` name, in the order in which they run.
fn programs(file: &Path) -> Result<Vec<Program>, String> {
    let at = |e: std::io::Error| format!("{}: {e}", file.display());
    let mut found = Vec::new();
    for line in BufReader::new(File::open(file).map_err(at)?).lines() {
        found.extend(Program::of_message(&line.map_err(at)?)?);
    }
    found.sort_by_key(|p| (p.order(), p.package.clone(), p.target.name.clone()));
    if found.is_empty() {
        return Err(format!("{}: no test programs", file.display()));
    }
    Ok(found)
}

/// Runs all programs, those of a queue in each lane one after the other. Returns whether all passed.
fn run_all(programs: Vec<Program>) -> std::io::Result<bool> {
    let mut passed = true;
    let (alone, others): (VecDeque<_>, VecDeque<_>) = programs.into_iter().partition(Program::is_alone);
    for program in alone {
        passed &= program.report(LANES)?;
    }
    let waiting = Mutex::new(others);
    let next = || waiting.lock().unwrap_or_else(PoisonError::into_inner).pop_front();
    let lane = || -> std::io::Result<bool> {
        let mut passed = true;
        while let Some(program) = next() {
            passed &= program.report(1)?;
        }
        Ok(passed)
    };
    std::thread::scope(|scope| {
        let lanes: Vec<_> = (0..LANES).map(|_| scope.spawn(lane)).collect();
        for lane in lanes {
            let ended = lane.join().unwrap_or_else(|_| Err(std::io::Error::other("a lane panicked")));
            passed &= ended?;
        }
        Ok(passed)
    })
}

fn main() -> ExitCode {
    let [file] = std::env::args_os().skip(1).collect::<Vec<_>>().try_into().unwrap_or_else(|_| {
        eprintln!("usage: test-lanes MESSAGES");
        std::process::exit(2)
    });
    let ended = programs(Path::new(&file)).and_then(|p| run_all(p).map_err(|e| e.to_string()));
    match ended {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(why) => {
            eprintln!("error: test-lanes: {why}");
            ExitCode::FAILURE
        }
    }
}
