//! The stages of a run: window after window ([`stage_run`]), whatever runs in them.

mod coupled;
mod flow_only;
mod pre_inflation;
mod prescribed;
mod saves;
mod single;
mod stage_run;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use case::{DescentEquation, Role, Scene, Scheme, Solve, Stage, StageKind, StageTimes, StaggeredSequence};
use channel::Window;
use coupling::balance::SystemBalance;
use coupling::convergence::AcceptanceCheck;
use coupling::descent::DescentModel;
use coupling::energy::EnergyWarningContext;
use coupling::error::{Location, RunError};
use coupling::interface::CanopyInterface;
use coupling::partners::Partners;
use coupling::release::pressure_at_release;
use coupling::schemes::{InterfaceState, WindowReport};
use results::checkpoint;
use results::summary::StageSummary;
use terminal::Console;

use self::coupled::Coupled;
use self::flow_only::FlowOnly;
use self::pre_inflation::PreInflation;
use self::prescribed::Prescribed;
use self::single::SingleSolve;
use self::stage_run::StageRun;

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
    /// The checkpoint that the stage restarts from, if any.
    pub resumed: Option<&'a checkpoint::Progress>,
}

/// What differs between the kinds of stages: how one window is computed.
trait Stepper {
    /// Computes and accepts a window. After an error that [`RunError::is_retryable`] the same window may be
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
    fn save_state(&self) -> Vec<u8>;

    /// Restarts from a [`Stepper::save_state`] of the same stage.
    ///
    /// # Errors
    /// A memory of another one.
    fn restore_state(&mut self, memory: &[u8]) -> Result<(), RunError>;

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

    /// Work in the last window, J: received by the structure, given by the flow. `None` where
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
    fn judge(&self) -> AcceptanceCheck {
        let accept_unconverged = self.options.accept_unconverged;
        AcceptanceCheck { stage: self.description().name.clone(), accept_unconverged }
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
        error.with_advice(
            "The coupling is staggered, which is unstable where the fabric is light beside the air that it moves, at any \
             window_s. Remedy: coupling.scheme = \"implicit\"",
        )
    }

    /// What the remedy of an energy warning depends on, at the end of a window of `window_s` seconds.
    fn circumstances(&self, state: &InterfaceState, window_s: f64) -> EnergyWarningContext {
        let wind = self.scene.resolved().wind_m_s;
        let speed = (wind[0] * wind[0] + wind[1] * wind[1] + (wind[2] - state.velocity).powi(2)).sqrt();
        EnergyWarningContext {
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
        let mut run = StageRun::open(self, partners, state, summary)?;
        while run.continues() {
            let Some(stepped) = run.step()? else { continue };
            let row = run.record(stepped)?;
            if run.ends(&row)? {
                break;
            }
            run.checkpoint()?;
        }
        run.close()
    }

    /// Says what the pressure on the canopy changes by at the release.
    fn compare_pressures(&self, state: &InterfaceState) {
        let compared = pressure_at_release(self.scene, self.stage, self.interface, state);
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
        let offset = staggered && coupling.staggered.sequence == StaggeredSequence::ImprovedSerial;
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

    /// A place in this stage for errors.
    pub fn place(&self) -> Location {
        Location { stage: self.description().name.clone(), window: None }
    }
}

/// What computes the windows of this kind of stage.
fn stepper<'c>(
    context: &'c StageContext<'c>,
    partners: &dyn Partners,
    state: InterfaceState,
) -> Result<Box<dyn Stepper + 'c>, RunError> {
    Ok(match context.description().kind {
        StageKind::PreInflation => {
            let questions = PreInflation::new(context, &state)?;
            Box::new(SingleSolve::new(context, state, questions))
        }
        StageKind::FlowOnly => Box::new(SingleSolve::in_flow(context, state, FlowOnly)),
        StageKind::Coupled => Box::new(Coupled::new(context, state, context.descent_of(partners))),
        StageKind::Prescribed => {
            let questions = Prescribed::new(context, &state)?;
            Box::new(SingleSolve::in_flow(context, state, questions))
        }
    })
}

/// An answer must hold numbers only: NaN never leaves a program, but a replaced
/// program may not know that.
fn require_finite(who: Role, place: &Location, w: &Window, values: &[f64]) -> Result<(), RunError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(at) => Err(RunError::Fault {
            role: who,
            program: who.program().into(),
            rank: None,
            place: Location { stage: place.stage.clone(), window: Some((w.index, w.iteration)) },
            message: format!("its answer holds {} at position {at}", values[at]),
        }),
    }
}
