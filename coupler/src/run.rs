//! A whole run: stage after stage, each a session of its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use case::{Role, Scene, StageKind};

use crate::effects::effects;
use crate::error::RunError;
use crate::hub_partners::{HubPartners, SessionOptions};
use crate::interface::CanopyInterface;
use crate::launch::{Console, LaunchPlan, program_folder};
use crate::schemes::InterfaceState;
use crate::stages::{StageContext, StageOptions, initial_state};
use crate::summary::{RunSummary, StageSummary};
use crate::{plot, state};

/// What a user asks of a run, beside the scene.
#[derive(Clone, Debug, Default)]
pub struct RunOptions {
    /// Scene file.
    pub scene: PathBuf,
    /// Folder of the results; the scene's own, or `runs/<name>`, if absent.
    pub out: Option<PathBuf>,
    /// Ranks instead of the scene's.
    pub ranks: Vec<(Role, u32)>,
    /// Programs instead of the project's.
    pub programs: Vec<(Role, String)>,
    /// Name of the stage to start at; the stages before it were run earlier.
    pub stage: Option<String>,
    /// Stops each stage after so many windows.
    pub stop_after_windows: Option<u64>,
    /// Accepts coupled windows that do not converge.
    pub keep_going: bool,
    /// Longest time for one answer of a program.
    pub deadline: Option<Duration>,
}

/// A scene made ready: loaded, overridden, checked, with its canopy.
pub struct Prepared {
    /// The scene as it will run.
    pub scene: Scene,
    /// Absolute path of its file.
    pub file: PathBuf,
    /// Absolute folder of the results.
    pub out: PathBuf,
    /// Its canopy.
    pub interface: CanopyInterface,
    /// First stage to run.
    pub first: usize,
}

/// Loads and checks everything that can be checked before a program starts.
///
/// # Errors
/// [`RunError::Input`] with a message for the user.
pub fn prepare(options: &RunOptions) -> Result<Prepared, RunError> {
    let mut scene = case::load(&options.scene).map_err(|e| RunError::Input(e.to_string()))?;
    for (role, ranks) in &options.ranks {
        *match role {
            Role::Structure => &mut scene.ranks.structure,
            Role::Flow => &mut scene.ranks.flow,
            Role::Mesh => &mut scene.ranks.mesh,
        } = *ranks;
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
    Ok(Prepared { file: absolute(&options.scene)?, out: absolute(&out)?, scene, interface, first })
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
    let Prepared { scene, file, out, interface, first } = prepare(options)?;
    for stage in first..scene.stages.len() {
        // A program that is missing in the last stage should not cost the first ones.
        let programs = &program_folder()?;
        let (session, scratch) = ("", Path::new(""));
        let plan =
            LaunchPlan { scene: &scene, scene_file: &file, stage, session, out: &out, programs, scratch };
        plan.programs()?;
    }
    let start = Instant::now();
    fs::create_dir_all(&out).map_err(RunError::file("create", &out))?;
    let _lock = lock(&out)?;
    keep_scene(&file, &out)?;
    if let Err(error) = channel::cleanup_stale() {
        console.warning(&format!("leftovers of earlier runs could not be removed: {error}"));
    }
    Scratch::sweep();
    let mut summary = RunSummary {
        scene: scene.name.clone(),
        ended: "complete".into(),
        version: env!("CARGO_PKG_VERSION"),
        wall_s: 0.0,
        ranks: Role::ALL.map(|role| scene.ranks.of(role)),
        stages: Vec::new(),
    };
    let mut state = match first.checked_sub(1) {
        None => initial_state(&scene, &interface),
        Some(before) => earlier_state(&scene, &out, &interface, before)?,
    };
    let mut result = Ok(());
    for stage in first..scene.stages.len() {
        let context = StageContext {
            scene: &scene,
            stage,
            out: &out,
            interface: &interface,
            options: StageOptions {
                stop_after_windows: options.stop_after_windows,
                keep_going: options.keep_going,
            },
            console,
        };
        let mut stage_summary = StageSummary::new(&scene.stages[stage]);
        let ended = run_stage(&context, &file, options.deadline, stop, &mut state, &mut stage_summary);
        summary.stages.push(stage_summary);
        if let Err(error) = ended {
            summary.ended = error.to_string();
            result = Err(error);
            break;
        }
    }
    summary.wall_s = start.elapsed().as_secs_f64();
    summary.write(&out)?;
    if let Err(error) = plots(&scene, &out, &interface) {
        console.warning(&error.to_string());
    }
    result.map(|()| (summary, out))
}

fn run_stage(
    context: &StageContext<'_>,
    file: &Path,
    deadline: Option<Duration>,
    stop: &AtomicBool,
    state: &mut InterfaceState,
    summary: &mut StageSummary,
) -> Result<(), RunError> {
    let scene = context.scene;
    let stage = &scene.stages[context.stage];
    let folder = case::stage_folder(context.out, scene, context.stage);
    clear(&folder)?;
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
    };
    let programs: Vec<_> =
        plan.programs()?.into_iter().map(|p| (scene.ranks.of(p.role), p)).map(|(n, p)| (p, n)).collect();
    let names: Vec<String> = programs.iter().map(|(p, n)| format!("{} x {n}", p.name)).collect();
    context.console.line(&format!("stage `{}`: {}", stage.name, names.join(", ")));
    let options = SessionOptions {
        session: &session,
        stage: (&stage.name, context.stage),
        programs,
        effects: asked(scene),
        deadline,
    };
    let ended = (|| {
        let mut partners = HubPartners::start(options, context.interface, stop, context.console)?;
        *state = context.run(&mut partners, state.clone(), summary)?;
        partners.finish(context.console)
    })();
    // Every process is gone by now, however the stage ended.
    if let Err(error) = channel::cleanup(&session) {
        context.console.warning(&format!("shared memory of session {session}: {error}"));
    }
    ended
}

/// Effects of the scene, with the program that must implement each.
fn asked(scene: &Scene) -> Vec<(Role, String)> {
    effects(scene).into_iter().filter(|e| e.on).map(|e| (e.role, e.key.to_owned())).collect()
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

fn keep_scene(file: &Path, out: &Path) -> Result<(), RunError> {
    let copy = out.join("scene.toml");
    if copy != file {
        fs::copy(file, &copy).map_err(RunError::file("write", &copy))?;
    }
    Ok(())
}

fn shorten(name: &str) -> String {
    name.chars().take(24).collect()
}

/// One run at a time writes to a folder: a lock that the kernel frees however
/// this process ends.
fn lock(out: &Path) -> Result<fs::File, RunError> {
    use std::os::fd::AsRawFd;
    let path = out.join(".lock");
    let file = fs::File::create(&path).map_err(RunError::file("create", &path))?;
    // SAFETY: flock on a descriptor that `file` keeps open.
    if unsafe { libc::flock(file.as_raw_fd(), libc::LOCK_EX | libc::LOCK_NB) } != 0 {
        return Err(RunError::Input(format!(
            "another run writes to {}: wait for it, or name another folder with --out",
            out.display()
        )));
    }
    Ok(file)
}

/// Folder for MPI's temporary files, in shared memory, removed when dropped.
struct Scratch(PathBuf);

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

    fn create(session: &str) -> Result<Self, RunError> {
        // MPI puts socket paths below it, which must stay short.
        let folder = Self::base().join(format!("{}{session}", Self::PREFIX));
        fs::create_dir_all(&folder).map_err(RunError::file("create", &folder))?;
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
