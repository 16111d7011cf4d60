//! `ripstop regression`: runs the cases of a folder and compares each with its recorded reference.

mod cases;
mod compare;
mod origin;
mod table;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use case::{Role, Scene};
use coupling::error::{Location, RunError};
use terminal::Console;

use self::cases::{Case, SHARE, cases, remove};
use self::compare::{StageResult, compare};
use self::origin::Origin;
use self::table::Table;
use crate::process::run_scene;

/// Arguments of `ripstop regression`.
#[derive(clap::Args)]
pub struct RegressionArgs {
    /// Folder of cases, or one case: a folder with `scene.toml`, or with `regression.toml` that names a scene, and
    /// `reference/`
    folder: PathBuf,
    /// Run these cases only
    #[arg(long, value_name = "NAME,...", value_delimiter = ',')]
    only: Vec<String>,
    /// Record the references of cases that have none; the other cases are not run
    #[arg(long)]
    record: bool,
    /// Replace the references of cases that deviate or have none
    #[arg(long, conflicts_with = "record")]
    update: bool,
    /// Relative tolerance of all cases, instead of that of their settings; 0: bitwise identical
    #[arg(long, value_name = "RATIO", value_parser = share)]
    tolerance: Option<f64>,
    /// Relative tolerance of iteration counts of all cases, instead of that of their settings
    #[arg(long, value_name = "RATIO", value_parser = share)]
    iteration_tolerance: Option<f64>,
    /// Program to run instead of structure-solver
    #[arg(long, value_name = "COMMAND")]
    structure: Option<String>,
    /// Program to run instead of flow-solver
    #[arg(long, value_name = "COMMAND")]
    flow: Option<String>,
    /// Program to run instead of mesh-mover
    #[arg(long, value_name = "COMMAND")]
    mesh: Option<String>,
    /// Folder of the runs and tables [default: runs/regression-NAME with the name of the folder]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// A share of 1: a tolerance of 1 and more would pass any result.
fn share(text: &str) -> Result<f64, String> {
    let read = text.parse::<f64>().ok().filter(|share| SHARE.contains(share));
    read.ok_or_else(|| "write a number from 0 (bitwise identical) to less than 1".into())
}

/// How a case ended.
#[derive(Clone, Debug, PartialEq)]
enum Verdict {
    /// Within the tolerances of the reference.
    AsRecorded,
    /// The first deviation.
    Deviates(String),
    /// The run failed: its error.
    Failed(String),
    /// There is nothing to compare with.
    NoReference,
    /// A new reference was recorded.
    Recorded,
    /// The reference was replaced; the first deviation from the former one.
    Updated(String),
}

/// A case that was run.
struct Outcome<'a> {
    case: &'a Case,
    verdict: Verdict,
    stages: Vec<StageResult>,
    /// Origin of the run and of the reference.
    origins: [Option<Origin>; 2],
    /// Command that repeats the run and ends at the first deviation.
    command: String,
}

/// Result of a suite.
pub struct Suite {
    /// Text for the terminal.
    pub text: String,
    /// Whether all cases that were compared are as recorded.
    pub same: bool,
    /// The error of a suite in which runs failed.
    pub failed: Option<RunError>,
}

/// Reads a scene with settings `KEY=VALUE`.
pub type Load<'a> = &'a dyn Fn(&Path, &[String]) -> Result<Scene, RunError>;

/// Runs the cases, one after the other. `load` reads a scene with settings `KEY=VALUE`.
///
/// # Errors
/// Wrong settings or an invalid scene of any case (nothing runs then); an interruption; file errors. A failed run is a
/// result, not an error.
pub fn regression(
    args: &RegressionArgs,
    load: Load,
    stop: &AtomicBool,
    console: &Console,
) -> Result<Suite, RunError> {
    let mut cases = cases(&args.folder, &args.only)?;
    cases.iter_mut().for_each(|case| args.change(case));
    let scenes = cases.iter().map(|c| load(&c.scene(), &c.settings.set)).collect::<Result<Vec<_>, _>>()?;
    let out = args.out.clone().unwrap_or_else(|| {
        let folder = args.folder.canonicalize().unwrap_or_default();
        Path::new("runs")
            .join(format!("regression-{}", folder.file_name().unwrap_or_default().to_string_lossy()))
    });
    std::fs::create_dir_all(&out).map_err(RunError::file("create", &out))?;
    let open: Vec<(&Case, &Scene)> =
        cases.iter().zip(&scenes).filter(|(case, _)| !args.record || !case.has_reference()).collect();
    let mut outcomes = Vec::new();
    for (number, (case, scene)) in open.iter().enumerate() {
        if stop.load(Ordering::Relaxed) {
            let stage = format!("regression, before case {}", case.name);
            return Err(RunError::Interrupted(Location { stage, window: None }));
        }
        let start = Instant::now();
        let outcome = Run { args, case, scene, out: &out }.outcome(stop)?;
        let wall = terminal::clock(start.elapsed().as_secs_f64());
        console.line(&format!(
            "{:>4}/{}  {}: {}, {wall}",
            number + 1,
            open.len(),
            case.name,
            outcome.verdict
        ));
        outcomes.push(outcome);
    }
    Table { outcomes: &outcomes, kept: cases.len() - open.len() }.write(&out)
}

impl RegressionArgs {
    fn change(&self, case: &mut Case) {
        let settings = &mut case.settings;
        settings.tolerance = self.tolerance.unwrap_or(settings.tolerance);
        settings.iteration_tolerance = self.iteration_tolerance.or(settings.iteration_tolerance);
    }

    /// Options of `ripstop run` that name other programs.
    fn programs(&self) -> Vec<String> {
        let given = [(Role::Structure, &self.structure), (Role::Flow, &self.flow), (Role::Mesh, &self.mesh)];
        let given = given.into_iter().filter_map(|(role, command)| Some((role, command.clone()?)));
        given.flat_map(|(role, command)| [format!("--{}", role.name()), command]).collect()
    }
}

/// The run of a case.
struct Run<'a> {
    args: &'a RegressionArgs,
    case: &'a Case,
    scene: &'a Scene,
    /// Folder of the suite.
    out: &'a Path,
}

impl<'a> Run<'a> {
    fn outcome(&self, stop: &AtomicBool) -> Result<Outcome<'a>, RunError> {
        let (case, reference) = (self.case, self.case.reference());
        let recording = self.folder().join("recording");
        // A run that fails early would leave the recording of an earlier one.
        remove(&recording)?;
        let ended = self.run(&recording, stop)?;
        let stages: Vec<String> = self.scene.stages.iter().map(|s| s.name.clone()).collect();
        let former = case.has_reference();
        let found =
            if former { compare([&reference, &recording], &stages, &case.settings)? } else { Vec::new() };
        for (stage, comparison) in found.iter().filter_map(|s| Some((&s.name, s.comparison.as_ref()?))) {
            figures::plot::differences(&self.folder(), stage, comparison)?;
        }
        let nothing =
            (former && found.is_empty()).then(|| "the reference has no exchange to compare with".into());
        let deviation = found
            .iter()
            .find_map(|s| Some(format!("stage `{}`: {}", s.name, s.deviation.as_ref()?)))
            .or(nothing);
        let (origin, old) =
            (Origin::of_run(&self.folder(), self.command(&[])), Origin::of_reference(&reference));
        let verdict = match (ended, deviation) {
            (Some(error), _) => Verdict::Failed(error),
            (None, Some(deviation)) if self.args.update => Verdict::Updated(deviation),
            (None, Some(deviation)) => Verdict::Deviates(deviation),
            (None, None) if former => Verdict::AsRecorded,
            (None, None) if self.args.record || self.args.update => Verdict::Recorded,
            (None, None) => Verdict::NoReference,
        };
        if matches!(verdict, Verdict::Recorded | Verdict::Updated(_)) {
            case.keep(&recording, &stages, &origin.text())?;
        }
        let judged = self.judged();
        let command = self.command(&judged);
        Ok(Outcome { case, verdict, stages: found, origins: [Some(origin), old], command })
    }

    /// Folder of the results.
    fn folder(&self) -> PathBuf {
        self.out.join(&self.case.name)
    }

    /// Runs the scene and records it. Returns the error of a failed run.
    fn run(&self, recording: &Path, stop: &AtomicBool) -> Result<Option<String>, RunError> {
        let mut options = self.options();
        let record = ["--record".into(), recording.display().to_string(), "--record-without-grid".into()];
        options.extend(record);
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let log = self.out.join(format!("{}.log", self.case.name));
        let program = results::program::this_program()?;
        let (scene, folder) = (self.case.scene(), self.folder());
        let status =
            run_scene(&program, [&scene, &folder], &options, &log, &mut || stop.load(Ordering::Relaxed))?;
        if stop.load(Ordering::Relaxed) {
            let stage = format!("regression, case {}", self.case.name);
            return Err(RunError::Interrupted(Location { stage, window: None }));
        }
        let words = std::fs::read_to_string(&log).unwrap_or_default();
        let error = words.lines().find_map(|l| l.strip_prefix("error: "));
        Ok((!status.success())
            .then(|| error.map_or_else(|| format!("{status}; its output: {}", log.display()), str::to_owned)))
    }

    /// Options of `ripstop run` that affect the results.
    fn options(&self) -> Vec<String> {
        let settings = &self.case.settings;
        let set = settings.set.iter().flat_map(|s| ["--set".to_owned(), s.clone()]);
        let windows = settings.stop_after_windows.iter();
        let windows = windows.flat_map(|n| ["--stop-after-windows".to_owned(), n.to_string()]);
        set.chain(windows).chain(self.args.programs()).collect()
    }

    /// Options that compare with the reference.
    fn judged(&self) -> Vec<String> {
        let settings = &self.case.settings;
        let mut options = vec!["--baseline".to_owned(), self.case.reference().display().to_string()];
        options.extend(["--tolerance".into(), format!("{:e}", settings.tolerance)]);
        let counts = settings.iteration_tolerance.iter();
        options.extend(counts.flat_map(|t| ["--iteration-tolerance".to_owned(), t.to_string()]));
        options.push("--stop-at-deviation".into());
        options
    }

    fn command(&self, more: &[String]) -> String {
        let scene = self.case.scene().display().to_string();
        let words = ["ripstop".to_owned(), "run".into(), scene].into_iter().chain(self.options());
        let words = words.chain(more.iter().cloned());
        words.map(|w| terminal::shell::quote(&w)).collect::<Vec<_>>().join(" ")
    }
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::AsRecorded => "as recorded",
            Self::Deviates(_) => "deviates",
            Self::Failed(_) => "failed",
            Self::NoReference => "no reference",
            Self::Recorded => "recorded",
            Self::Updated(_) => "updated",
        })
    }
}
