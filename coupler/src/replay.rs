//! `ripstop replay`: runs one program against recorded messages.

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

use case::{Role, Scene};
use channel::{LOAD_WIDTH, Window};
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use coupling::partners::{LoadOverWindow, Partners};
use results::program::program_folder;
use results::recording::compare::Comparison;
use results::recording::{Channel, Event, Moment, Reader, stage_file};
use terminal::Console;

use crate::hub::{HubPartners, SessionOptions};
use crate::launch::{LaunchPlan, Session};
use crate::run::{Prepared, RunOptions, copy_scene, prepare, required_effects};

/// The recording and the program to replay.
#[derive(clap::Args)]
pub struct ReplayArgs {
    /// Folder that `ripstop run --record` wrote
    recording: PathBuf,
    /// Run the structure solver: the project's program, or COMMAND
    #[arg(long, value_name = "COMMAND", num_args = 0..=1, default_missing_value = "",
          conflicts_with_all = ["flow", "mesh"], required_unless_present_any = ["flow", "mesh"])]
    structure: Option<String>,
    /// Run the flow solver: the project's program, or COMMAND
    #[arg(long, value_name = "COMMAND", num_args = 0..=1, default_missing_value = "", conflicts_with = "mesh")]
    flow: Option<String>,
    /// Run the mesh-mover: the project's program, or COMMAND
    #[arg(long, value_name = "COMMAND", num_args = 0..=1, default_missing_value = "")]
    mesh: Option<String>,
    /// Ranks of the program [default: as recorded]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    ranks: Option<u32>,
    /// Stage to replay [default: the last one in which the program participated]
    #[arg(long, value_name = "NAME")]
    stage: Option<String>,
    /// Relative tolerance of the comparison; the scale is the largest value of the field
    #[arg(long, value_name = "RATIO", default_value_t = 1e-9, value_parser = crate::arguments::ratio)]
    tolerance: f64,
    /// Relative tolerance of iteration counts (Newton, Krylov, ...), rounded up [default: differences of counts are
    /// reported, not judged]
    #[arg(long, value_name = "RATIO", value_parser = crate::arguments::ratio)]
    iteration_tolerance: Option<f64>,
    /// Folder for the program's logs and the differences [default: a temporary one]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Time limit for one reply of the program, in seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0, value_parser = crate::arguments::seconds)]
    deadline: f64,
}

/// The program under test and how it is started.
pub(crate) struct ProgramOptions<'a> {
    /// Its role.
    pub role: Role,
    /// Its command; empty: the project's program.
    pub command: &'a str,
    /// Its ranks; `None`: as recorded.
    pub ranks: Option<u32>,
    /// Stage; `None`: the last recorded one with its role.
    pub stage: Option<&'a str>,
    /// Folder for logs and results; `None`: a temporary one.
    pub out: Option<&'a Path>,
    /// Time limit for one reply.
    pub deadline: Duration,
}

/// One program, to be started with recorded messages instead of the other programs.
pub(crate) struct ProgramSession {
    pub role: Role,
    /// Name of the stage.
    pub stage: String,
    /// Recording of the stage.
    pub file: PathBuf,
    /// Folder of logs and results.
    pub out: PathBuf,
    pub prepared: Prepared,
    /// The program; before it the recorded mesh-mover, where the program reads a moving grid.
    roles: Vec<Role>,
    number: usize,
    watch_grid: bool,
    deadline: Duration,
    /// Remedy for a program that cannot read the state of another program, which the stage starts from.
    hint: Option<String>,
    sessions: Cell<usize>,
    _lock: std::fs::File,
    _temporary: Option<Temporary>,
}

impl ProgramSession {
    /// Opens the recording in `folder`.
    ///
    /// # Errors
    /// [`RunError::Input`]: a recording without the stage, or without the moving grid that the flow reads.
    pub fn new(folder: &Path, options: &ProgramOptions<'_>) -> Result<Self, RunError> {
        let role = options.role;
        let mut prepared = scene_of(folder)?;
        let number = find_stage(&prepared.scene, folder, role, options.stage)?;
        prepared.scene = prepared.scene.for_stage(number);
        let stage = prepared.scene.stages[number].name.clone();
        let file = stage_file(folder, &stage);
        let reader = Reader::open(&file)?;
        let with_grid = reader.header().grid_nodes > 0;
        let moving = prepared.scene.roles(&prepared.scene.stages[number]).contains(&Role::Mesh);
        if role == Role::Flow && moving && !with_grid {
            return Err(RunError::Input(format!(
                "{} was recorded with --record-without-grid, but the flow reads the moving grid: record the run without that option",
                file.display()
            )));
        }
        let scene = &mut prepared.scene;
        if !options.command.is_empty() {
            scene.programs.insert(role, options.command.to_owned());
        }
        *scene.ranks.of_mut(role) = options.ranks.unwrap_or(reader.header().ranks[role as usize]).max(1);
        let mut roles = vec![role];
        if role == Role::Flow && moving {
            replace_mesh_mover(scene, &file)?;
            roles.insert(0, Role::Mesh);
        }
        let (out, temporary) = match options.out {
            Some(out) => (std::path::absolute(out).map_err(RunError::file("resolve", out))?, None),
            None => {
                let temporary = Temporary::create()?;
                (temporary.0.clone(), Some(temporary))
            }
        };
        std::fs::create_dir_all(&out).map_err(RunError::file("create", &out))?;
        let lock = results::lock::lock(&out)?;
        copy_scene(&prepared.file, &out)?;
        results::state::copy_states(&prepared.scene, number, folder, &out)?;
        Ok(Self {
            hint: hint(&prepared.scene, folder, options, number, &out),
            role,
            stage,
            file,
            out,
            prepared,
            roles,
            number,
            watch_grid: role == Role::Mesh && with_grid,
            deadline: options.deadline,
            sessions: Cell::new(0),
            _lock: lock,
            _temporary: temporary,
        })
    }

    /// Number of the stage.
    pub fn number(&self) -> usize {
        self.number
    }

    /// Starts the program in a new session, sends the requests of `play`, and ends it.
    ///
    /// # Errors
    /// A failure of the program or of `play`.
    pub fn run<T>(
        &self,
        stop: &AtomicBool,
        console: &Console,
        play: impl FnOnce(&mut HubPartners<'_>) -> Result<T, RunError>,
    ) -> Result<T, RunError> {
        self.run_from(None, stop, console, play)
    }

    /// As [`ProgramSession::run`], from a checkpoint within the stage.
    ///
    /// # Errors
    /// As above.
    pub fn run_from<T>(
        &self,
        resume: Option<&Path>,
        stop: &AtomicBool,
        console: &Console,
        play: impl FnOnce(&mut HubPartners<'_>) -> Result<T, RunError>,
    ) -> Result<T, RunError> {
        let scene = &self.prepared.scene;
        let count = self.sessions.replace(self.sessions.get() + 1);
        let session = Session::create(scene, count)?;
        let plan = LaunchPlan {
            scene,
            scene_file: &self.out.join("scene.toml"),
            stage: self.number,
            session: &session.name,
            out: &self.out,
            programs: &program_folder()?,
            scratch: session.scratch(),
            mpirun: &[],
            resume,
        };
        let programs = self.roles.iter().map(|&r| Ok((plan.program(r)?, scene.ranks.of(r))));
        let options = SessionOptions {
            session: &session.name,
            stage: (&self.stage, self.number),
            programs: programs.collect::<Result<_, RunError>>()?,
            effects: required_effects(scene).into_iter().filter(|(r, _)| *r == self.role).collect(),
            deadline: Some(self.deadline),
            attached: Vec::new(),
            watch_grid: self.watch_grid,
            folder: case::stage_folder(&self.out, scene, self.number),
        };
        let ended = (|| {
            let started = HubPartners::start(options, &self.prepared.interface, stop, console);
            let mut partners = started.map_err(|error| match (error, &self.hint) {
                (RunError::Fault { role, program, rank, place, message }, Some(hint))
                    if role == self.role =>
                {
                    RunError::Fault { role, program, rank, place, message: message + hint }
                }
                (error, _) => error,
            })?;
            let result = play(&mut partners)?;
            partners.finish(console)?;
            Ok(result)
        })();
        session.clean_up(console);
        ended
    }
}

/// The scene of the recording in `folder`.
fn scene_of(folder: &Path) -> Result<Prepared, RunError> {
    let scene = folder.join("scene.toml");
    if !scene.is_file() {
        return Err(RunError::Input(format!(
            "{} is not a recording: it contains no scene.toml. Create a recording with `ripstop run SCENE --record DIR`",
            folder.display()
        )));
    }
    prepare(&RunOptions { scene, ..RunOptions::default() })
}

/// Replaces the mesh-mover of `scene` by the recording `file`.
fn replace_mesh_mover(scene: &mut Scene, file: &Path) -> Result<(), RunError> {
    let me = results::program::this_program()?;
    let recorded = std::path::absolute(file).map_err(RunError::file("resolve", file))?;
    let command = format!("'{}' stand-in --recording '{}'", me.display(), recorded.display());
    scene.programs.insert(Role::Mesh, command);
    *scene.ranks.of_mut(Role::Mesh) = 1;
    Ok(())
}

/// The remedy where a program cannot read the state of another program that stage `number` starts from.
fn hint(
    scene: &Scene,
    folder: &Path,
    options: &ProgramOptions<'_>,
    number: usize,
    out: &Path,
) -> Option<String> {
    let role = options.role;
    let starts = scene.source_state(out, number, role).is_some() && !options.command.is_empty();
    let first = find_first(scene, folder, role).filter(|&first| starts && first < number)?;
    Some(format!(
        "; stage `{}` starts from a state saved by the recorded program: if this program cannot read it, use \
         `--stage {}`, or record a run with this program (`ripstop run SCENE --{} COMMAND --record DIR`)",
        scene.stages[number].name,
        scene.stages[first].name,
        role.name()
    ))
}

/// Replays a recorded stage: whether the replies of the program agree with the recorded ones, and the
/// report.
///
/// # Errors
/// A recording that cannot be used, or a failure of the program.
pub fn replay(args: &ReplayArgs, stop: &AtomicBool, console: &Console) -> Result<(bool, String), RunError> {
    let (role, command) = match (&args.structure, &args.flow, &args.mesh) {
        (Some(c), _, _) => (Role::Structure, c),
        (_, Some(c), _) => (Role::Flow, c),
        (_, _, Some(c)) => (Role::Mesh, c),
        _ => return Err(RunError::Input("name the program: --structure, --flow or --mesh".into())),
    };
    let options = ProgramOptions {
        role,
        command,
        ranks: args.ranks,
        stage: args.stage.as_deref(),
        out: args.out.as_deref(),
        deadline: Duration::from_secs_f64(args.deadline),
    };
    let session = ProgramSession::new(&args.recording, &options)?;
    let mut comparison = Comparison::new(args.tolerance).judging_counts(args.iteration_tolerance);
    let reader = Reader::open(&session.file)?;
    let canopy = &session.prepared.interface;
    let program = session.run(stop, console, |partners| {
        let program = partners.announced(role);
        send_requests(partners, role, reader, canopy, &mut comparison).map(|()| program)
    })?;
    if args.out.is_some() {
        figures::plot::differences(&session.out, &session.stage, &comparison)?;
    }
    let command = if command.is_empty() { String::new() } else { format!(" ({command})") };
    let program = program.unwrap_or_else(|| role.program().into());
    let report = format!("stage `{}`, {program}{command}: {}", session.stage, comparison.report());
    Ok((comparison.same(), report))
}

/// Sends the recorded requests in their order and compares the replies.
fn send_requests(
    partners: &mut HubPartners<'_>,
    role: Role,
    mut reader: Reader,
    canopy: &CanopyInterface,
    comparison: &mut Comparison,
) -> Result<(), RunError> {
    let mut displacement = vec![0.0; 3 * canopy.nodes()];
    let mut load_reply = vec![0.0; LOAD_WIDTH * canopy.faces.len()];
    let mut open = false;
    while let Some(event) = reader.next_event()? {
        let w = Window::from(event.at());
        let at = Moment::from(&w);
        match (&event, role) {
            (Event::Structure { load, displacement: recorded, stats, .. }, Role::Structure) => {
                let [start, end] = halves(load);
                let load = LoadOverWindow { start: &start, end: &end };
                let response = partners.structure(&w, load, &mut displacement)?;
                comparison.add_array(&at, Channel::StructureDisplacement, recorded, &displacement);
                comparison.add_counts(&at, role, stats, &response.stats.values);
                open = true;
            }
            (Event::Mesh { displacement, grid, stats, .. }, Role::Mesh) => {
                let response = partners.mesh(&w, displacement)?;
                comparison.add_counts(&at, role, stats, &response.stats.values);
                if let (Some(recorded), Some(grid)) = (grid, partners.grid()) {
                    comparison.add_array(&at, Channel::Grid, recorded, grid);
                }
                open = true;
            }
            (Event::Mesh { displacement, .. }, Role::Flow) => {
                partners.mesh(&w, displacement)?;
            }
            (Event::Flow { load, stats, .. }, Role::Flow) => {
                let response = partners.flow(&w, &mut load_reply)?;
                comparison.add_counts(&at, role, stats, &response.stats.values);
                comparison.add_array(&at, Channel::FlowLoad, load, &load_reply);
                open = true;
            }
            (Event::Accept { .. }, _) if open => {
                partners.accept(&w)?;
                open = false;
            }
            _ => {}
        }
    }
    Ok(())
}

/// Splits the load rows of a message into the loads at the start and at the end of the window.
pub(crate) fn halves(rows: &[f64]) -> [Vec<f64>; 2] {
    let half = |k: usize| rows.chunks_exact(LOAD_WIDTH).skip(k).step_by(2).flatten().copied().collect();
    [half(0), half(1)]
}

/// The first recorded stage with `role`.
fn find_first(scene: &Scene, recording: &Path, role: Role) -> Option<usize> {
    let recorded =
        |s: &case::Stage| s.kind.roles().contains(&role) && stage_file(recording, &s.name).is_file();
    scene.stages.iter().position(recorded)
}

/// The stage to replay: as named, or the last recorded one with `role`.
fn find_stage(scene: &Scene, recording: &Path, role: Role, name: Option<&str>) -> Result<usize, RunError> {
    let recorded =
        |s: &case::Stage| s.kind.roles().contains(&role) && stage_file(recording, &s.name).is_file();
    let found = match name {
        Some(name) => scene.stages.iter().position(|s| s.name == name && recorded(s)),
        None => scene.stages.iter().rposition(recorded),
    };
    found.ok_or_else(|| {
        RunError::Input(format!(
            "{} contains no {} that runs the {}: record one with `ripstop run --record`",
            recording.display(),
            name.map_or_else(|| "stage".to_owned(), |n| format!("stage `{n}`")),
            role.name()
        ))
    })
}

/// A folder that is removed on drop.
struct Temporary(PathBuf);

impl Temporary {
    fn create() -> Result<Self, RunError> {
        let folder = std::env::temp_dir().join(format!("ripstop-replay-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
        Ok(Self(folder))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
