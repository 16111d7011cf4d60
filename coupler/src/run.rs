//! A whole run: stage after stage, each a session of its own.

use std::fs;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use case::{Role, Scene, StageKind};
use checks::Inspection;
use checks::facts::Machine;
use coupling::error::{Place, RunError};
use coupling::interface::CanopyInterface;
use coupling::partners::Partners;
use coupling::schemes::InterfaceState;
use effects::effects;
use figures::plot;
use results::checkpoint::{self, Progress, Record};
use results::program::program_folder;
use results::recording::compare::Comparison;
use results::recording::{Baseline, Header, Reader, Recorder, Writer, stage_file};
use results::state;
use results::summary::{RunSummary, StageSummary};
use terminal::Console;

use crate::hub_partners::{HubPartners, SessionOptions};
use crate::launch::LaunchPlan;
use crate::settings::{Setting, changed};
use crate::stages::{StageContext, StageOptions, initial_state};

/// Copy of the scene in the folder of results.
const SCENE: &str = "scene.toml";

/// Everything that was printed, in the folder of results.
const LOG: &str = "ripstop.log";

/// What a user asks of a run, beside the scene.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Scene file.
    pub scene: PathBuf,
    /// Folder of the results; the scene's own, or `runs/<name>`, if absent.
    pub out: Option<PathBuf>,
    /// Values instead of the scene's.
    pub settings: Vec<Setting>,
    /// Ranks instead of the scene's.
    pub ranks: Vec<(Role, u32)>,
    /// Programs instead of the project's.
    pub programs: Vec<(Role, String)>,
    /// Options for `mpirun`, of one program or of all.
    pub mpirun: Vec<(Option<Role>, String)>,
    /// Name of the stage to start at; the stages before it were run earlier.
    pub stage: Option<String>,
    /// Runs no stage after it.
    pub only: bool,
    /// Stops each stage after so many windows.
    pub stop_after_windows: Option<u64>,
    /// Accepts windows that are not converged.
    pub accept_unconverged: bool,
    /// Longest time for one answer of a program.
    pub deadline: Option<Duration>,
    /// Programs that somebody else starts.
    pub attach: Vec<Role>,
    /// Goes on with the run whose results lie in the folder.
    pub resume: bool,
    /// Ends all at once when it becomes true; windows are finished first when only the run's flag to
    /// stop is. `None`: that flag already ends all.
    pub now: Option<Arc<AtomicBool>>,
    /// Windows between saves instead of the scene's; 0: none.
    pub checkpoint_every: Option<u32>,
    /// Keeps every exchange.
    pub record: Option<RecordOptions>,
    /// Compares every exchange with a recording.
    pub baseline: Option<BaselineOptions>,
}

/// How a run is recorded.
#[derive(Clone, Debug)]
pub struct RecordOptions {
    /// Folder of the recording.
    pub folder: PathBuf,
    /// Leaves out the moving grid.
    pub without_grid: bool,
}

/// How a run is compared while it goes on.
#[derive(Clone, Debug)]
pub struct BaselineOptions {
    /// Folder of the recording.
    pub folder: PathBuf,
    /// Largest relative difference that is none.
    pub tolerance: f64,
    /// Judges counts of iterations, as [`Comparison::count_slack`].
    pub count_slack: Option<f64>,
    /// Ends the run where it departs.
    pub stop: bool,
}

/// A scene made ready: loaded, overridden, checked, with its canopy.
pub struct Prepared {
    /// The scene as it will run.
    pub scene: Scene,
    /// Absolute path of its file, which is still to be written where there is a text.
    pub file: PathBuf,
    /// Text of the scene where the command line has changed its values.
    pub text: Option<String>,
    /// Absolute folder of the results.
    pub out: PathBuf,
    /// Its canopy.
    pub interface: CanopyInterface,
    /// First stage to run.
    pub first: usize,
}

/// Findings in the scene that `prepared` holds, before it runs.
///
/// # Errors
/// Parameters that make no canopy.
pub fn inspection(prepared: &Prepared, options: &RunOptions) -> Result<Inspection, RunError> {
    let Prepared { scene, interface, first, out, .. } = prepared;
    let machine = Machine::here(out, !options.mpirun.is_empty());
    let settings: Vec<String> = options.settings.iter().map(Setting::to_string).collect();
    Inspection::of(scene, interface, *first, machine, &options.scene, &settings)
}

/// Loads and checks everything that can be checked before a program starts.
///
/// # Errors
/// [`RunError::Input`] with a message for the user.
pub fn prepare(options: &RunOptions) -> Result<Prepared, RunError> {
    let (mut scene, text) = if options.settings.is_empty() {
        (case::load(&options.scene).map_err(|e| RunError::Input(e.to_string()))?, None)
    } else {
        let (scene, text) = changed(&options.scene, &options.settings)?;
        (scene, Some(text))
    };
    for (role, ranks) in &options.ranks {
        *scene.ranks.of_mut(*role) = *ranks;
    }
    scene.programs.extend(options.programs.iter().cloned());
    let interface = CanopyInterface::new(&scene)?;
    let first = match &options.stage {
        None => 0,
        Some(name) => scene.stages.iter().position(|s| &s.name == name).ok_or_else(|| {
            let names: Vec<&str> = scene.stages.iter().map(|s| s.name.as_str()).collect();
            RunError::Input(format!("the scene has no stage `{name}`; it has: {}", names.join(", ")))
        })?,
    };
    let elements = interface.sizes.triangles;
    if scene.ranks.structure as usize > elements {
        return Err(RunError::Input(format!(
            "{} ranks for the structure, but its mesh has only {elements} membrane elements: use fewer ranks",
            scene.ranks.structure
        )));
    }
    let out = options
        .out
        .clone()
        .or_else(|| scene.output.folder.clone())
        .unwrap_or_else(|| Path::new("runs").join(&scene.name));
    let absolute = |path: &Path| std::path::absolute(path).map_err(RunError::file("resolve", path));
    let out = absolute(&out)?;
    let file = if text.is_some() { out.join(SCENE) } else { absolute(&options.scene)? };
    Ok(Prepared { file, text, out, scene, interface, first })
}

/// Runs the stages of a scene; returns what came of it and the folder of the
/// results. `stop` ends it early when it becomes true.
///
/// # Errors
/// Whatever ended it early; results so far, `summary.json` included, are kept.
pub fn run(
    options: &RunOptions,
    stop: &AtomicBool,
    console: &Console,
) -> Result<(RunSummary, PathBuf), RunError> {
    let prepared = prepare(options)?;
    let inspection = inspection(&prepared, options)?;
    inspection.announce(console)?;
    let Prepared { scene, file, text, out, interface, first } = prepared;
    let mut going_on = if options.resume { GoingOn::of(&scene, &file, &out, console)? } else { None };
    if let Some(GoingOn { done, .. }) = &going_on
        && *done
    {
        return finished(&scene, out, console, going_on);
    }
    let first = going_on.as_ref().map_or(first, |g| g.stage);
    let end = if options.only { first + 1 } else { scene.stages.len() };
    for stage in first..end {
        // A program that is missing in the last stage should not cost the first ones.
        let programs = &program_folder()?;
        let (session, scratch) = ("", Path::new(""));
        let plan = LaunchPlan {
            scene: &scene,
            scene_file: &file,
            stage,
            session,
            out: &out,
            programs,
            scratch,
            mpirun: &options.mpirun,
            resume: None,
        };
        plan.programs()?;
    }
    channel::ignore_sigxfsz();
    crate::launch::memory::require(&scene, first, &interface)?;
    let start = Instant::now();
    fs::create_dir_all(&out).map_err(RunError::file("create", &out))?;
    let _lock = results::lock::lock(&out)?;
    let log = out.join(LOG);
    console.log_to(&log, options.resume || options.stage.is_some()).map_err(RunError::file("write", &log))?;
    console.note(&std::env::args().collect::<Vec<_>>().join(" "));
    inspection.above_notes().iter().for_each(|finding| console.note(&finding.line()));
    match &text {
        Some(text) => fs::write(&file, text).map_err(RunError::file("write", &file))?,
        None => keep_scene(&file, &out)?,
    }
    let identity = match &mut going_on {
        Some(g) => g.begin(&scene, &out)?,
        None => {
            let record = Record::new(&scene, &file, first);
            record.write(&out)?;
            record.run
        }
    };
    if let Some(record) = &options.record {
        fs::create_dir_all(&record.folder).map_err(RunError::file("create", &record.folder))?;
        keep_scene(&file, &record.folder)?;
        results::state::copy_states(&scene, first, &out, &record.folder)?;
    }
    if let Err(error) = channel::cleanup_stale() {
        console.warning(&format!("leftovers of earlier runs could not be removed: {error}"));
    }
    Scratch::sweep();
    let before = going_on.as_mut().map(|g| std::mem::take(&mut g.summaries)).unwrap_or_default();
    let mut summary = RunSummary { inspection: inspection.above_notes(), ..summary_of(&scene, before) };
    let mut state = match first.checked_sub(1) {
        None => initial_state(&scene, &interface),
        Some(before) => earlier_state(&scene, &out, &interface, before)?,
    };
    let mut result = Ok(());
    for stage in first..end {
        if stop.load(Ordering::Relaxed) {
            let place = Place { stage: scene.stages[stage].name.clone(), window: None };
            summary.ended = RunError::Interrupted(place.clone()).to_string();
            result = Err(RunError::Interrupted(place));
            break;
        }
        let resumed = going_on.as_ref().filter(|g| g.stage == stage).and_then(|g| g.within.as_ref());
        let context = StageContext {
            scene: &scene,
            stage,
            out: &out,
            interface: &interface,
            options: StageOptions {
                stop_after_windows: options.stop_after_windows,
                accept_unconverged: options.accept_unconverged,
                checkpoint_every: options
                    .checkpoint_every
                    .or(scene.output.checkpoint_every_windows)
                    .map(u64::from),
                run: identity,
            },
            console,
            stop,
            resumed,
        };
        let mut stage_summary = StageSummary::new(&scene.stages[stage]);
        let ended = run_stage(&context, &file, options, stop, &mut state, &mut stage_summary);
        let said = stage_summary.convergence.closing(&stage_summary.name, stage_summary.windows);
        said.iter().for_each(|text| console.warning(text));
        summary.stages.push(stage_summary);
        if let Err(error) = ended {
            summary.ended = error.to_string();
            result = Err(error);
            break;
        }
    }
    summary.wall_s = start.elapsed().as_secs_f64();
    summary.warnings = console.warnings();
    summary.write(&out)?;
    if let Err(error) = plots(&scene, &out, &interface) {
        console.warning(&error.to_string());
    }
    result.map(|()| (summary, out))
}

fn run_stage(
    context: &StageContext<'_>,
    file: &Path,
    options: &RunOptions,
    stop: &AtomicBool,
    state: &mut InterfaceState,
    summary: &mut StageSummary,
) -> Result<(), RunError> {
    let scene = context.scene;
    let stage = &scene.stages[context.stage];
    let folder = case::stage_folder(context.out, scene, context.stage);
    let within = context.resumed.map(|p| (p, case::state_folder(context.out, scene, context.stage)));
    match &within {
        // What was written after the state is computed anew.
        Some((p, _)) => checkpoint::trim(&folder, p.windows, p.time_s)?,
        None => clear(&folder)?,
    }
    let session = format!("{}-{}-{}", shorten(&scene.name), std::process::id(), context.stage);
    let scratch = Scratch::create(&session)?;
    let plan = LaunchPlan {
        scene,
        scene_file: file,
        stage: context.stage,
        session: &session,
        out: context.out,
        programs: &program_folder()?,
        scratch: &scratch.0,
        mpirun: &options.mpirun,
        resume: within.as_ref().map(|(_, state)| state.as_path()),
    };
    let mut programs = plan.programs()?;
    // Whoever sits at a debugger takes the time that it takes.
    if let Some(deadline) = options.deadline.filter(|_| options.attach.is_empty()) {
        let passed = (channel::DEADLINE, deadline.as_secs_f64().to_string().into());
        programs.iter_mut().for_each(|p| p.environment.push(passed.clone()));
    }
    let programs: Vec<_> =
        programs.into_iter().map(|p| (scene.ranks.of(p.role), p)).map(|(n, p)| (p, n)).collect();
    let names: Vec<String> = programs.iter().map(|(p, n)| format!("{} x {n}", p.name)).collect();
    context.console.line(&format!("stage `{}`: {}", stage.name, names.join(", ")));
    let recorded = options.record.as_ref().is_some_and(|r| !r.without_grid);
    let moving = stage.kind.roles().contains(&Role::Mesh);
    let mut effects = asked(scene);
    if within.is_some() {
        effects.extend(Role::ALL.map(|role| (role, channel::RESUME.to_owned())));
    }
    let session_options = SessionOptions {
        session: &session,
        stage: (&stage.name, context.stage),
        programs,
        effects,
        deadline: options.deadline,
        attached: options.attach.clone(),
        watch_grid: moving && (recorded || options.baseline.is_some()),
        folder: folder.clone(),
    };
    let ended = (|| {
        let mut partners = HubPartners::start(session_options, context.interface, stop, context.console)?;
        if let Some(now) = &options.now {
            partners.finish_windows(now.clone());
        }
        let (partners, interrupted) = exchange(context, options, partners, state, summary)?;
        let used = partners.finish(context.console)?;
        summary.used(&used);
        interrupted.map_or(Ok(()), Err)
    })();
    // Every process is gone by now, however the stage ended: a draft of a state that is still there is half a one.
    let state = case::state_folder(context.out, scene, context.stage);
    if state.exists()
        && let Err(error) = checkpoint::remove(&checkpoint::draft(&state))
    {
        context.console.warning(&error.to_string());
    }
    if let Err(error) = channel::cleanup(&session) {
        context.console.warning(&format!("shared memory of session {session}: {error}"));
    }
    ended
}

/// Runs a stage with `partners`, recorded and compared as asked.
/// Also says where it was interrupted between two windows.
fn exchange<'a>(
    context: &StageContext<'_>,
    options: &RunOptions,
    mut partners: HubPartners<'a>,
    state: &mut InterfaceState,
    summary: &mut StageSummary,
) -> Result<(HubPartners<'a>, Option<RunError>), RunError> {
    let name = &context.scene.stages[context.stage].name;
    let grid_nodes = partners.grid().map_or(0, |g| g.len() as u64 / 6);
    let baseline = options.baseline.as_ref().map(|b| (b, stage_file(&b.folder, name)));
    let mut comparison = Comparison::new(baseline.as_ref().map_or(0.0, |b| b.0.tolerance))
        .judging_counts(baseline.as_ref().and_then(|b| b.0.count_slack));
    let mut interrupted = None;
    let now = || options.now.as_ref().is_some_and(|now| now.load(Ordering::Relaxed));
    let mut run = |partners: &mut dyn Partners, state: &mut InterfaceState, summary: &mut StageSummary| {
        match context.run(partners, state.clone(), summary) {
            Ok(end) => *state = end,
            // All programs stand at the end of a window: the session ends in good order.
            Err(stop @ RunError::Interrupted(_)) if !now() => interrupted = Some(stop),
            Err(other) => return Err(other),
        }
        Ok::<_, RunError>(())
    };
    // A stage that the baseline does not have is not compared.
    if let Some((baseline, file)) = baseline.filter(|b| b.1.is_file()) {
        let mut reader = Reader::open(&file)?;
        if let Some(p) = context.resumed {
            reader.skip_windows(p.windows)?;
        }
        let mut compared = Baseline::new(partners, reader, &mut comparison, baseline.stop, context.console);
        let ended = match &options.record {
            None => run(&mut compared, state, summary).map(|()| compared.into_partners()),
            Some(record) => {
                let mut both =
                    Recorder::new(compared, writer(context, record, grid_nodes)?, !record.without_grid);
                run(&mut both, state, summary)?;
                let (both, cost) = both.into_partners()?;
                context.console.line(&format!("stage `{name}`: {cost}"));
                Ok(both.into_partners())
            }
        };
        context.console.line(&format!("stage `{name}` beside its baseline: {}", comparison.report()));
        crate::diff_command::write(context.out, name, &comparison)?;
        partners = ended?;
    } else if let Some(record) = &options.record {
        let mut recorder =
            Recorder::new(partners, writer(context, record, grid_nodes)?, !record.without_grid);
        run(&mut recorder, state, summary)?;
        let cost;
        (partners, cost) = recorder.into_partners()?;
        context.console.line(&format!("stage `{name}`: {cost}"));
    } else {
        run(&mut partners, state, summary)?;
    }
    if let Some(record) = &options.record {
        results::state::copy_states(context.scene, context.stage + 1, context.out, &record.folder)?;
    }
    Ok((partners, interrupted))
}

/// The file that keeps a stage's exchanges.
fn writer(context: &StageContext<'_>, record: &RecordOptions, grid_nodes: u64) -> Result<Writer, RunError> {
    let (scene, stage) = (context.scene, context.stage);
    let interface = context.interface;
    let name = scene.stages[stage].name.clone();
    let header = Header {
        contract: channel::CONTRACT_VERSION,
        version: env!("CARGO_PKG_VERSION").into(),
        scene: scene.name.clone(),
        stage: (name.clone(), stage as u64),
        canopy: (interface.nodes() as u64, interface.faces.len() as u64),
        surface_hash: channel::surface_hash(&interface.faces),
        grid_nodes: if record.without_grid { 0 } else { grid_nodes },
        ranks: Role::ALL.map(|role| scene.ranks.of(role)),
    };
    let file = stage_file(&record.folder, &name);
    match context.resumed {
        None => Ok(Writer::create(&file, &header)?),
        Some(_) if !file.is_file() => Err(RunError::Input(format!(
            "{} does not exist, and a recording cannot begin in the middle of a stage: name the folder that the \
             run was recorded in, or leave --record out",
            file.display()
        ))),
        Some(p) => Ok(Writer::resume(&file, p.windows)?),
    }
}

/// Where an earlier run is gone on with.
struct GoingOn {
    record: Record,
    point: Option<checkpoint::Point>,
    /// The stage, from 0.
    stage: usize,
    /// How far it had come; `None`: it is begun anew.
    within: Option<Progress>,
    /// Of the stages before it; where all is done, of all.
    summaries: Vec<StageSummary>,
    done: bool,
}

impl GoingOn {
    /// From what lies in `out`; nothing is changed there yet.
    fn of(scene: &Scene, file: &Path, out: &Path, console: &Console) -> Result<Option<Self>, RunError> {
        let record = Record::read(out)?;
        let (point, notes) = checkpoint::find(scene, out, &record);
        notes.iter().for_each(|note| console.warning(note));
        let record = record.renewed(scene, file, point.as_ref())?;
        let mut this = Self {
            stage: record.first,
            record,
            point: None,
            within: None,
            summaries: Vec::new(),
            done: false,
        };
        let Some(point) = point else {
            console.line("no window was saved: the run begins anew");
            return Ok(Some(this));
        };
        let (seal, stage) = (point.seal.clone(), point.stage);
        let planned = scene.stages[stage].windows() as f64 * scene.stages[stage].window_s;
        // A stage that was stopped short, or has become longer, goes on.
        let over = match seal.ended.as_deref() {
            None => false,
            Some("complete" | "stopped as asked") => planned <= seal.time_s * (1.0 + 1e-9),
            Some(_) => true,
        };
        this.stage = stage + usize::from(over);
        this.done = this.stage == scene.stages.len();
        let mut warnings = Vec::new();
        for before in this.record.first..this.stage {
            let folder = case::state_folder(out, scene, before);
            if let Ok(progress) = Progress::load(&folder) {
                warnings = progress.warnings;
                this.summaries.push(StageSummary { speeds: progress.speeds, ..progress.summary });
            }
        }
        if !over {
            if !seal.cannot.is_empty() {
                return Err(RunError::Input(format!(
                    "the run stands within stage `{}`, where {} left nothing to go on from: a program that can be \
                     resumed announces the effect `resume` (docs/contract.md). `--stage {}` without --resume runs \
                     the stage from its start",
                    seal.name,
                    seal.cannot.join(" and "),
                    seal.name
                )));
            }
            let within = point.progress()?;
            warnings.clone_from(&within.warnings);
            this.within = Some(within);
            console.line(&format!(
                "going on with stage `{}` after {} windows (t = {:.4} s)",
                seal.name, seal.windows, seal.time_s
            ));
        } else if !this.done {
            console.line(&format!("stage `{}` is done: going on with the next", seal.name));
        }
        console.remember(warnings);
        this.point = Some(point);
        Ok(Some(this))
    }

    /// Puts the state in its place; returns the identity of the run.
    fn begin(&mut self, scene: &Scene, out: &Path) -> Result<u64, RunError> {
        if let Some(point) = &mut self.point {
            point.adopt(scene, out)?;
        }
        self.record.write(out)?;
        Ok(self.record.run)
    }
}

/// A run that is resumed although nothing is left to do.
fn finished(
    scene: &Scene,
    out: PathBuf,
    console: &Console,
    going_on: Option<GoingOn>,
) -> Result<(RunSummary, PathBuf), RunError> {
    console.line(
        "this run is complete: there is nothing to resume. A longer last stage, or a further one, would be gone on with",
    );
    let summary = summary_of(scene, going_on.map(|g| g.summaries).unwrap_or_default());
    Ok((summary, out))
}

/// The summary of a run that begins now, `stages` being done.
fn summary_of(scene: &Scene, stages: Vec<StageSummary>) -> RunSummary {
    RunSummary {
        scene: scene.name.clone(),
        ended: "complete".into(),
        version: env!("CARGO_PKG_VERSION"),
        started_utc: terminal::utc_now(),
        command: std::env::args().collect(),
        machine: results::machine::Machine::here(),
        contract: channel::CONTRACT_VERSION,
        inspection: Vec::new(),
        warnings: Vec::new(),
        wall_s: 0.0,
        ranks: Role::ALL.map(|role| scene.ranks.of(role)),
        stages,
    }
}

/// Effects of the scene, with the program that must implement each.
pub(crate) fn asked(scene: &Scene) -> Vec<(Role, String)> {
    let mut all: Vec<_> =
        effects(scene).into_iter().filter(|e| e.on).map(|e| (e.role, e.key.to_owned())).collect();
    if scene.has_stage_wind() {
        all.push((Role::Flow, channel::STAGE_WIND.to_owned()));
        if scene.structure_meets_wind() {
            all.push((Role::Structure, channel::STAGE_WIND.to_owned()));
        }
    }
    all
}

fn earlier_state(
    scene: &Scene,
    out: &Path,
    interface: &CanopyInterface,
    before: usize,
) -> Result<InterfaceState, RunError> {
    let folder = case::state_folder(out, scene, before);
    state::load(&folder, interface.nodes(), interface.faces.len()).map_err(|error| {
        RunError::Input(format!(
            "{error}\nstage `{}` starts from stage `{}`: run that one first, with the same --out",
            scene.stages[before + 1].name,
            scene.stages[before].name
        ))
    })
}

/// Draws what the histories hold.
fn plots(scene: &Scene, out: &Path, interface: &CanopyInterface) -> Result<(), RunError> {
    for (at, stage) in scene.stages.iter().enumerate() {
        let folder = case::stage_folder(out, scene, at);
        let history = folder.join("history.csv");
        if stage.kind == StageKind::Coupled && history.exists() {
            plot::descent(&history, &folder.join("descent.svg"), scene, interface)?;
        }
    }
    Ok(())
}

/// Removes what an earlier run left in a stage's folder, and only if it is one.
fn clear(folder: &Path) -> Result<(), RunError> {
    if folder.join("history.csv").exists() || folder.join("logs").exists() {
        fs::remove_dir_all(folder).map_err(RunError::file("clear", folder))?;
    }
    fs::create_dir_all(folder).map_err(RunError::file("create", folder))
}

pub(crate) fn keep_scene(file: &Path, out: &Path) -> Result<(), RunError> {
    let copy = out.join(SCENE);
    if copy != file {
        fs::copy(file, &copy).map_err(RunError::file("write", &copy))?;
    }
    Ok(())
}

pub(crate) fn shorten(name: &str) -> String {
    name.chars().take(24).collect()
}

/// Folder for MPI's temporary files, in shared memory, removed when dropped.
pub(crate) struct Scratch(pub(crate) PathBuf);

impl Scratch {
    const PREFIX: &str = "ripstop-mpi-";

    fn base() -> PathBuf {
        let memory = Path::new("/dev/shm");
        if memory.is_dir() { memory.to_path_buf() } else { std::env::temp_dir() }
    }

    /// Removes folders of runs that were killed: their names hold the process.
    fn sweep() {
        let Ok(entries) = fs::read_dir(Self::base()) else { return };
        for entry in entries.flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let Some(session) = name.strip_prefix(Self::PREFIX) else { continue };
            let process = session.rsplit('-').nth(1).and_then(|p| p.parse::<u32>().ok());
            if process.is_some_and(|p| !Path::new(&format!("/proc/{p}")).exists()) {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
    }

    pub(crate) fn create(session: &str) -> Result<Self, RunError> {
        // MPI puts socket paths below it, which must stay short.
        let folder = Self::base().join(format!("{}{session}", Self::PREFIX));
        // Anybody may write beside it: what is there under this process's number is a leftover
        // of a dead one of ours, which can be removed, or somebody else's, which cannot.
        let _ = fs::remove_dir_all(&folder);
        fs::DirBuilder::new().mode(0o700).create(&folder).map_err(RunError::file("create", &folder))?;
        Ok(Self(folder))
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // A rank that is just being killed may still write: try for a moment.
        for _ in 0..20 {
            match fs::remove_dir_all(&self.0) {
                Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                    std::thread::sleep(Duration::from_millis(25));
                }
                _ => break,
            }
        }
    }
}
