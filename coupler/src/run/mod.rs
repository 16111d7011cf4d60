//! A run: its stages in order, each in its own session.

mod folder;
mod options;
mod prepare;
mod recording;
mod resume;
mod session;
mod without_programs;

use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use case::{Role, Scene, StageKind};
use checks::Inspection;
use coupling::error::{Location, RunError};
use coupling::interface::CanopyInterface;
use coupling::schemes::InterfaceState;
use figures::plot;
use results::progress::StageProgress;
use results::rank_advice::RankAdvice;
use results::state;
use results::summary::{COMPLETE, RUNNING, RunSummary, StageSummary};
use results::timings::StageTimings;
use results::wake::Wake;
use terminal::Console;

pub(crate) use self::folder::copy_scene;
pub use self::options::{BaselineOptions, LogLevel, RecordOptions, RunOptions};
pub use self::prepare::{Prepared, inspection, prepare};
pub(crate) use self::session::required_effects;

use self::resume::Resume;
use crate::launch::Session;
use crate::stages::{StageContext, StageOptions};

/// Runs the stages of a scene. Returns its summary and the folder of the
/// results. The run ends early when `stop` becomes true.
///
/// # Errors
/// The error that ended the run early; results so far, including `summary.json`, are kept.
pub fn run(
    options: &RunOptions,
    stop: &AtomicBool,
    console: &Console,
) -> Result<(RunSummary, PathBuf), RunError> {
    let prepared = prepare(options)?;
    let inspection = inspection(&prepared, options)?;
    inspection.announce(console)?;
    let resume = options.resume.then(|| Resume::find(&prepared, console)).transpose()?;
    if let Some(resume) = resume.as_ref().filter(|resume| resume.complete) {
        return Ok((already_complete(&prepared.scene, resume, console), prepared.out));
    }
    let mut run = Run::open(options, &prepared, &inspection, resume, stop, console)?;
    let mut state = run.state_at_start()?;
    let ended = run.stages.clone().try_for_each(|stage| run.stage(stage, &mut state));
    let summary = run.close(&ended)?;
    ended.map(|()| (summary, prepared.out))
}

/// A run with an open results folder.
struct Run<'a> {
    options: &'a RunOptions,
    prepared: &'a Prepared,
    stop: &'a AtomicBool,
    console: &'a Console,
    /// Stages to run, from 0.
    stages: Range<usize>,
    resume: Option<Resume>,
    /// Identity of the run in its saved states.
    identity: u64,
    summary: RunSummary,
    start: Instant,
    _lock: File,
}

impl<'a> Run<'a> {
    /// Checks the requirements of all stages, then opens the folder of the results.
    fn open(
        options: &'a RunOptions,
        prepared: &'a Prepared,
        inspection: &Inspection,
        mut resume: Option<Resume>,
        stop: &'a AtomicBool,
        console: &'a Console,
    ) -> Result<Self, RunError> {
        let scene = &prepared.scene;
        let first = resume.as_ref().map_or(prepared.first, |r| r.stage);
        let stages = first..if options.only { first + 1 } else { scene.stages.len() };
        session::require_programs(options, prepared, stages.clone())?;
        channel::ignore_sigxfsz();
        checks::shared_memory::require(scene, first, &prepared.interface)?;
        let start = Instant::now();
        let lock = folder::open(options, prepared, inspection, console)?;
        let identity = folder::identify(prepared, first, resume.as_mut())?;
        if let Some(record) = &options.record {
            folder::open_recording(record, prepared, first)?;
        }
        if let Err(error) = channel::cleanup_stale() {
            console.warning(&format!("shared memory of earlier runs could not be removed: {error}"));
        }
        Session::remove_leftovers();
        let before = resume.as_mut().map(|r| std::mem::take(&mut r.summaries)).unwrap_or_default();
        let summary = RunSummary { inspection: inspection.above_notes(), ..summary_of(scene, before) };
        let mut run =
            Self { options, prepared, stop, console, stages, resume, identity, summary, start, _lock: lock };
        StageProgress::remove(&prepared.out);
        // Replaces that of an earlier run in this folder, which would stay where this one is killed.
        run.write_summary(RUNNING)?;
        Ok(run)
    }

    /// Interface values before the first stage to run.
    fn state_at_start(&self) -> Result<InterfaceState, RunError> {
        let Prepared { scene, out, interface, .. } = self.prepared;
        match self.stages.start.checked_sub(1) {
            None => Ok(InterfaceState::at_start(scene, interface)),
            Some(before) => earlier_state(scene, out, interface, before),
        }
    }

    /// Runs a stage from `state`, which is updated to the end of the stage.
    fn stage(&mut self, stage: usize, state: &mut InterfaceState) -> Result<(), RunError> {
        let description = &self.prepared.scene.stages[stage];
        if self.stop.load(Ordering::Relaxed) {
            return Err(RunError::Interrupted(Location { stage: description.name.clone(), window: None }));
        }
        if self.prepared.scene.has_landed(state.position) {
            self.console
                .line(&format!("stage `{}` is not run: the payload is on the ground", description.name));
            return Ok(());
        }
        let mut summary = StageSummary::new(description);
        let context = self.context(stage);
        let folder = case::stage_folder(context.out, context.scene, stage);
        timing::take();
        let ended = session::run_stage(&context, &self.prepared.file, self.options, state, &mut summary);
        let warnings = summary.convergence.stage_warnings(&summary.name, summary.windows);
        warnings.iter().for_each(|text| self.console.warning(text));
        summary.assess(&folder.join("history.csv"), context.scene, context.interface);
        summary.rank_advice = self.rank_advice(stage, &summary);
        let overloaded = summary.safety_factors.iter().filter_map(|f| f.warning(&summary.name));
        overloaded.for_each(|text| self.console.warning(&text));
        let of_loads = [
            summary.alternating_load.and_then(|a| a.warning(&summary.name)),
            summary.opening.and_then(|o| o.warning(&summary.name)),
        ];
        of_loads.iter().flatten().for_each(|text| self.console.warning(text));
        if ended.is_ok()
            && let Some(text) = summary.unloaded_canopy(context.scene, context.interface)
        {
            self.console.warning(&text);
        }
        if ended.is_ok()
            && self.prepared.scene.main_stage() == stage
            && let Some(verdict) = summary.wake.as_ref().and_then(Wake::verdict)
        {
            self.console.warning(&verdict.warning(&summary.name));
        }
        let falls = |s: &case::Stage| matches!(s.kind, StageKind::Coupled | StageKind::Trajectory);
        if ended.is_ok()
            && self.prepared.scene.stages.iter().rposition(falls) == Some(stage)
            && let Some(height) = self.prepared.scene.descent.as_ref().and_then(|d| d.release_height_m)
            && !self.prepared.scene.has_landed(state.position)
        {
            self.console.warning(&format!(
                "the payload is still {:.2} m above ground at the end of stage `{}`: lengthen the stage for a touch-down",
                height + state.position[2],
                description.name
            ));
        }
        let (name, roles) = (&description.name, self.prepared.scene.roles(description));
        self.summary.timings.push(StageTimings::collect(name, &folder, roles, timing::take()));
        if ended.is_err() && summary.ended == COMPLETE {
            // Before its first window.
            summary.ended = "failed".into();
        }
        self.summary.stages.push(summary);
        self.write_summary(RUNNING)?;
        ended
    }

    /// Advice on the ranks of a stage that ran as a whole, on this machine.
    fn rank_advice(&self, stage: usize, summary: &StageSummary) -> Option<RankAdvice> {
        let resumed = self.resume.as_ref().is_some_and(|r| r.stage == stage && r.within.is_some());
        if resumed || !self.options.mpirun.is_empty() {
            return None;
        }
        let replaced: Vec<Role> = self.options.programs.iter().map(|(role, _)| *role).collect();
        RankAdvice::of(summary, &self.prepared.views[stage], self.summary.machine.threads, &replaced)
    }

    fn context(&self, stage: usize) -> StageContext<'_> {
        let Prepared { out, interface, views, .. } = self.prepared;
        let scene = &views[stage];
        let every = self.options.checkpoint_every.or(scene.output.checkpoint_every_windows);
        let options = StageOptions {
            stop_after_windows: self.options.stop_after_windows,
            accept_unconverged: self.options.accept_unconverged,
            checkpoint_every: every.map(u64::from),
            run: self.identity,
        };
        let resumed = self.resume.as_ref().filter(|r| r.stage == stage).and_then(|r| r.within.as_ref());
        StageContext {
            scene,
            stage,
            out,
            interface,
            options,
            console: self.console,
            stop: self.stop,
            altitude_of_release: self.prepared.scene.flow.as_ref().and_then(|f| f.altitude_m),
            resumed,
        }
    }

    /// Writes `summary.json` of the stages so far.
    fn write_summary(&mut self, ended: &str) -> Result<(), RunError> {
        self.summary.ended = ended.into();
        self.summary.wall_s = self.start.elapsed().as_secs_f64();
        self.summary.warnings = self.console.warnings();
        self.summary.write(&self.prepared.out)
    }

    /// Writes the summary and plots the histories, also after an error in `ended`.
    fn close(mut self, ended: &Result<(), RunError>) -> Result<RunSummary, RunError> {
        let Prepared { scene, out, interface, .. } = self.prepared;
        let how = ended.as_ref().map_or_else(ToString::to_string, |()| COMPLETE.into());
        let deviates = self.summary.stages.iter().any(|stage| stage.deviates);
        let code = ended
            .as_ref()
            .map_or_else(RunError::exit_code, |()| if deviates { RunError::Differs.exit_code() } else { 0 });
        self.summary.exit_code = Some(code);
        self.write_summary(&how)?;
        if let Err(error) = plots(scene, out, interface) {
            self.console.warning(&error.to_string());
        }
        Ok(self.summary)
    }
}

/// The summary of a complete run that was to be resumed.
fn already_complete(scene: &Scene, resume: &Resume, console: &Console) -> RunSummary {
    console.line(
        "this run is complete: there is nothing to resume. To continue, lengthen the last stage or add one",
    );
    summary_of(scene, resume.summaries.clone())
}

/// The summary of a run that starts now after the completed `stages`.
fn summary_of(scene: &Scene, stages: Vec<StageSummary>) -> RunSummary {
    RunSummary {
        scene: scene.name.clone(),
        ended: COMPLETE.into(),
        exit_code: None,
        version: env!("CARGO_PKG_VERSION"),
        commit: results::provenance::commit(),
        started_utc: terminal::utc_now(),
        command: std::env::args().collect(),
        machine: results::machine::Machine::here(),
        contract: channel::CONTRACT_VERSION,
        inspection: Vec::new(),
        warnings: Vec::new(),
        wall_s: 0.0,
        ranks: Role::ALL.map(|role| scene.ranks.of(role)),
        stages,
        timings: Vec::new(),
    }
}

/// Interface values at the end of stage `before` of an earlier run.
fn earlier_state(
    scene: &Scene,
    out: &Path,
    interface: &CanopyInterface,
    before: usize,
) -> Result<InterfaceState, RunError> {
    let folder = case::state_folder(out, scene, before);
    state::load(&folder, interface.nodes(), interface.faces.len()).map_err(|error| {
        RunError::Input(format!(
            "{error}\nstage `{}` starts from stage `{}`: run that stage first, with the same --out",
            scene.stages[before + 1].name,
            scene.stages[before].name
        ))
    })
}

/// Plots the histories of the coupled stages.
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
