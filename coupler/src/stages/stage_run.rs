//! The run of one stage: open, then step, record and save each window, and close.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use case::{Role, Solve, StageKind};
use channel::{Window, flow_stats};
use coupling::descent::DescentModel;
use coupling::energy::InterfaceEnergyBalance;
use coupling::energy_limit::EnergyLimit;
use coupling::error::{Location, RunError};
use coupling::flow_bounds::{self, FlowBounds};
use coupling::leakage;
use coupling::local_mach;
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};
use coupling::structure_energy;
use coupling::window_clock::WindowClock;
use results::checkpoint::{self, Seal};
use results::history::{History, Iterations, Points, Row};
use results::progress::Progress;
use results::summary::StageSummary;

use super::saves::Saves;
use super::{StageContext, Stepper, stepper};

/// Rejected windows that are reported individually.
const MAX_REPORTED: u64 = 5;

/// The first sentence of an error.
fn brief(error: &RunError) -> String {
    let text = error.to_string();
    text.split("; ").next().unwrap_or(&text).split(". Re").next().unwrap_or(&text).to_owned()
}

/// Progress of the stage to `windows` planned windows, of which `done` are completed.
fn progress(context: &StageContext<'_>, done: u64, windows: u64) -> Progress {
    let stage = context.description();
    let time_s = context.resumed.map_or(0.0, |saved| saved.time_s);
    Progress::new(context.console, &stage.name, stage.kind, done, windows)
        .with_drag_of(context.scene.watched_force(stage.kind).name())
        .with_file(context.out, context.stage + 1, context.scene.stages.len(), time_s)
}

/// The files to which each window of a stage adds rows.
struct Records {
    history: History,
    /// Coupling iterations; coupled stages only.
    iterations: Option<Iterations>,
    /// Displacement of chosen points of the canopy; stages with the structure only.
    points: Option<Points>,
}

impl Records {
    /// Creates the files in `folder`; `resumed`: appends to the existing ones.
    fn open(
        folder: &std::path::Path,
        kind: StageKind,
        points: &[(String, usize)],
        resumed: bool,
    ) -> Result<Self, RunError> {
        let (rows, all) = (folder.join("history.csv"), folder.join("iterations.csv"));
        let coupled = kind == StageKind::Coupled;
        let history = History::open(&rows, kind, resumed)?;
        let iterations = if coupled { Some(Iterations::open(&all, resumed)?) } else { None };
        let points = if kind.roles().contains(&Role::Structure) { points } else { &[] };
        let points = Points::open(&folder.join("points.csv"), points, resumed)?;
        Ok(Self { history, iterations, points })
    }

    /// Adds a window, at whose end the canopy has `displacement`, `[nodes][3]`, m.
    fn push(&mut self, row: &Row, displacement: &[f64]) -> Result<(), RunError> {
        self.history.push(row)?;
        self.points.as_mut().map_or(Ok(()), |points| points.push(row.time_s, displacement))?;
        self.iterations.as_mut().map_or(Ok(()), |iterations| iterations.push(row))
    }
}

/// An accepted window.
pub(super) struct AcceptedWindow {
    window: Window,
    /// Displacement of the canopy at its start, `[nodes][3]`, m.
    before: Vec<f64>,
    report: WindowReport,
}

/// A running stage.
pub(super) struct StageRun<'c, 'p> {
    pub(super) context: &'c StageContext<'c>,
    partners: &'p mut dyn Partners,
    pub(super) summary: &'p mut StageSummary,
    pub(super) stepper: Box<dyn Stepper + 'c>,
    folder: PathBuf,
    records: Records,
    pub(super) descent: Option<DescentModel>,
    pub(super) interface_energy: InterfaceEnergyBalance,
    flow_bounds: Option<FlowBounds>,
    pub(super) clock: WindowClock,
    energy_limit: EnergyLimit,
    progress: Progress,
    saves: Saves,
    /// Planned windows to run.
    windows: u64,
    /// Number of the next window, from 0.
    pub(super) index: u64,
    /// Accepted windows so far.
    done: u64,
    /// Rejections of the current window so far.
    pub(super) rejected: u32,
    /// Start of the first solve of the current window.
    pub(super) started: Instant,
    /// Wall time of the earlier runs that this run resumes, s.
    wall_before: f64,
    /// Reason for the end of the stage, for the summary.
    ended: String,
}

impl<'c, 'p> StageRun<'c, 'p> {
    /// Prepares the first window, or the window after a checkpoint.
    pub fn open(
        context: &'c StageContext<'c>,
        partners: &'p mut dyn Partners,
        state: InterfaceState,
        summary: &'p mut StageSummary,
    ) -> Result<Self, RunError> {
        let _part = timing::part("open");
        let (stage, resumed) = (context.description(), context.resumed);
        context.compare_pressures(&state);
        context.compare_density(&state);
        let mut stepper = stepper(context, partners, state)?;
        if let Some(saved) = resumed {
            stepper.restore_state(&saved.stepper)?;
            *summary = StageSummary {
                speeds: saved.speeds.clone(),
                wake_samples: saved.wake.clone(),
                ..saved.summary.clone()
            };
        }
        let folder = case::stage_folder(context.out, context.scene, context.stage);
        let records =
            Records::open(&folder, stage.kind, &context.interface.points(context.scene), resumed.is_some())?;
        let (clock, energy_limit) = match resumed {
            Some(saved) => unpack(&saved.clock)?,
            None => {
                let adaptive = context.adaptive(partners);
                (WindowClock::new(stage.window_s, adaptive), context.energy_limit(adaptive))
            }
        };
        let all = context.windows();
        let windows = context.options.stop_after_windows.map_or(all, |n| n.min(all));
        summary.ended = "failed".into();
        summary.drag_of = context.scene.watched_force(stage.kind).name().into();
        let first = resumed.map_or(0, |saved| saved.windows);
        Ok(Self {
            records,
            descent: context.descent(),
            interface_energy: resumed
                .map_or_else(InterfaceEnergyBalance::default, |saved| saved.interface_energy),
            flow_bounds: match resumed {
                Some(saved) => saved.flow_bounds,
                None => FlowBounds::new(context.scene, context.interface),
            },
            progress: progress(context, clock.planned(), windows),
            clock,
            energy_limit,
            saves: Saves::default(),
            windows,
            index: first,
            done: first,
            rejected: 0,
            started: Instant::now(),
            wall_before: resumed.map_or(0.0, |saved| saved.summary.wall_s),
            ended: if windows < all { "stopped as asked" } else { "complete" }.to_owned(),
            context,
            partners,
            summary,
            stepper,
            folder,
        })
    }

    /// Whether there are windows left.
    pub fn continues(&self) -> bool {
        self.clock.planned() < self.windows
    }

    /// Computes and accepts the next window. `None`: it was rejected and is to be retried with half its length.
    pub fn step(&mut self) -> Result<Option<AcceptedWindow>, RunError> {
        let _part = timing::part("window");
        let window = self.window();
        let before = self.stepper.state().displacement.clone();
        // If halving did not improve convergence, an acceptable window is accepted instead of being halved again.
        let shorter = self.clock.can_shrink() && !self.clock.is_short();
        match self.stepper.step(self.partners, window, shorter) {
            Ok(report) => {
                self.clock.advance(report.converged);
                Ok(Some(AcceptedWindow { window, before, report }))
            }
            Err(error) if error.is_retryable() && self.clock.shrink() => {
                self.reject(&window, &error);
                Ok(None)
            }
            Err(error) => Err(self.failed(error)),
        }
    }

    /// Adds a window to balances, files and summary, and prints its warnings.
    pub fn record(&mut self, accepted: AcceptedWindow) -> Result<Row, RunError> {
        let _part = timing::part("record");
        let AcceptedWindow { window, before, report } = accepted;
        let row = self.row(&window, report);
        self.warn(&row);
        self.limit_length(&row);
        self.records.push(&row, &self.stepper.state().displacement)?;
        self.check_flow(&row, window, &before)?;
        if let Some(text) = self.leakage_warning(&row) {
            self.window_warning(&text);
        }
        self.summary.add(&row);
        self.summary.wall_s = self.wall_before + self.progress.seconds();
        self.progress.update(&row);
        self.done = self.index + 1;
        Ok(row)
    }

    /// Whether the stage ends with the window of `row`; writes the snapshots that are due.
    pub fn ends(&mut self, row: &Row) -> Result<bool, RunError> {
        let _part = timing::part("snapshots");
        let settled = self.stepper.settled(&row.report).or_else(|| self.touch_down(row.time_s));
        let planned = self.clock.planned();
        let last = settled.is_some() || planned == self.windows;
        // Snapshots are written at planned times only.
        if self.clock.at_planned() || last {
            self.snapshots(planned, row.time_s, last)?;
        }
        let whole = settled.is_some() || planned == self.context.windows();
        if let Some(text) = self.stepper.warning_at_end(&row.report).filter(|_| whole) {
            let stage = &self.context.description().name;
            self.context.console.warning(&format!("end of stage `{stage}`: {text}"));
        }
        if let Some(why) = settled {
            self.ended = why;
        }
        Ok(last)
    }

    /// The end of a descent on the ground, with the figures of the landing.
    fn touch_down(&self, time_s: f64) -> Option<String> {
        let InterfaceState { position, velocity: [u, v, w], .. } = self.stepper.state();
        self.context.scene.has_landed(*position).then(|| {
            format!(
                "touch-down after {time_s:.2} s at {:.2} m/s downwards and {:.2} m/s sideways, after a drift of {:.1} m",
                -w,
                u.hypot(*v),
                position[0].hypot(position[1])
            )
        })
    }

    /// Saves a checkpoint if due, and prepares the next window.
    ///
    /// # Errors
    /// [`RunError::Interrupted`] where the run is to stop, after saving.
    pub fn checkpoint(&mut self) -> Result<(), RunError> {
        let _part = timing::part("checkpoint");
        let stopped = self.context.stop.load(Ordering::Relaxed);
        if stopped || self.saves.due(self.context.options.checkpoint_every, self.done) {
            self.progress.note("saving");
            self.records.history.sync()?;
            self.save(None)?;
        }
        if stopped {
            return Err(RunError::Interrupted(self.place()));
        }
        (self.index, self.rejected, self.started) = (self.index + 1, 0, Instant::now());
        Ok(())
    }

    /// Saves the final state of the stage and returns its interface values.
    pub fn close(mut self) -> Result<InterfaceState, RunError> {
        let _part = timing::part("close");
        self.progress.note("saving");
        self.stepper.close();
        self.records.history.sync()?;
        let ended = std::mem::take(&mut self.ended);
        self.summary.ended.clone_from(&ended);
        let folder = case::stage_folder(self.context.out, self.context.scene, self.context.stage);
        self.summary.assess(&folder.join("history.csv"), self.context.scene, self.context.interface);
        self.summary.wall_s = self.wall_before + self.progress.seconds();
        self.save(Some(ended))?;
        self.summary.wall_s = self.wall_before + self.progress.seconds();
        self.saves.report(self.context.console, &self.context.description().name, self.progress.seconds());
        Ok(self.stepper.state().clone())
    }

    /// The next window.
    fn window(&self) -> Window {
        let stage = self.context.description();
        // A static or steady stage has no physical time, but a window requires a positive dt.
        let timeless = stage.solve == Solve::Static || stage.steady.is_some();
        Window {
            index: self.index,
            iteration: 0,
            substeps: u64::from(stage.substeps),
            time: self.clock.time(),
            dt: if timeless { 1.0 } else { self.clock.dt() },
            ..Window::default()
        }
    }

    /// The location of the current window, for errors.
    fn place(&self) -> Location {
        Location { window: Some((self.index, 0)), ..self.context.place() }
    }

    /// Counts and reports a rejected window that is retried with half its length.
    fn reject(&mut self, window: &Window, error: &RunError) {
        self.rejected += 1;
        self.summary.rejected += 1;
        let count = self.summary.rejected;
        if count > MAX_REPORTED {
            return;
        }
        self.context.console.line(&format!(
            "window {} of stage `{}` (t = {:.4} s) rejected; retrying with dt = {:.3e} s: {}{}",
            self.index,
            self.context.description().name,
            window.time,
            self.clock.dt(),
            brief(error),
            if count == MAX_REPORTED { "; further rejections of this stage are only counted" } else { "" }
        ));
    }

    /// Adapts the length of later windows to the energy that the coupling creates.
    fn limit_length(&mut self, row: &Row) {
        let passage_s = self.context.warning_context(self.stepper.state(), row.window_s).passage_s;
        let judged = self.interface_energy.is_judged(passage_s);
        let (created, work) = (row.energy_error_j, row.interface_work_j);
        let Some(change) = self.energy_limit.add_window(row.window_s, created, work, judged) else { return };
        self.clock.limit(self.energy_limit.halvings());
        self.summary.length_changes += 1;
        let count = self.summary.length_changes;
        if count <= MAX_REPORTED {
            self.context.console.line(&format!(
                "window {} of stage `{}` (t = {:.4} s): {change}; windows are now at most {:.3e} s long{}",
                self.index,
                self.context.description().name,
                row.time_s,
                self.clock.limit_s(),
                if count == MAX_REPORTED { "; further changes of this stage are only counted" } else { "" }
            ));
        }
    }

    /// The error of a window that ends the stage. Saves the last accepted window if all programs can restore it.
    fn failed(&mut self, error: RunError) -> RunError {
        let error = self.context.advise(error);
        let restorable = matches!(
            error,
            RunError::GridMotionFailed { .. }
                | RunError::SolveFailed { .. }
                | RunError::Energy { .. }
                | RunError::Unconverged { .. }
        );
        if !restorable {
            return error;
        }
        match self.save(None) {
            Ok(()) => error.with_saved_state(case::state_folder(
                self.context.out,
                self.context.scene,
                self.context.stage,
            )),
            Err(saving) => saving,
        }
    }

    /// Prints warnings of residuals, of energy created by coupling or structure, and of the stepper.
    fn warn(&mut self, row: &Row) {
        let (context, console) = (self.context, self.context.console);
        let tolerance = context.scene.coupling.tolerance;
        let place = self.place();
        let warnings = self.summary.convergence.add(&place, &row.report, tolerance);
        warnings.iter().for_each(|text| console.warning(text));
        let warning_context = context.warning_context(self.stepper.state(), row.window_s);
        let structure = &row.report.stats[Role::Structure as usize].values;
        let texts = [
            self.interface_energy.warning(&warning_context),
            self.stepper.warning(),
            structure_energy::warning(self.summary.structure_energy_created_share, structure),
            self.mach_warning(row),
        ];
        texts.into_iter().flatten().for_each(|text| self.window_warning(&text));
    }

    /// Prints a warning of this window.
    fn window_warning(&self, text: &str) {
        let name = &self.context.description().name;
        self.context.console.warning(&format!("window {} of stage `{name}`: {text}", self.index));
    }

    fn mach_warning(&self, row: &Row) -> Option<String> {
        let flow = self.context.scene.flow.as_ref()?;
        let statistics = flow_bounds::flow_statistics(&row.report.stats);
        local_mach::warning(flow.energy.is_some(), self.summary.largest_local_mach, statistics)
    }

    /// Of an immersed canopy: air that passes airtight cloth, after the bounds know the speeds of the window.
    fn leakage_warning(&mut self, row: &Row) -> Option<String> {
        let flow = self.context.scene.flow.as_ref().filter(|flow| flow.is_immersed())?;
        if !self.context.description().kind.roles().contains(&Role::Flow) {
            return None;
        }
        let area = self.context.interface.sizes.fabric_area;
        let defect = flow_bounds::flow_statistics(&row.report.stats)[flow_stats::MASS_DEFECT];
        let share = leakage::share(defect, flow.density_kg_m3, area, self.flow_bounds?.speed());
        let before = self.summary.largest_leakage_share.unwrap_or(0.0);
        self.summary.largest_leakage_share = Some(share.max(before));
        leakage::warning(before, share)
    }

    /// Refuses unphysical speeds and pressures of the flow in the window of `row`, whose initial displacement is
    /// `before`.
    fn check_flow(&mut self, row: &Row, window: Window, before: &[f64]) -> Result<(), RunError> {
        let (context, stage) = (self.context, self.context.description());
        let Some(bounds) = &mut self.flow_bounds else { return Ok(()) };
        if !stage.kind.roles().contains(&Role::Flow) {
            return Ok(());
        }
        // Iterations to a steady flow have no physical time: wall velocities change discontinuously.
        let dt = if stage.steady.is_some() { f64::MIN_POSITIVE } else { window.dt };
        let wind = context.scene.wind(context.stage, &context.times());
        let air = flow_bounds::undisturbed_air(&wind, row.time_s, self.stepper.state().velocity);
        let displacement = [before, &self.stepper.state().displacement];
        let statistics = flow_bounds::flow_statistics(&row.report.stats);
        let place =
            || Location { window: Some((row.window, u64::from(row.report.iterations))), ..context.place() };
        bounds.check(dt, air, displacement, statistics).map_err(|flow| RunError::ImpossibleFlow {
            place: place(),
            flow,
            saved: None,
        })?;
        local_mach::check(statistics).map_err(|flow| RunError::Supersonic { place: place(), flow })
    }

    /// Writes the snapshots of the programs that are due at the planned window `done`.
    fn snapshots(&mut self, done: u64, time: f64, last: bool) -> Result<(), RunError> {
        let roles = self.context.description().kind.roles();
        let output = &self.context.scene.output;
        for (role, every) in
            [(Role::Structure, output.surface_every_windows), (Role::Flow, output.volume_every_windows)]
        {
            let due = every > 0 && (done.is_multiple_of(u64::from(every)) || last);
            if roles.contains(&role) && due {
                self.partners.snapshot(role, time, &self.folder)?;
            }
        }
        Ok(())
    }

    /// Saves to a draft next to the last state, then replaces that state, so that a failure
    /// while saving never destroys it.
    fn save(&mut self, ended: Option<String>) -> Result<(), RunError> {
        let start = Instant::now();
        let target = case::state_folder(self.context.out, self.context.scene, self.context.stage);
        let draft = checkpoint::draft(&target);
        checkpoint::remove(&draft)?;
        std::fs::create_dir_all(&draft).map_err(RunError::file("create", &draft))?;
        let over = ended.is_some();
        match self.write(&draft, ended) {
            Ok(bytes) => self.saves.bytes = bytes,
            Err(error) => {
                // A partial state only uses disk space. Files that programs still write to it are removed when they end.
                let _ = checkpoint::remove(&draft);
                return Err(error);
            }
        }
        checkpoint::replace(&target)?;
        if over {
            // After the end of the stage only its final state is needed.
            checkpoint::remove(&checkpoint::old(&target))?;
        }
        self.saves.count += 1;
        self.saves.last = (Instant::now(), start.elapsed());
        self.saves.seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Writes the states of all programs and of the coupler to `draft` and seals them. Returns their size, bytes.
    fn write(&mut self, draft: &std::path::Path, ended: Option<String>) -> Result<u64, RunError> {
        let time_s = self.summary.time_s;
        self.partners.save(draft)?;
        results::state::save(draft, self.stepper.state())?;
        case::save_time(draft, time_s).map_err(|(path, e)| RunError::file("write", &path)(e))?;
        let mut so_far = self.summary.clone();
        so_far.used(&self.partners.used());
        let progress = checkpoint::Progress {
            windows: self.done,
            time_s,
            stepper: self.stepper.save_state(),
            clock: pack(&(&self.clock, &self.energy_limit)),
            interface_energy: self.interface_energy,
            flow_bounds: self.flow_bounds,
            summary: so_far,
            speeds: self.summary.speeds.clone(),
            wake: self.summary.wake_samples.clone(),
            warnings: self.context.console.warnings(),
        };
        progress.save(draft)?;
        let name = self.context.description().name.as_str();
        let mut seal = Seal::new(self.context.options.run, (self.context.stage, name), self.done, time_s);
        seal.cannot = self.partners.cannot_resume();
        if self.saves.count == 0 && !seal.cannot.is_empty() && ended.is_none() {
            self.context.console.warning(&format!(
                "{} does not support restart within a stage; the run continues but cannot be resumed within this stage",
                seal.cannot.join(" and ")
            ));
        }
        seal.ended = ended;
        checkpoint::seal(draft, seal)
    }
}
