//! `ripstop sweep`: runs of a scene with varied values, and one table of their results.

mod collect;
mod page;
mod plan;

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

use case::Scene;
use coupling::error::{Location, RunError};
use terminal::Console;

use self::page::Results;
use self::plan::{Part, Point, Variation, points};
use crate::process::run_scene;

/// Arguments of `ripstop sweep`.
#[derive(clap::Args)]
pub struct SweepArgs {
    /// Scene file
    pub scene: PathBuf,
    /// Values of a key: KEY=V1,V2,... with values as `--set` takes them, or KEY=FROM..TO:N for N values in equal
    /// steps; several keys: all combinations of their values
    #[arg(long, value_name = "KEY=VALUES", required = true)]
    vary: Vec<Variation>,
    /// One run for each position in the lists of values instead of all combinations
    #[arg(long)]
    together: bool,
    /// Set a key in all runs, as in `ripstop run`
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Folder of the runs and results; an interrupted sweep resumes there
    /// [default: runs/sweep-NAME with the name of the scene]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Number of runs at the same time [default: cores / largest rank count of a program]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=256))]
    jobs: Option<u32>,
    /// Run each N-th of the runs from the K-th on: for task K of N of an array of batch jobs
    #[arg(long, value_name = "K/N")]
    part: Option<Part>,
    /// Collect the results so far without running anything
    #[arg(long, conflicts_with_all = ["part", "jobs"])]
    table: bool,
    /// Print the runs without running them
    #[arg(long, conflicts_with = "table")]
    dry_run: bool,
}

/// A sweep with its runs.
struct Sweep<'a> {
    args: &'a SweepArgs,
    out: PathBuf,
    points: Vec<Point>,
    /// The scene of each run.
    scenes: Vec<Scene>,
}

/// Runs a sweep, and returns the table of its results, and the error of a sweep of which no run is complete. `load` reads the scene with settings `KEY=VALUE`.
///
/// # Errors
/// An invalid scene of any run (nothing runs then); an interruption; file errors. A failed run is a result, not an error.
pub fn sweep(
    args: &SweepArgs,
    load: &dyn Fn(&[String]) -> Result<Scene, RunError>,
    stop: &AtomicBool,
    console: &Console,
) -> Result<(String, Option<RunError>), RunError> {
    let sweep = Sweep::new(args, load)?;
    if args.dry_run {
        let names: Vec<String> = sweep.points.iter().map(|p| format!("  {}", p.name)).collect();
        return Ok((names.join("\n"), None));
    }
    std::fs::create_dir_all(&sweep.out).map_err(RunError::file("create", &sweep.out))?;
    let ended = if args.table { Ok(()) } else { sweep.run(stop, console) };
    let text = sweep.collect()?;
    let any = (0..sweep.points.len()).any(|at| collect::is_complete(&sweep.folder(at), &sweep.scenes[at]));
    let none = (!any && !args.table)
        .then(|| RunError::Study("no run of the sweep is complete; see `ended` in its table".into()));
    ended.map(|()| (text, none))
}

impl<'a> Sweep<'a> {
    fn new(
        args: &'a SweepArgs,
        load: &dyn Fn(&[String]) -> Result<Scene, RunError>,
    ) -> Result<Self, RunError> {
        let points = points(&args.vary, args.together)?;
        let scene = |p: &Point| load(&[args.set.clone(), p.settings(&args.vary).collect()].concat());
        let scenes: Vec<Scene> = points.iter().map(scene).collect::<Result<_, _>>()?;
        let default = || Path::new("runs").join(format!("sweep-{}", scenes[0].name));
        let out = args.out.clone().unwrap_or_else(default);
        Ok(Self { args, out, points, scenes })
    }

    fn folder(&self, at: usize) -> PathBuf {
        self.out.join(&self.points[at].name)
    }

    fn jobs(&self) -> usize {
        let roles = |s: &Scene| s.stages.iter().flat_map(|g| g.kind.roles()).map(|r| s.ranks.of(*r)).max();
        let ranks = self.scenes.iter().filter_map(roles).max().unwrap_or(1).max(1);
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        self.args.jobs.map_or((cores / ranks as usize).max(1), |n| n as usize)
    }

    /// Runs what is not complete yet, several at a time.
    fn run(&self, stop: &AtomicBool, console: &Console) -> Result<(), RunError> {
        let part = self.args.part.unwrap_or(Part::ALL);
        let open: Vec<usize> = (0..self.points.len())
            .filter(|at| part.contains(*at) && !collect::is_complete(&self.folder(*at), &self.scenes[*at]))
            .collect();
        let kept = (0..self.points.len()).filter(|at| part.contains(*at)).count() - open.len();
        console.line(&format!("{} runs in {}, {kept} complete", open.len() + kept, self.out.display()));
        let (next, ended) = (AtomicUsize::new(0), AtomicUsize::new(0));
        let error: Mutex<Option<RunError>> = Mutex::new(None);
        let work = || {
            while !stop.load(Ordering::Relaxed) {
                let Some(&at) = open.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
                console.line(&format!("      {} started", self.points[at].name));
                match self.one(at, stop) {
                    Ok(how) => {
                        let done = ended.fetch_add(1, Ordering::Relaxed) + 1;
                        console.line(&format!("{done:>4}/{}  {}: {how}", open.len(), self.points[at].name));
                    }
                    Err(e) => {
                        error.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(e);
                        return;
                    }
                }
            }
        };
        std::thread::scope(|scope| (0..self.jobs()).for_each(|_| drop(scope.spawn(work))));
        if let Some(error) = error.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(error);
        }
        if stop.load(Ordering::Relaxed) {
            let stage = "sweep (run it again with the same --out to resume)".into();
            return Err(RunError::Interrupted(Location { stage, window: None }));
        }
        Ok(())
    }

    /// Runs or resumes one of the runs. Returns how it ended.
    fn one(&self, at: usize, stop: &AtomicBool) -> Result<String, RunError> {
        let (out, point) = (self.folder(at), &self.points[at]);
        let mut options: Vec<String> = Vec::new();
        for setting in self.args.set.iter().cloned().chain(point.settings(&self.args.vary)) {
            options.extend(["--set".into(), setting]);
        }
        if out.join("resume.json").exists() {
            options.push("--resume".into());
        }
        let options: Vec<&str> = options.iter().map(String::as_str).collect();
        let log = self.out.join(format!("{}.log", point.name));
        let program = results::program::this_program()?;
        let status = run_scene(&program, [&self.args.scene, &out], &options, &log, &mut || {
            stop.load(Ordering::Relaxed)
        })?;
        let words = std::fs::read_to_string(&log).unwrap_or_default();
        let error = words.lines().find_map(|l| l.strip_prefix("error: "));
        Ok(match (status.success(), error) {
            (true, _) => "complete".into(),
            (false, Some(error)) => error.to_owned(),
            (false, None) => format!("{status}"),
        })
    }

    /// Writes the table and the page of all runs so far; returns the text for the terminal.
    fn collect(&self) -> Result<String, RunError> {
        let quantities = collect::quantities(&self.scenes);
        let row = |(at, scene)| collect::row(&self.folder(at), scene, &quantities);
        let rows: Vec<_> = self.scenes.iter().enumerate().map(row).collect();
        let command = std::env::args().collect::<Vec<_>>().join(" ");
        let results = Results {
            title: if self.scenes[0].title.is_empty() { &self.scenes[0].name } else { &self.scenes[0].title },
            command: &command,
            variations: &self.args.vary,
            quantities: &quantities,
            points: &self.points,
            rows: &rows,
        };
        let (table, page) = (self.out.join("sweep.csv"), self.out.join("sweep.html"));
        collect::write(&table, &self.args.vary, &quantities, &self.points, &rows)?;
        std::fs::write(&page, results.page()).map_err(RunError::file("write", &page))?;
        Ok(format!("{}results: {}, {}", results.table(), table.display(), page.display()))
    }
}
