//! The command line `ripstop`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use case::Role;
use clap::{Args, Parser, Subcommand};

use crate::error::RunError;
use crate::launch::Console;
use crate::run::{RunOptions, run};

/// Scene that `ripstop run` flies when none is named.
const DEFAULT_SCENE: &str = "cases/atps-descent/scene.toml";

const CODES: &str = "Exit codes:
  0    complete
  1    the run failed; what was computed so far is kept
  2    the scene or the command line is wrong; nothing was started
  130  ended by Ctrl-C or a termination signal";

/// Fluid-structure interaction of parachutes: three solver programs, one command.
#[derive(Parser)]
#[command(name = "ripstop", version, after_help = CODES, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Fly a scene: start the programs of each stage, couple them, write results
    #[command(after_help = CODES)]
    Run(RunArgs),
    /// Read a scene and print what would run and why, without starting anything
    Check {
        #[command(flatten)]
        scene: SceneArgs,
    },
    /// Print the JSON schema of scenes, for editors that complete and check TOML
    Schema,
    /// Draw the canopy and the flow around it from the results of a run (PNG)
    Picture(crate::picture::PictureArgs),
}

#[derive(Args)]
struct SceneArgs {
    /// Scene file (TOML) [default: cases/atps-descent/scene.toml]
    scene: Option<PathBuf>,
    /// Folder of the results [default: the scene's output.folder, or runs/<scene name>]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// MPI ranks by role, such as `--ranks flow=4,mesh=2`; others as in the scene
    #[arg(long, value_name = "ROLE=N,...", value_delimiter = ',', value_parser = ranks)]
    ranks: Vec<(Role, u32)>,
    /// Program in the place of structure-solver; the run's arguments are appended
    #[arg(long, value_name = "COMMAND")]
    structure: Option<String>,
    /// Program in the place of flow-solver
    #[arg(long, value_name = "COMMAND")]
    flow: Option<String>,
    /// Program in the place of mesh-mover
    #[arg(long, value_name = "COMMAND")]
    mesh: Option<String>,
    /// Start at this stage, from the states that an earlier run left in --out
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
}

#[derive(Args)]
struct RunArgs {
    #[command(flatten)]
    scene: SceneArgs,
    /// Stop each stage after N windows (its state is saved, so that the next stage can start)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    stop_after_windows: Option<u64>,
    /// Accept coupled windows that do not converge, as long as all numbers are finite
    #[arg(long)]
    keep_going: bool,
    /// Longest time for one answer of a program, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0, value_parser = seconds)]
    deadline: f64,
    /// Print errors only
    #[arg(long, short)]
    quiet: bool,
}

fn ranks(text: &str) -> Result<(Role, u32), String> {
    let help = "write ROLE=N, such as flow=4; roles: structure, flow, mesh";
    let (name, count) = text.split_once('=').ok_or(help)?;
    let role = Role::ALL
        .into_iter()
        .find(|r| r.name() == name.trim())
        .ok_or_else(|| format!("there is no role `{name}`; {help}"))?;
    match count.trim().parse() {
        Ok(n) if n >= 1 => Ok((role, n)),
        _ => Err(format!("`{count}` is no number of ranks (1 or more); {help}")),
    }
}

fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(s) if s > 0.0 && s < 1e9 => Ok(s),
        _ => Err("a number of seconds above 0".into()),
    }
}

impl SceneArgs {
    fn options(self) -> RunOptions {
        let programs = [(Role::Structure, self.structure), (Role::Flow, self.flow), (Role::Mesh, self.mesh)];
        RunOptions {
            scene: self.scene.unwrap_or_else(|| DEFAULT_SCENE.into()),
            out: self.out,
            ranks: self.ranks,
            programs: programs.into_iter().filter_map(|(role, p)| Some((role, p?))).collect(),
            stage: self.stage,
            ..RunOptions::default()
        }
    }
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        // clap's own exit would be the same code: 2, or 0 for help.
        Err(error) => error.exit(),
    };
    let quiet = matches!(&cli.command, Command::Run(args) if args.quiet);
    let console = Console::new(quiet);
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
        Command::Run(args) => {
            let options = RunOptions {
                stop_after_windows: args.stop_after_windows,
                keep_going: args.keep_going,
                deadline: Some(Duration::from_secs_f64(args.deadline)),
                ..args.scene.options()
            };
            let stop = on_signals()?;
            let (summary, out) = run(&options, &stop, console)?;
            console.line("");
            console.line(&summary.table(&out));
            Ok(())
        }
        Command::Check { scene } => {
            print(&crate::check::report(&scene.options())?);
            Ok(())
        }
        Command::Schema => {
            let text = serde_json::to_string_pretty(&case::schema()).unwrap_or_default();
            print(&text);
            Ok(())
        }
        Command::Picture(args) => crate::picture::picture(&args, console),
    }
}

/// To standard output; a reader that closes the pipe early is no error.
fn print(text: &str) {
    use std::io::Write;
    drop(writeln!(std::io::stdout(), "{text}"));
}

/// A flag that Ctrl-C and termination signals set. A second signal ends this
/// process at once; its programs then end by themselves.
fn on_signals() -> Result<Arc<AtomicBool>, RunError> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [libc::SIGINT, libc::SIGTERM, libc::SIGHUP] {
        let set = || {
            signal_hook::flag::register_conditional_shutdown(signal, 130, stop.clone())?;
            signal_hook::flag::register(signal, stop.clone())
        };
        set().map_err(RunError::file("handle signals in", "this process"))?;
    }
    Ok(stop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_command_line_is_well_formed() {
        use clap::CommandFactory;
        Cli::command().debug_assert();
    }

    #[test]
    fn ranks_are_read_or_refused_with_help() {
        assert_eq!(ranks("flow=4"), Ok((Role::Flow, 4)));
        for wrong in ["flow", "flow=0", "wing=2", "mesh=x"] {
            assert!(ranks(wrong).unwrap_err().contains("write ROLE=N"), "{wrong}");
        }
        let Ok(cli) = Cli::try_parse_from(["ripstop", "run", "s.toml", "--ranks", "flow=4,mesh=2"]) else {
            panic!("refused")
        };
        let Command::Run(args) = cli.command else { panic!("not run") };
        assert_eq!(args.scene.options().ranks, [(Role::Flow, 4), (Role::Mesh, 2)]);
    }
}
