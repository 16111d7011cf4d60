//! The stages of a run: window after window, whatever runs in them.

mod clock;
mod coupled;
mod floors;
mod flow_only;
mod pre_inflation;
mod prescribed;
mod release;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use case::{DescentEquation, Role, Scene, Scheme, Solve, Stage, StageKind, StageTimes, StaggeredSequence};
use channel::{Window, flow_stats};
use coupling::balance::SystemBalance;
use coupling::convergence::Judge;
use coupling::descent::DescentModel;
use coupling::energy::{Circumstances, EnergyBooks};
use coupling::error::{Place, RunError};
use coupling::flow_bounds::{self, FlowBounds};
use coupling::interface::CanopyInterface;
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport};
use coupling::structure_energy;
use results::checkpoint::{self, Seal};
use results::history::{History, Iterations, Row};
use results::summary::StageSummary;
use terminal::Console;

use self::clock::WindowClock;
use crate::progress::Progress;

/// Windows given back that are told one by one.
const TOLD: u64 = 5;

/// The first sentence of an error.
fn brief(error: &RunError) -> String {
    let text = error.to_string();
    text.split("; ").next().unwrap_or(&text).split(". Re").next().unwrap_or(&text).to_owned()
}

/// A stage as a person wants it.
#[derive(Clone, Debug, Default)]
pub struct StageOptions {
    /// Ends the stage after so many windows.
    pub stop_after_windows: Option<u64>,
    /// Accepts windows that are not converged.
    pub accept_unconverged: bool,
    /// Windows between two saves within the stage; 0: none; `None`: as often as costs little.
    pub checkpoint_every: Option<u64>,
    /// Identity of the run, for what is saved.
    pub run: u64,
}

/// What a stage works on.
pub struct StageContext<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Number of the stage.
    pub stage: usize,
    /// Folder of the run.
    pub out: &'a Path,
    /// The canopy.
    pub interface: &'a CanopyInterface,
    /// Options.
    pub options: StageOptions,
    /// Where lines go.
    pub console: &'a Console,
    /// Ends the stage at the end of a window when it becomes true.
    pub stop: &'a AtomicBool,
    /// Where the stage stood when it was saved, if it goes on from there.
    pub resumed: Option<&'a checkpoint::Progress>,
}

/// What differs between the kinds of stages: how one window is computed.
trait Stepper {
    /// Computes and accepts a window. After an error that [`RunError::may_pass`] the same window may be
    /// tried again with another length; `shorter`: with half of it.
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        w: Window,
        shorter: bool,
    ) -> Result<WindowReport, RunError>;

    /// Values at the end of the last accepted window.
    fn state(&self) -> &InterfaceState;

    /// Why the stage may end now, before its time.
    fn settled(&self, report: &WindowReport) -> Option<String> {
        let _ = report;
        None
    }

    /// What later windows depend on.
    fn memory(&self) -> Vec<u8>;

    /// Goes on from a [`Stepper::memory`] of the same stage.
    ///
    /// # Errors
    /// A memory of another one.
    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError>;

    /// What the end of the stage with this window gives reason to warn of.
    fn warning_at_end(&self, _report: &WindowReport) -> Option<String> {
        None
    }

    /// What the last window gives reason to warn of.
    fn warning(&mut self) -> Option<String> {
        None
    }

    /// Momentum and energy of the falling system. `None` where nothing falls.
    fn system_balance(&self) -> Option<&SystemBalance> {
        None
    }

    /// Work in the last window, J: what the structure felt, what the flow gave. `None` where
    /// nothing is coupled.
    fn interface_work(&self) -> Option<(f64, f64)> {
        None
    }
}

impl StageContext<'_> {
    fn description(&self) -> &Stage {
        &self.scene.stages[self.stage]
    }

    /// Windows of the stage.
    pub fn windows(&self) -> u64 {
        self.description().windows()
    }

    /// How long the stages before this one took.
    pub fn times(&self) -> StageTimes {
        StageTimes::completed(self.scene, self.out, self.stage)
    }

    /// What refuses windows that are not converged.
    fn judge(&self) -> Judge {
        let accept_unconverged = self.options.accept_unconverged;
        Judge { stage: self.description().name.clone(), accept_unconverged }
    }

    /// Whether the structure comes from a coupled stage: else the canopy was held until this stage begins.
    fn structure_was_coupled(&self) -> bool {
        let source = self.scene.source_stage(self.stage, Role::Structure);
        source.is_some_and(|k| self.scene.stages[k].kind == StageKind::Coupled)
    }

    /// The descent equation of the scene, if it has one.
    pub fn descent(&self) -> Option<DescentModel> {
        DescentModel::of(self.scene, self.interface)
    }

    /// The error of a window with what is known of its cause: a staggered scheme that blows up.
    fn advise(&self, error: RunError) -> RunError {
        let stage = self.description();
        if stage.kind != StageKind::Coupled || self.scene.coupling.scheme != Scheme::Staggered {
            return error;
        }
        error.advised(
            "The coupling is staggered, which is unstable where the fabric is light beside the air that it moves, at any \
             window_s. Remedy: coupling.scheme = \"implicit\"",
        )
    }

    /// What the remedy of an energy warning depends on, at the end of a window of `window_s` seconds.
    fn circumstances(&self, state: &InterfaceState, window_s: f64) -> Circumstances {
        let wind = self.scene.flow.as_ref().map_or([0.0; 3], |f| f.wind_m_s);
        let speed = (wind[0] * wind[0] + wind[1] * wind[1] + (wind[2] - state.velocity).powi(2)).sqrt();
        Circumstances {
            staggered: self.scene.coupling.scheme == Scheme::Staggered,
            tolerance: self.scene.coupling.tolerance,
            window_s,
            passage_s: self.interface.sizes.fabric_area.sqrt() / speed,
        }
    }

    /// The descent equation that the programs of the stage allow.
    fn descent_of(&self, partners: &dyn Partners) -> Option<DescentModel> {
        let mut model = self.descent()?;
        let Some(who) = partners.without_support_force() else { return Some(model) };
        model.support_known = false;
        if model.equation == DescentEquation::Momentum {
            self.console.warning(&format!(
                "stage `{}`: descent.equation = \"momentum\" is replaced by \"quasi-steady\": {who} does not report the mean \
                 force on the payload (effect `{}`). The frame then accelerates with the force of the air on the \
                 canopy, which is wrong while the canopy accelerates relative to the payload",
                self.description().name,
                channel::SUPPORT_FORCE
            ));
            model.equation = DescentEquation::QuasiSteady;
        }
        Some(model)
    }

    /// Runs the stage from `state` and saves its end. What was computed before an
    /// error stays, in files and in `summary`.
    ///
    /// # Errors
    /// Whatever ends the run early.
    pub fn run(
        &self,
        partners: &mut dyn Partners,
        state: InterfaceState,
        summary: &mut StageSummary,
    ) -> Result<InterfaceState, RunError> {
        let stage = self.description();
        self.compare_pressures(&state);
        let mut stepper: Box<dyn Stepper> = match stage.kind {
            StageKind::PreInflation => Box::new(pre_inflation::PreInflation::new(self, state)?),
            StageKind::FlowOnly => Box::new(flow_only::FlowOnly::new(self, state)),
            StageKind::Coupled => Box::new(coupled::Coupled::new(self, state, self.descent_of(partners))),
            StageKind::Prescribed => Box::new(prescribed::Prescribed::new(self, state)?),
        };
        let folder = case::stage_folder(self.out, self.scene, self.stage);
        let (rows, all) = (folder.join("history.csv"), folder.join("iterations.csv"));
        let coupled = stage.kind == StageKind::Coupled;
        let (mut books, mut first, mut wall_before) = (EnergyBooks::default(), 0, 0.0);
        let mut flow_bounds = FlowBounds::new(self.scene, self.interface);
        let mut history;
        let mut iterations = None;
        if let Some(p) = self.resumed {
            stepper.recall(&p.stepper)?;
            (books, first, wall_before) = (p.books, p.windows, p.summary.wall_s);
            flow_bounds = p.flow_bounds;
            *summary = StageSummary { speeds: p.speeds.clone(), ..p.summary.clone() };
            history = History::resume(&rows, stage.kind)?;
            if coupled {
                iterations = Some(Iterations::resume(&all)?);
            }
        } else {
            history = History::create(&rows, stage.kind)?;
            if coupled {
                iterations = Some(Iterations::create(&all)?);
            }
        }
        let windows = self.options.stop_after_windows.map_or(self.windows(), |n| n.min(self.windows()));
        summary.ended = "failed".into();
        let descent = self.descent();
        let mut saves = Saves::default();
        let mut ended = if windows < self.windows() { "stopped as asked" } else { "complete" }.to_owned();
        let mut done = first;
        let mut clock = match self.resumed {
            Some(p) => coupling::schemes::unpack(&p.clock)?,
            None => WindowClock::new(stage.window_s, self.adaptive(partners)),
        };
        let mut progress = Progress::new(self.console, &stage.name, stage.kind, clock.planned(), windows);
        let (mut index, mut rejected, mut start) = (first, 0, Instant::now());
        while clock.planned() < windows {
            let w = Window {
                index,
                iteration: 0,
                substeps: u64::from(stage.substeps),
                time: clock.time(),
                // A static stage has no time; a window must have some.
                dt: if stage.solve == Solve::Static || stage.steady.is_some() { 1.0 } else { clock.dt() },
                ..Window::default()
            };
            let before = stepper.state().displacement.clone();
            // What half the window did not mend is borne, if it can be.
            let report = match stepper.step(partners, w, clock.can_shrink() && !clock.is_short()) {
                Err(error) if error.may_pass() && clock.shrink() => {
                    rejected += 1;
                    summary.rejected += 1;
                    if summary.rejected <= TOLD {
                        self.console.line(&format!(
                            "window {index} of stage `{}` (t = {:.4} s) is given back and tried again with {:.3e} s: {}{}",
                            stage.name,
                            w.time,
                            clock.dt(),
                            brief(&error),
                            if summary.rejected == TOLD { "; later ones are only counted" } else { "" }
                        ));
                    }
                    continue;
                }
                Err(
                    error @ (RunError::Stuck { .. }
                    | RunError::NoAnswer { .. }
                    | RunError::Energy { .. }
                    | RunError::Unconverged { .. }),
                ) => {
                    // All programs still stand at the last accepted window.
                    self.save(
                        partners,
                        stepper.as_ref(),
                        &clock,
                        (books, flow_bounds),
                        summary,
                        done,
                        None,
                        &mut saves,
                    )?;
                    let folder = case::state_folder(self.out, self.scene, self.stage);
                    return Err(self.advise(error).saved_in(folder));
                }
                other => other.map_err(|error| self.advise(error))?,
            };
            clock.advance(report.converged);
            let wall_s = start.elapsed().as_secs_f64();
            let (felt, given) = stepper.interface_work().unwrap_or_default();
            books.enter(w.dt, felt, given, report.converged);
            let state = stepper.state();
            let row = Row {
                window: index,
                time_s: clock.time(),
                window_s: w.dt,
                rejected,
                done: clock.planned(),
                descent_speed_m_s: -state.velocity,
                acceleration_m_s2: state.acceleration,
                drag_coefficient: descent.map(|d| d.drag_coefficient(report.force[2])),
                interface_work_j: given,
                energy_error_j: felt - given,
                books,
                balance: stepper.system_balance().copied(),
                coupler_s: (wall_s - report.wall_s.iter().sum::<f64>()).max(0.0),
                wall_s,
                report,
            };
            let place = Place { window: Some((index, 0)), ..self.place() };
            let tolerance = self.scene.coupling.tolerance;
            let said = summary.convergence.add(&place, &row.report, tolerance);
            said.iter().for_each(|text| self.console.warning(text));
            if let Some(text) = books.warning(&self.circumstances(stepper.state(), w.dt)) {
                self.console.warning(&format!("window {index} of stage `{}`: {text}", stage.name));
            }
            if let Some(text) = stepper.warning() {
                self.console.warning(&format!("window {index} of stage `{}`: {text}", stage.name));
            }
            let structure = &row.report.stats[Role::Structure as usize].values;
            let known = summary.structure_energy_created_share;
            if let Some(text) = structure_energy::warning(known, structure) {
                self.console.warning(&format!("window {index} of stage `{}`: {text}", stage.name));
            }
            history.push(&row)?;
            if let Some(iterations) = &mut iterations {
                iterations.push(&row)?;
            }
            if let Some(bounds) = &mut flow_bounds {
                self.check_flow(bounds, &row, w, [&before, &stepper.state().displacement])?;
            }
            summary.add(&row);
            summary.wall_s = wall_before + progress.seconds();
            progress.update(&row);
            done = index + 1;
            let ends = stepper.settled(&row.report);
            let planned = clock.planned();
            let last = ends.is_some() || planned == windows;
            // Pictures are of the planned times.
            if clock.at_planned() || last {
                self.snapshots(partners, &folder, planned, row.time_s, last)?;
            }
            let whole = ends.is_some() || planned == self.windows();
            if let Some(text) = stepper.warning_at_end(&row.report).filter(|_| whole) {
                self.console.warning(&format!("end of stage `{}`: {text}", stage.name));
            }
            if let Some(why) = ends {
                ended = why;
                break;
            }
            if last {
                break;
            }
            let stopped = self.stop.load(Ordering::Relaxed);
            if stopped || saves.due(self.options.checkpoint_every, done) {
                progress.note("saving");
                history.sync()?;
                self.save(
                    partners,
                    stepper.as_ref(),
                    &clock,
                    (books, flow_bounds),
                    summary,
                    done,
                    None,
                    &mut saves,
                )?;
            }
            if stopped {
                return Err(RunError::Interrupted(Place { window: Some((index, 0)), ..self.place() }));
            }
            (index, rejected, start) = (index + 1, 0, Instant::now());
        }
        progress.note("saving");
        history.sync()?;
        summary.ended.clone_from(&ended);
        summary.wall_s = wall_before + progress.seconds();
        self.save(
            partners,
            stepper.as_ref(),
            &clock,
            (books, flow_bounds),
            summary,
            done,
            Some(ended),
            &mut saves,
        )?;
        summary.wall_s = wall_before + progress.seconds();
        saves.tell(self.console, &stage.name, progress.seconds());
        Ok(stepper.state().clone())
    }

    /// Refuses speeds and pressures of the flow that no physics allows in the window of `row`.
    fn check_flow(
        &self,
        bounds: &mut FlowBounds,
        row: &Row,
        w: Window,
        displacement: [&[f64]; 2],
    ) -> Result<(), RunError> {
        let stage = self.description();
        if !stage.kind.roles().contains(&Role::Flow) {
            return Ok(());
        }
        // A march to a steady flow has no time: walls change their speed at once in it.
        let dt = if stage.steady.is_some() { f64::MIN_POSITIVE } else { w.dt };
        let wind = self.scene.wind(self.stage, &self.times());
        let air = flow_bounds::undisturbed_air(&wind, row.time_s, -row.descent_speed_m_s);
        bounds.check(dt, air, displacement, flow_bounds::of_flow(&row.report.stats)).map_err(|flow| {
            let place =
                Place { window: Some((row.window, u64::from(row.report.iterations))), ..self.place() };
            RunError::ImpossibleFlow { place, flow, saved: None }
        })
    }

    /// Says what the pressure on the canopy changes by at the release.
    fn compare_pressures(&self, state: &InterfaceState) {
        let compared = release::pressure_at_release(self.scene, self.stage, self.interface, state);
        match compared.filter(|_| self.resumed.is_none()) {
            Some((text, true)) => self.console.warning(&text),
            Some((text, false)) => self.console.line(&text),
            None => {}
        }
    }

    /// How windows may change their length: not at all where a program or the stage cannot.
    fn adaptive(&self, partners: &dyn Partners) -> Option<&case::AdaptiveWindow> {
        let (stage, coupling) = (self.description(), &self.scene.coupling);
        let staggered = coupling.scheme == Scheme::Staggered;
        // Its flow lives between the ends of windows.
        let offset = staggered && coupling.staggered.sequence == StaggeredSequence::HalfStep;
        let in_time = stage.solve != Solve::Static && stage.steady.is_none();
        let flows = stage.kind.roles().contains(&Role::Flow);
        if !(coupling.adaptive.enabled && in_time && flows) || (offset && stage.kind == StageKind::Coupled) {
            return None;
        }
        let fixed = partners.fixed_windows();
        if !fixed.is_empty() {
            self.console.line(&format!(
                "stage `{}`: windows keep their length, for {} cannot start one again with another (the effect \
                 `coupling.adaptive` is not announced)",
                stage.name,
                fixed.join(" and ")
            ));
            return None;
        }
        Some(&coupling.adaptive)
    }

    fn snapshots(
        &self,
        partners: &mut dyn Partners,
        folder: &Path,
        done: u64,
        time: f64,
        last: bool,
    ) -> Result<(), RunError> {
        let roles = self.description().kind.roles();
        let output = &self.scene.output;
        for (role, every) in
            [(Role::Structure, output.surface_every_windows), (Role::Flow, output.volume_every_windows)]
        {
            let due = every > 0 && (done.is_multiple_of(u64::from(every)) || last);
            if roles.contains(&role) && due {
                partners.snapshot(role, time, folder)?;
            }
        }
        Ok(())
    }

    /// Saves beside the last state, then takes its place, so that a failure
    /// while saving never costs the older one.
    #[allow(clippy::too_many_arguments)]
    fn save(
        &self,
        partners: &mut dyn Partners,
        stepper: &dyn Stepper,
        clock: &WindowClock,
        (books, flow_bounds): (EnergyBooks, Option<FlowBounds>),
        summary: &StageSummary,
        windows: u64,
        ended: Option<String>,
        saves: &mut Saves,
    ) -> Result<(), RunError> {
        let start = Instant::now();
        let target = case::state_folder(self.out, self.scene, self.stage);
        let draft = checkpoint::draft(&target);
        checkpoint::remove(&draft)?;
        std::fs::create_dir_all(&draft).map_err(RunError::file("create", &draft))?;
        let time_s = summary.time_s;
        let written = (|| {
            partners.save(&draft)?;
            results::state::save(&draft, stepper.state())?;
            case::save_time(&draft, time_s).map_err(|(path, e)| RunError::file("write", &path)(e))?;
            let mut so_far = summary.clone();
            so_far.used(&partners.used());
            let progress = checkpoint::Progress {
                windows,
                time_s,
                stepper: stepper.memory(),
                clock: coupling::schemes::pack(clock),
                books,
                flow_bounds,
                summary: so_far,
                speeds: summary.speeds.clone(),
                warnings: self.console.warnings(),
            };
            progress.save(&draft)?;
            let name = self.description().name.as_str();
            let mut seal = Seal::new(self.options.run, (self.stage, name), windows, time_s);
            seal.cannot = partners.cannot_resume();
            if saves.count == 0 && !seal.cannot.is_empty() && ended.is_none() {
                self.console.warning(&format!(
                    "{} cannot go on in the middle of a stage: the run goes on, but could not be resumed",
                    seal.cannot.join(" and ")
                ));
            }
            seal.ended.clone_from(&ended);
            checkpoint::seal(&draft, seal)
        })();
        match written {
            Ok(bytes) => saves.bytes = bytes,
            Err(error) => {
                // Half a state would only fill the disk further. (What other programs still write to it goes at their end.)
                let _ = checkpoint::remove(&draft);
                return Err(error);
            }
        }
        checkpoint::replace(&target)?;
        if ended.is_some() {
            // The stage is over: one state is enough.
            checkpoint::remove(&checkpoint::old(&target))?;
        }
        saves.count += 1;
        saves.last = (Instant::now(), start.elapsed());
        saves.seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    /// A place in this stage for errors.
    pub fn place(&self) -> Place {
        Place { stage: self.description().name.clone(), window: None }
    }
}

/// Saves within a stage that nobody has asked for take no more than this share of its time ...
const SHARE: f64 = 0.01;
/// ... and are at least this far apart.
const APART: Duration = Duration::from_secs(30);

/// What saving has cost.
struct Saves {
    count: u64,
    /// When the last one ended, or the stage began, and what it took.
    last: (Instant, Duration),
    /// Of the last one.
    bytes: u64,
    seconds: f64,
}

impl Default for Saves {
    fn default() -> Self {
        Self { count: 0, last: (Instant::now(), Duration::ZERO), bytes: 0, seconds: 0.0 }
    }
}

impl Saves {
    /// Whether to save now that `done` windows are done. What is computed does not depend on it.
    fn due(&self, every: Option<u64>, done: u64) -> bool {
        let (at, took) = self.last;
        match every {
            Some(0) => false,
            Some(every) => done.is_multiple_of(every),
            None => at.elapsed() >= APART.max(took.div_f64(SHARE)),
        }
    }

    /// Says so, where the stage was saved within too.
    fn tell(&self, console: &Console, stage: &str, all: f64) {
        if self.count > 1 {
            console.line(&format!(
                "stage `{stage}`: saved {} times, {:.1} MB in {:.2} s each, {:.1} % of {all:.1} s",
                self.count,
                self.bytes as f64 / 1e6,
                self.seconds / self.count as f64,
                100.0 * self.seconds / all.max(f64::MIN_POSITIVE)
            ));
        }
    }
}

/// State before the first stage: unstressed canopy, initial speed, no load known.
pub fn initial_state(scene: &Scene, interface: &CanopyInterface) -> InterfaceState {
    InterfaceState {
        load_before: None,
        displacement: vec![0.0; 3 * interface.nodes()],
        load: None,
        velocity: scene.descent.as_ref().map_or(0.0, |d| -d.initial_speed_m_s),
        acceleration: 0.0,
    }
}

/// An answer must hold numbers only: NaN never leaves a program, but a replaced
/// program may not know that.
fn require_finite(who: Role, place: &Place, w: &Window, values: &[f64]) -> Result<(), RunError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(at) => Err(RunError::Fault {
            role: who,
            program: who.program().into(),
            rank: None,
            place: Place { stage: place.stage.clone(), window: Some((w.index, w.iteration)) },
            message: format!("its answer holds {} at position {at}", values[at]),
        }),
    }
}

/// Force of the air in an answer of the flow, N.
fn force(stats: &channel::Stats) -> [f64; 3] {
    std::array::from_fn(|i| stats.values[flow_stats::FORCE + i])
}

#[cfg(test)]
mod tests;
