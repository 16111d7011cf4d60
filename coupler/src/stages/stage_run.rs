//! A stage that runs: opened, then window after window stepped, recorded and saved, and closed.

use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Instant;

use case::{Role, Solve, StageKind};
use channel::Window;
use coupling::descent::DescentModel;
use coupling::energy::InterfaceEnergyBalance;
use coupling::error::{Location, RunError};
use coupling::flow_bounds::{self, FlowBounds};
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};
use coupling::structure_energy;
use coupling::window_clock::WindowClock;
use results::checkpoint::{self, Seal};
use results::history::{History, Iterations, Row};
use results::progress::Progress;
use results::summary::StageSummary;

use super::saves::Saves;
use super::{StageContext, Stepper, stepper};

/// Rejected windows that are reported one by one.
const TOLD: u64 = 5;

/// The first sentence of an error.
fn brief(error: &RunError) -> String {
    let text = error.to_string();
    text.split("; ").next().unwrap_or(&text).split(". Re").next().unwrap_or(&text).to_owned()
}

/// The files of a stage that grow by its windows.
struct Records {
    history: History,
    /// Of coupled stages.
    iterations: Option<Iterations>,
}

impl Records {
    /// In `folder`; `resumed` appends to those that are there.
    fn open(folder: &std::path::Path, kind: StageKind, resumed: bool) -> Result<Self, RunError> {
        let (rows, all) = (folder.join("history.csv"), folder.join("iterations.csv"));
        let coupled = kind == StageKind::Coupled;
        let history = if resumed { History::resume(&rows, kind)? } else { History::create(&rows, kind)? };
        let iterations = match (coupled, resumed) {
            (false, _) => None,
            (true, true) => Some(Iterations::resume(&all)?),
            (true, false) => Some(Iterations::create(&all)?),
        };
        Ok(Self { history, iterations })
    }

    fn push(&mut self, row: &Row) -> Result<(), RunError> {
        self.history.push(row)?;
        self.iterations.as_mut().map_or(Ok(()), |iterations| iterations.push(row))
    }
}

/// A window that was computed and accepted.
pub(super) struct Stepped {
    window: Window,
    /// Displacement of the canopy at its start, `[nodes][3]`, m.
    before: Vec<f64>,
    report: WindowReport,
}

/// A stage between its first window and its last.
pub(super) struct StageRun<'c, 'p> {
    context: &'c StageContext<'c>,
    partners: &'p mut dyn Partners,
    summary: &'p mut StageSummary,
    stepper: Box<dyn Stepper + 'c>,
    folder: PathBuf,
    records: Records,
    descent: Option<DescentModel>,
    interface_energy: InterfaceEnergyBalance,
    flow_bounds: Option<FlowBounds>,
    clock: WindowClock,
    progress: Progress,
    saves: Saves,
    /// Planned windows to run.
    windows: u64,
    /// Number of the window to come, accepted ones so far, rejected attempts at this one.
    index: u64,
    done: u64,
    rejected: u32,
    /// When the first attempt at this window began.
    started: Instant,
    /// Seconds of the runs that this one continues.
    wall_before: f64,
    /// Why the stage ends, for the summary.
    ended: String,
}

impl<'c, 'p> StageRun<'c, 'p> {
    /// Makes ready for the first window, or for the one after those of a saved state.
    pub fn open(
        context: &'c StageContext<'c>,
        partners: &'p mut dyn Partners,
        state: InterfaceState,
        summary: &'p mut StageSummary,
    ) -> Result<Self, RunError> {
        let _part = timing::part("open");
        let (stage, resumed) = (context.description(), context.resumed);
        context.compare_pressures(&state);
        let mut stepper = stepper(context, partners, state)?;
        if let Some(saved) = resumed {
            stepper.restore_state(&saved.stepper)?;
            *summary = StageSummary { speeds: saved.speeds.clone(), ..saved.summary.clone() };
        }
        let folder = case::stage_folder(context.out, context.scene, context.stage);
        let records = Records::open(&folder, stage.kind, resumed.is_some())?;
        let clock = match resumed {
            Some(saved) => unpack(&saved.clock)?,
            None => WindowClock::new(stage.window_s, context.adaptive(partners)),
        };
        let all = context.windows();
        let windows = context.options.stop_after_windows.map_or(all, |n| n.min(all));
        summary.ended = "failed".into();
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
            progress: Progress::new(context.console, &stage.name, stage.kind, clock.planned(), windows),
            clock,
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

    /// Computes and accepts the next window; `None` where it was rejected, to be retried shorter.
    pub fn step(&mut self) -> Result<Option<Stepped>, RunError> {
        let _part = timing::part("window");
        let window = self.window();
        let before = self.stepper.state().displacement.clone();
        // What half the window did not improve is accepted, if it is acceptable.
        let shorter = self.clock.can_shrink() && !self.clock.is_short();
        match self.stepper.step(self.partners, window, shorter) {
            Ok(report) => {
                self.clock.advance(report.converged);
                Ok(Some(Stepped { window, before, report }))
            }
            Err(error) if error.is_retryable() && self.clock.shrink() => {
                self.give_back(&window, &error);
                Ok(None)
            }
            Err(error) => Err(self.failed(error)),
        }
    }

    /// Enters a window into balances, files and summary; warns of what it gives reason to.
    pub fn record(&mut self, stepped: Stepped) -> Result<Row, RunError> {
        let _part = timing::part("record");
        let Stepped { window, before, report } = stepped;
        let row = self.row(&window, report);
        self.warn(&row);
        self.records.push(&row)?;
        self.check_flow(&row, window, &before)?;
        self.summary.add(&row);
        self.summary.wall_s = self.wall_before + self.progress.seconds();
        self.progress.update(&row);
        self.done = self.index + 1;
        Ok(row)
    }

    /// Whether the stage ends with the window of `row`; takes the pictures that are due.
    pub fn ends(&mut self, row: &Row) -> Result<bool, RunError> {
        let _part = timing::part("snapshots");
        let (settled, planned) = (self.stepper.settled(&row.report), self.clock.planned());
        let last = settled.is_some() || planned == self.windows;
        // Pictures are of the planned times.
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

    /// Saves where that is due; continues with the next window unless the run is to stop.
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

    /// Saves the end of the stage; its values on the interface.
    pub fn close(mut self) -> Result<InterfaceState, RunError> {
        let _part = timing::part("close");
        self.progress.note("saving");
        self.records.history.sync()?;
        let ended = std::mem::take(&mut self.ended);
        self.summary.ended.clone_from(&ended);
        self.summary.wall_s = self.wall_before + self.progress.seconds();
        self.save(Some(ended))?;
        self.summary.wall_s = self.wall_before + self.progress.seconds();
        self.saves.report(self.context.console, &self.context.description().name, self.progress.seconds());
        Ok(self.stepper.state().clone())
    }

    /// The window to come.
    fn window(&self) -> Window {
        let stage = self.context.description();
        // A static stage has no time; a window must have some.
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

    /// A place at the start of the window, for errors.
    fn place(&self) -> Location {
        Location { window: Some((self.index, 0)), ..self.context.place() }
    }

    /// Counts a window that is tried again with half its length, and says so.
    fn give_back(&mut self, window: &Window, error: &RunError) {
        self.rejected += 1;
        self.summary.rejected += 1;
        let count = self.summary.rejected;
        if count > TOLD {
            return;
        }
        self.context.console.line(&format!(
            "window {} of stage `{}` (t = {:.4} s) rejected; retrying with dt = {:.3e} s: {}{}",
            self.index,
            self.context.description().name,
            window.time,
            self.clock.dt(),
            brief(error),
            if count == TOLD { "; later ones are only counted" } else { "" }
        ));
    }

    /// The error of a window that ends the stage; the last accepted window is saved where all programs still stand at it.
    fn failed(&mut self, error: RunError) -> RunError {
        let error = self.context.advise(error);
        let stand = matches!(
            error,
            RunError::GridMotionFailed { .. }
                | RunError::SolveFailed { .. }
                | RunError::Energy { .. }
                | RunError::Unconverged { .. }
        );
        if !stand {
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

    /// The row of a window, which is entered into the balance of the coupling's energy.
    fn row(&mut self, window: &Window, report: WindowReport) -> Row {
        let wall_s = self.started.elapsed().as_secs_f64();
        let (felt, given) = self.stepper.interface_work().unwrap_or_default();
        self.interface_energy.add_window(window.dt, felt, given, report.converged);
        let state = self.stepper.state();
        Row {
            window: self.index,
            time_s: self.clock.time(),
            window_s: window.dt,
            rejected: self.rejected,
            done: self.clock.planned(),
            descent_speed_m_s: -state.velocity,
            acceleration_m_s2: state.acceleration,
            drag_coefficient: self.descent.map(|d| d.drag_coefficient(report.force[2])),
            interface_work_j: given,
            energy_error_j: felt - given,
            interface_energy: self.interface_energy,
            balance: self.stepper.system_balance().copied(),
            coupler_s: (wall_s - report.wall_s.iter().sum::<f64>()).max(0.0),
            wall_s,
            report,
        }
    }

    /// Warns of residuals, of energy that coupling or structure create, and of what the kind of stage watches.
    fn warn(&mut self, row: &Row) {
        let (context, console) = (self.context, self.context.console);
        let tolerance = context.scene.coupling.tolerance;
        let place = self.place();
        let said = self.summary.convergence.add(&place, &row.report, tolerance);
        said.iter().for_each(|text| console.warning(text));
        let warning_context = context.circumstances(self.stepper.state(), row.window_s);
        let structure = &row.report.stats[Role::Structure as usize].values;
        let texts = [
            self.interface_energy.warning(&warning_context),
            self.stepper.warning(),
            structure_energy::warning(self.summary.structure_energy_created_share, structure),
        ];
        for text in texts.into_iter().flatten() {
            console.warning(&format!(
                "window {} of stage `{}`: {text}",
                self.index,
                context.description().name
            ));
        }
    }

    /// Refuses speeds and pressures of the flow that no physics allows in the window of `row`, which began with the
    /// displacement `before`.
    fn check_flow(&mut self, row: &Row, window: Window, before: &[f64]) -> Result<(), RunError> {
        let (context, stage) = (self.context, self.context.description());
        let Some(bounds) = &mut self.flow_bounds else { return Ok(()) };
        if !stage.kind.roles().contains(&Role::Flow) {
            return Ok(());
        }
        // A march to a steady flow has no time: walls change their speed at once in it.
        let dt = if stage.steady.is_some() { f64::MIN_POSITIVE } else { window.dt };
        let wind = context.scene.wind(context.stage, &context.times());
        let air = flow_bounds::undisturbed_air(&wind, row.time_s, -row.descent_speed_m_s);
        let displacement = [before, &self.stepper.state().displacement];
        bounds.check(dt, air, displacement, flow_bounds::flow_statistics(&row.report.stats)).map_err(|flow| {
            let place =
                Location { window: Some((row.window, u64::from(row.report.iterations))), ..context.place() };
            RunError::ImpossibleFlow { place, flow, saved: None }
        })
    }

    /// Pictures of the programs that have some at the planned window `done`.
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

    /// Saves beside the last state, then takes its place, so that a failure
    /// while saving never costs the older one.
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
                // Half a state would only fill the disk further. (What other programs still write to it goes at their end.)
                let _ = checkpoint::remove(&draft);
                return Err(error);
            }
        }
        checkpoint::replace(&target)?;
        if over {
            // The stage is over: one state is enough.
            checkpoint::remove(&checkpoint::old(&target))?;
        }
        self.saves.count += 1;
        self.saves.last = (Instant::now(), start.elapsed());
        self.saves.seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// Writes the states of all programs and of the coupler into `draft` and seals them; their bytes.
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
            clock: pack(&self.clock),
            interface_energy: self.interface_energy,
            flow_bounds: self.flow_bounds,
            summary: so_far,
            speeds: self.summary.speeds.clone(),
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
