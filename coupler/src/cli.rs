//! The command line `ripstop`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use case::Role;
use clap::{Args, Parser, Subcommand};
use coupling::error::RunError;
use results::checkpoint;
use results::recording::stand_in::StandIn;
use studies::effects::Runs;
use terminal::Console;

use crate::arguments::{mpirun, ranks, ratio, role, seconds};
use crate::exit_codes::HELP as CODES;
use crate::former_options;
use crate::run::{BaselineOptions, LogLevel, RecordOptions, RunOptions, run};
use crate::settings::{Setting, scene_with};
use crate::signals;

/// Scene that `ripstop run` runs when none is named: in the current folder, else in a folder above the program.
const DEFAULT_SCENE: &str = "cases/atps-descent/scene.toml";

/// The path of the default scene: in the current folder, else in a folder above the program. Where neither has it,
/// the first path, which the error message then names.
fn default_scene() -> PathBuf {
    let here = PathBuf::from(DEFAULT_SCENE);
    let program = std::env::current_exe().and_then(|path| path.canonicalize()).unwrap_or_default();
    let above = program.ancestors().map(|folder| folder.join(DEFAULT_SCENE)).find(|path| path.is_file());
    if here.is_file() { here } else { above.unwrap_or(here) }
}

/// Fluid-structure interaction of parachutes: three solver programs, one command.
#[derive(Parser)]
#[command(name = "ripstop", version, after_help = CODES, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Write a commented scene of a canopy type, or a package of a solver program, to start from
    New(crate::new_command::NewArgs),
    /// Run a scene: start the programs of each stage, couple them, write results
    #[command(after_help = CODES)]
    Run(RunCommand),
    /// Run a scene with programs that you start yourself, in any order, also under a debugger
    #[command(after_help = CODES)]
    Attach(AttachArgs),
    /// Run one program against the recorded messages of a run and compare its replies
    #[command(after_help = CODES)]
    Replay(crate::replay::ReplayArgs),
    /// Compare two recordings, or the results of two runs: the first deviation and its growth
    #[command(after_help = CODES)]
    Diff(crate::diff_command::DiffArgs),
    /// Test whether one program conforms to the contract
    #[command(after_help = CODES)]
    Conform(crate::conform::ConformArgs),
    /// Check a scene without starting any program: what would run, errors and warnings
    #[command(after_help = CODES)]
    Check {
        #[command(flatten)]
        scene: SceneArgs,
        /// Print the findings as JSON
        #[arg(long)]
        json: bool,
    },
    /// List the effects that can be simulated; with a scene, estimate how much each changes its results,
    /// the largest change first
    Effects {
        #[command(flatten)]
        scene: SceneArgs,
        /// Measure the change and the cost of each effect by runs with and without it, next to the estimate
        #[arg(long, requires = "scene")]
        measure: bool,
        /// Windows of each measured run [default: the whole stage, at most 20]
        #[arg(long, value_name = "N", requires = "measure", value_parser = clap::value_parser!(u64).range(1..))]
        windows: Option<u64>,
        /// Measure these effects only, such as `--only lines.drag,flow.viscosity`
        #[arg(long, value_name = "KEY,...", value_delimiter = ',', requires = "measure")]
        only: Vec<String>,
        /// Runs of each variant; the shortest wall time counts
        #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..))]
        repeat: u64,
        /// Results of a run of the scene; the measured stage starts from its saved states [default: run
        /// the earlier stages first, with the effect where it acts in them]
        #[arg(long, value_name = "DIR", requires = "measure")]
        states: Option<PathBuf>,
    },
    /// Print the initial data of a stage as JSON, for solvers in any language: the scene with
    /// its defaults, meshes, paths of saved states
    Mesh(crate::mesh_command::MeshArgs),
    /// Print the JSON schema of scenes, for completion and validation in editors
    Schema,
    /// Draw the canopy and the flow around it from the results of a run (PNG)
    Picture(figures::picture::PictureArgs),
    /// Export results of a run to files for other programs: VTKHDF with all times, animations
    #[command(after_help = CODES)]
    Export(export::ExportArgs),
    /// Follow a run from its files: state, progress, ETA, plots in the terminal
    #[command(after_help = crate::watch_command::HELP)]
    Watch(crate::watch_command::WatchArgs),
    /// Write an HTML report of a run: the canopy in three dimensions, results, wall times; of two or more runs: their
    /// comparison
    Report(report::ReportArgs),
    /// Print settled means with 95 % intervals, swing, and wake of a complete, running or interrupted run
    #[command(after_help = CODES)]
    Statistics(crate::statistics_command::StatisticsArgs),
    /// Study accuracy against cost: vary parameters of a scene, extrapolate, recommend the cheapest settings
    #[command(after_help = CODES)]
    Accuracy(studies::accuracy::AccuracyArgs),
    /// Run a scene with varied values, and collect one table and one page of the results
    #[command(after_help = CODES)]
    Sweep(studies::sweep::SweepArgs),
    /// Run the cases of a folder and compare each with its recorded reference; record and update references
    #[command(after_help = CODES)]
    Regression(studies::regression::RegressionArgs),
    /// Map the stability of coupling schemes with a family of small cases
    #[command(after_help = CODES)]
    Stability(studies::stability::StabilityArgs),
    /// Print the completion script of a shell, such as `ripstop completions bash`
    Completions {
        /// The shell
        shell: clap_complete::Shell,
    },
    /// Write manual pages of `ripstop` and its commands (troff)
    Man {
        /// Folder of the pages; created if it does not exist
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Replaces the mesh-mover by its recorded replies, for `replay`
    #[command(hide = true)]
    StandIn {
        /// Recording of a stage
        #[arg(long)]
        recording: PathBuf,
        #[command(flatten)]
        program: channel::ProgramArgs,
    },
}

#[derive(Args)]
struct RunCommand {
    #[command(flatten)]
    run: RunArgs,
    /// Run only the stage that --stage names
    #[arg(long, requires = "stage")]
    only: bool,
}

#[derive(Args)]
struct AttachArgs {
    #[command(flatten)]
    run: RunArgs,
    /// Programs that you start, such as `--only flow,mesh`; ripstop starts the others [default: all]
    #[arg(long, value_name = "ROLE,...", value_delimiter = ',', value_parser = role)]
    only: Vec<Role>,
}

#[derive(Args)]
struct SceneArgs {
    /// Scene file (TOML) [default: cases/atps-descent/scene.toml]
    scene: Option<PathBuf>,
    /// Folder of the results [default: the scene's output.folder, or runs/NAME with the name of the scene]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Override a value of the scene (repeatable): `--set fabric.poisson_ratio=0.4`,
    /// `--set stage.descent.duration_s=2`
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<Setting>,
    /// MPI ranks by role, such as `--ranks flow=4,mesh=2` [default: the scene's `ranks`]
    #[arg(long, value_name = "ROLE=N,...", value_delimiter = ',', value_parser = ranks)]
    ranks: Vec<(Role, u32)>,
    /// Program to run instead of structure-solver; the arguments of the run are appended
    #[arg(long, value_name = "COMMAND")]
    structure: Option<String>,
    /// Program to run instead of flow-solver
    #[arg(long, value_name = "COMMAND")]
    flow: Option<String>,
    /// Program to run instead of mesh-mover
    #[arg(long, value_name = "COMMAND")]
    mesh: Option<String>,
    /// Options of `mpirun`, for all programs or with ROLE= for one, such as
    /// `--mpirun flow="--host a:8,b:8 --map-by node"`: see docs/how-to/run-on-a-cluster.md
    #[arg(long, value_name = "[ROLE=]OPTIONS", allow_hyphen_values = true, value_parser = mpirun)]
    mpirun: Vec<(Option<Role>, String)>,
    /// Start at this stage, from the saved states of an earlier run in --out
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
}

#[derive(Args)]
struct RunArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Stop each stage after N windows and save its state; the next stage starts from it
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    stop_after_windows: Option<u64>,
    /// Accept windows that do not converge, provided that all values are finite
    #[arg(long)]
    accept_unconverged: bool,
    /// Time limit for one reply of a program started by ripstop, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0, value_parser = seconds)]
    deadline: f64,
    /// Resume the run in --out from its last checkpoint
    #[arg(long, conflicts_with = "stage")]
    resume: bool,
    /// Save a checkpoint every N windows; 0: only at the end of stages and at Ctrl-C [default: the scene's
    /// output.checkpoint_every_windows, or an interval that costs at most 1 % of the wall time]
    #[arg(long, value_name = "N")]
    checkpoint_every: Option<u32>,
    /// Print the wall times of all programs by stage and part (always written to summary.json and the report)
    #[arg(long)]
    profile: bool,
    /// Print errors only
    #[arg(long, short)]
    quiet: bool,
    /// Print the output of all programs, each line with its role (always written to their logs)
    #[arg(long, short, conflicts_with = "quiet")]
    verbose: bool,
    /// What the programs write to their logs: what they compute (info), or each solve too (debug) [default: RIPSTOP_LOG, or info]
    #[arg(long, value_name = "LEVEL")]
    log_level: Option<LogLevel>,
    /// Record all messages of the programs in DIR, for `replay`, `diff`, `conform` and `--baseline`
    #[arg(long, value_name = "DIR")]
    record: Option<PathBuf>,
    /// Omit the moving grid from the recording: much smaller, but the flow cannot be replayed
    #[arg(long, requires = "record")]
    record_without_grid: bool,
    /// Compare with a recording during the run; reports the first deviation
    #[arg(long, value_name = "DIR")]
    baseline: Option<PathBuf>,
    /// Relative tolerance of the comparison with the baseline; the scale is the largest value of the field
    #[arg(long, value_name = "RATIO", default_value_t = 1e-9, value_parser = ratio)]
    tolerance: f64,
    /// Relative tolerance of iteration counts (Newton, Krylov, ...), rounded up [default: differences of counts are
    /// reported, not judged]
    #[arg(long, value_name = "RATIO", requires = "baseline", value_parser = ratio)]
    iteration_tolerance: Option<f64>,
    /// End the run at the first deviation from the baseline
    #[arg(long, requires = "baseline")]
    stop_at_deviation: bool,
}

impl RunArgs {
    fn options(self) -> RunOptions {
        let (without_grid, stop) = (self.record_without_grid, self.stop_at_deviation);
        let (tolerance, iteration_tolerance) = (self.tolerance, self.iteration_tolerance);
        RunOptions {
            stop_after_windows: self.stop_after_windows,
            accept_unconverged: self.accept_unconverged,
            resume: self.resume,
            checkpoint_every: self.checkpoint_every,
            deadline: Some(Duration::from_secs_f64(self.deadline)),
            log_level: self.log_level,
            record: self.record.map(|folder| RecordOptions { folder, without_grid }),
            baseline: self.baseline.map(|folder| BaselineOptions {
                folder,
                tolerance,
                iteration_tolerance,
                stop,
            }),
            ..self.scene.options()
        }
    }
}

impl SceneArgs {
    fn options(self) -> RunOptions {
        let programs = [(Role::Structure, self.structure), (Role::Flow, self.flow), (Role::Mesh, self.mesh)];
        RunOptions {
            scene: self.scene.unwrap_or_else(default_scene),
            out: self.out,
            settings: self.set,
            ranks: self.ranks,
            programs: programs.into_iter().filter_map(|(role, p)| Some((role, p?))).collect(),
            mpirun: self.mpirun,
            stage: self.stage,
            ..RunOptions::default()
        }
    }
}

/// The definition of the command line, for completions, manual pages and the reference.
pub fn command() -> clap::Command {
    <Cli as clap::CommandFactory>::command()
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let (arguments, former) = former_options::current(std::env::args_os());
    let cli = match Cli::try_parse_from(arguments) {
        Ok(cli) => cli,
        // clap's own exit would be the same code: 2, or 0 for help.
        Err(error) => error.exit(),
    };
    let (quiet, verbose) = match &cli.command {
        Command::Run(args) => (args.run.quiet, args.run.verbose),
        Command::Attach(args) => (args.run.quiet, args.run.verbose),
        _ => (false, false),
    };
    let console = Console::new(quiet).verbose(verbose);
    former.iter().for_each(|warning| console.warning(warning));
    match execute(cli.command, &console) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            console.error(&error.to_string());
            ExitCode::from(error.exit_code())
        }
    }
}

fn execute(command: Command, console: &Console) -> Result<(), RunError> {
    match command {
        Command::New(args) => printed(crate::new_command::new(&args)),
        Command::Run(RunCommand { run, only }) => run_scene(run, |o| RunOptions { only, ..o }, console),
        Command::Attach(AttachArgs { run, only }) => {
            let attach = if only.is_empty() { Role::ALL.to_vec() } else { only };
            run_scene(run, |o| RunOptions { attach, ..o }, console)
        }
        Command::Replay(args) => compared(crate::replay::replay(&args, &*signals::stop_flag()?, console)?),
        Command::Conform(args) => compared(crate::conform::conform(&args, &*signals::stop_flag()?, console)?),
        Command::Stability(args) => {
            let stop = signals::stop_flag()?;
            print(&studies::stability::stability(&args, &stop, console)?);
            Ok(())
        }
        Command::Accuracy(args) => {
            compared(studies::accuracy::accuracy(&args, &*signals::stop_flag()?, console)?)
        }
        Command::Sweep(args) => sweep(&args, console),
        Command::Export(args) => export::export(&args, console),
        Command::Regression(args) => regression(&args, console),
        Command::Diff(args) => compared(crate::diff_command::diff(&args)?),
        Command::StandIn { recording, program } => stand_in(&recording, &program),
        Command::Check { scene, json } => {
            let what = if json { crate::check::json } else { crate::check::report };
            let (text, inspection) = what(&scene.options())?;
            print(&text);
            inspection.verdict()
        }
        Command::Effects { scene, measure, windows, only, repeat, states } => {
            if scene.scene.is_none() {
                print(&effects::report::table());
                return Ok(());
            }
            let options = scene.options();
            print(&crate::effects_command::scene_report(&options)?);
            if measure {
                let stop = signals::stop_flag()?;
                let runs = Runs { windows, repeat, only };
                print(
                    &crate::effects_command::measure(&options, &runs, states.as_deref(), &stop, console)?
                        .text(),
                );
            }
            Ok(())
        }
        Command::Mesh(args) => printed(crate::mesh_command::json(&args)),
        Command::Schema => printed(Ok(serde_json::to_string_pretty(&case::schema()).unwrap_or_default())),
        Command::Completions { shell } => printed(Ok(crate::shell_help::completions(shell))),
        Command::Man { folder } => crate::shell_help::write_manual_pages(&folder),
        Command::Picture(args) => figures::picture::picture(&args, console),
        Command::Watch(args) => crate::watch_command::watch(&args, &*signals::stop_flag()?),
        Command::Report(args) if args.watch => report::follow(&args, &*signals::stop_flag()?, console),
        Command::Report(args) => report::report(&args, console),
        Command::Statistics(args) => printed(crate::statistics_command::statistics(&args)),
    }
}

/// Runs a sweep. Its table is printed also where no run is complete.
fn sweep(args: &studies::sweep::SweepArgs, console: &Console) -> Result<(), RunError> {
    let stop = signals::stop_flag()?;
    let load = |set: &[String]| scene_with(&args.scene, set);
    let (text, failed) = studies::sweep::sweep(args, &load, &stop, console)?;
    print(&text);
    failed.map_or(Ok(()), Err)
}

/// Prints the text of a command.
fn printed(text: Result<String, RunError>) -> Result<(), RunError> {
    text.map(|text| print(&text))
}

fn run_scene(
    args: RunArgs,
    change: impl FnOnce(RunOptions) -> RunOptions,
    console: &Console,
) -> Result<(), RunError> {
    let profile = args.profile;
    let (stop, now) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    signals::listen([&stop, &now])?;
    let options = &RunOptions { now: Some(now), ..change(args.options()) };
    let (summary, out) = run(options, &stop, console).map_err(|error| resumable(error, options))?;
    console.line("");
    console.result(&summary.table(&out));
    if profile {
        for stage in &summary.timings {
            console.result("");
            console.result(&stage.table());
        }
    }
    if summary.stages.iter().any(|stage| stage.deviates) { Err(RunError::Differs) } else { Ok(()) }
}

/// Runs a regression suite. A failed run weighs more than a deviation.
fn regression(args: &studies::regression::RegressionArgs, console: &Console) -> Result<(), RunError> {
    let suite = studies::regression::regression(args, &scene_with, &*signals::stop_flag()?, console)?;
    print(&suite.text);
    match (suite.failed, suite.same) {
        (Some(error), _) => Err(error),
        (None, true) => Ok(()),
        (None, false) => Err(RunError::Differs),
    }
}

/// Adds the command that resumes the run to its error.
fn resumable(error: RunError, options: &RunOptions) -> RunError {
    // A resumed run would fail again at the same window.
    if matches!(error, RunError::Input(_) | RunError::GridMotionFailed { .. }) {
        return error;
    }
    let hint = crate::run::prepare(options)
        .ok()
        .and_then(|p| checkpoint::hint(&p.scene, &crate::command_line::resume(options, &p.out), &p.out));
    match hint {
        Some(hint) => RunError::Resumable { error: Box::new(error), hint },
        None => error,
    }
}

/// Prints the report of a comparison; an error where it found a difference.
fn compared((same, report): (bool, String)) -> Result<(), RunError> {
    print(&report);
    if same { Ok(()) } else { Err(RunError::Differs) }
}

fn stand_in(recording: &std::path::Path, program: &channel::ProgramArgs) -> Result<(), RunError> {
    let at = program.serve_options(Role::Mesh, 0);
    let served = StandIn::new(recording).map_err(|fault| {
        channel::report(&at, &fault);
        fault.message
    });
    let served = served.and_then(|mut s| channel::serve(&mut s, &at).map_err(|e| e.to_string()));
    served.map(|_| ()).map_err(RunError::Input)
}

/// Prints to standard output. A pipe that the reader has closed is not an error.
fn print(text: &str) {
    use std::io::Write;
    drop(writeln!(std::io::stdout(), "{text}"));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn command_line_definition_is_valid() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn mpirun_options_and_ranks_are_parsed() {
        let words = ["ripstop", "run", "s.toml", "--mpirun", "--map-by node", "--mpirun", "mesh=-host a"];
        let Ok(Cli { command: Command::Run(args) }) =
            Cli::try_parse_from(words.into_iter().chain(["--ranks", "flow=4,mesh=2"]))
        else {
            panic!("refused")
        };
        let options = args.run.scene.options();
        assert_eq!(options.mpirun.len(), 2);
        assert_eq!(options.ranks, [(Role::Flow, 4), (Role::Mesh, 2)]);
    }

    #[test]
    fn only_requires_a_stage() {
        let read = |words: &[&str]| Cli::try_parse_from([&["ripstop", "run", "s.toml"], words].concat());
        let Ok(Cli { command: Command::Run(args) }) = read(&["--stage", "flow", "--only"]) else {
            panic!("refused")
        };
        assert!(args.only && args.run.scene.stage.as_deref() == Some("flow"));
        assert!(read(&["--only"]).is_err());
    }

    #[test]
    fn default_scene_is_found_from_any_folder() {
        // Tests run in the folder of the crate, which has no cases.
        assert!(!std::path::Path::new(DEFAULT_SCENE).exists());
        let found = default_scene();
        assert!(found.is_file() && found.ends_with(DEFAULT_SCENE), "{}", found.display());
    }
}
