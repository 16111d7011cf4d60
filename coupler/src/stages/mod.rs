//! The stages of a run. `stage_run` advances the windows; a `Stepper` for each kind of stage computes them.

mod coupled;
mod flow_only;
mod pre_inflation;
mod prescribed;
mod saves;
mod single;
mod stage_row;
mod stage_run;
mod trajectory;

use std::path::Path;
use std::sync::atomic::AtomicBool;

use case::{
    ALTITUDES, DescentEquation, Role, Scene, Scheme, Solve, Stage, StageKind, StageTimes, StaggeredSequence,
    StandardAir,
};
use channel::Window;
use coupling::balance::SystemBalance;
use coupling::convergence::AcceptanceCheck;
use coupling::descent::DescentModel;
use coupling::energy::EnergyWarningContext;
use coupling::energy_limit::EnergyLimit;
use coupling::error::{Location, RunError};
use coupling::interface::CanopyInterface;
use coupling::partners::Partners;
use coupling::release::pressure_at_release;
use coupling::schemes::{InterfaceState, WindowReport};
use mesh::geometry::Vec3;
use results::checkpoint;
use results::summary::StageSummary;
use terminal::Console;

use self::coupled::Coupled;
use self::flow_only::FlowOnly;
use self::pre_inflation::PreInflation;
use self::prescribed::Prescribed;
use self::single::SingleSolve;
use self::stage_run::StageRun;
use self::trajectory::TrajectoryStage;

/// Difference of the density from that at the height of a stage, as a share, that is reported: half of it changes the speed.
const DENSITY_SHARE: f64 = 0.01;

/// Options of a stage.
#[derive(Clone, Debug, Default)]
pub struct StageOptions {
    /// Maximum number of windows.
    pub stop_after_windows: Option<u64>,
    /// Accepts windows that are not converged.
    pub accept_unconverged: bool,
    /// Windows between checkpoints within the stage; 0: none. `None`: an interval of small cost.
    pub checkpoint_every: Option<u64>,
    /// Identity of the run in its saved states.
    pub run: u64,
}

/// Input of a stage.
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
    /// Output of messages.
    pub console: &'a Console,
    /// Ends the stage at the end of a window when it becomes true.
    pub stop: &'a AtomicBool,
    /// Altitude of the release, m, where the air is that of one.
    pub altitude_of_release: Option<f64>,
    /// The checkpoint that the stage restarts from, if any.
    pub resumed: Option<&'a checkpoint::Progress>,
}

/// Computation of one window, for each kind of stage.
trait Stepper {
    /// Computes and accepts a window. After an error that [`RunError::is_retryable`] the window may be
    /// retried with another length; `shorter`: a retry with half the length is possible.
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        w: Window,
        shorter: bool,
    ) -> Result<WindowReport, RunError>;

    /// Values at the end of the last accepted window.
    fn state(&self) -> &InterfaceState;

    /// The reason to end the stage early, if it has settled.
    fn settled(&self, report: &WindowReport) -> Option<String> {
        let _ = report;
        None
    }

    /// All data that later windows depend on.
    fn save_state(&self) -> Vec<u8>;

    /// Restores the result of [`Stepper::save_state`] of the same stage.
    ///
    /// # Errors
    /// Data of another stage.
    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError>;

    /// A warning at the end of the stage, whose last window is this one.
    fn warning_at_end(&self, _report: &WindowReport) -> Option<String> {
        None
    }

    /// A warning after the last window.
    fn warning(&mut self) -> Option<String> {
        None
    }

    /// Balance of momentum and energy of the descending system. `None` without descent.
    fn system_balance(&self) -> Option<&SystemBalance> {
        None
    }

    /// Velocity of the undisturbed air relative to the frame at `t` (s), m/s, in a stage that knows it at the height of the frame.
    fn air(&self, _t: f64) -> Option<[f64; 3]> {
        None
    }

    /// The stage is complete: its state becomes what the next stage starts from.
    fn close(&mut self) {}

    /// Interface work in the last window, J: on the structure, by the flow. `None` without
    /// coupling.
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

    /// Durations of the earlier stages.
    pub fn times(&self) -> StageTimes {
        StageTimes::completed(self.scene, self.out, self.stage)
    }

    /// The check that refuses windows that are not converged.
    fn acceptance_check(&self) -> AcceptanceCheck {
        let accept_unconverged = self.options.accept_unconverged;
        AcceptanceCheck { stage: self.description().name.clone(), accept_unconverged }
    }

    /// Whether the structure starts from a coupled stage; otherwise the canopy was fixed until this stage.
    fn structure_was_coupled(&self) -> bool {
        let source = self.scene.source_stage(self.stage, Role::Structure);
        source.is_some_and(|k| self.scene.stages[k].kind == StageKind::Coupled)
    }

    /// The descent equation of the scene, if it has one.
    pub fn descent(&self) -> Option<DescentModel> {
        DescentModel::of(self.scene, self.interface)
    }

    /// Adds advice to the error of a window: a staggered scheme may be unstable.
    fn advise(&self, error: RunError) -> RunError {
        let stage = self.description();
        if stage.kind != StageKind::Coupled || self.scene.coupling.scheme != Scheme::Staggered {
            return error;
        }
        error.with_advice(
            "The coupling is staggered, which is unstable at any window_s where the added mass of the air exceeds the mass \
             of the fabric. Remedy: coupling.scheme = \"implicit\"",
        )
    }

    /// Quantities that select the remedy of an energy warning, after a window of `window_s` seconds.
    fn warning_context(&self, state: &InterfaceState, window_s: f64) -> EnergyWarningContext {
        let stream = Vec3::from(self.scene.resolved().wind_m_s) - Vec3::from(state.velocity);
        EnergyWarningContext {
            staggered: self.scene.coupling.scheme == Scheme::Staggered,
            tolerance: self.scene.coupling.tolerance,
            window_s,
            passage_s: self.interface.sizes.fabric_area.sqrt() / stream.norm(),
        }
    }

    /// The descent equation that the programs of the stage support.
    fn descent_of(&self, partners: &dyn Partners) -> Option<DescentModel> {
        let mut model = self.descent()?;
        let Some(who) = partners.without_support_force() else { return Some(model) };
        model.support_known = false;
        if model.equation == DescentEquation::Momentum {
            self.console.warning(&format!(
                "stage `{}`: descent.equation = \"momentum\" is replaced by \"quasi-steady\": {who} does not report the mean \
                 force on the payload (effect `{}`). The frame then accelerates with the force of the air on the \
                 canopy, which is inaccurate while the canopy accelerates relative to the payload",
                self.description().name,
                channel::SUPPORT_FORCE
            ));
            model.equation = DescentEquation::QuasiSteady;
        }
        Some(model)
    }

    /// Runs the stage from `state`, saves its final state and returns it. Results before an
    /// error remain, in files and in `summary`.
    ///
    /// # Errors
    /// Any error that ends the run early.
    pub fn run(
        &self,
        partners: &mut dyn Partners,
        state: InterfaceState,
        summary: &mut StageSummary,
    ) -> Result<InterfaceState, RunError> {
        let mut run = StageRun::open(self, partners, state, summary)?;
        while run.continues() {
            let Some(accepted) = run.step()? else { continue };
            let row = run.record(accepted)?;
            if run.ends(&row)? {
                break;
            }
            run.checkpoint()?;
        }
        run.close()
    }

    /// Warns of a stage whose density is not that of the standard atmosphere at the height at which it starts, after a fall.
    fn compare_density(&self, state: &InterfaceState) {
        let (scene, stage) = (self.scene, self.description());
        let flows = stage.kind.roles().contains(&Role::Flow);
        let Some(flow) = scene.flow.as_ref().filter(|_| flows && self.resumed.is_none()) else { return };
        let Some((own, release)) = flow.altitude_m.zip(self.altitude_of_release) else { return };
        let at = |altitude: f64| StandardAir::at(altitude).density_kg_m3;
        let here = release + state.position[2];
        let share = at(own) / at(here.clamp(*ALTITUDES.start(), *ALTITUDES.end())) - 1.0;
        if share.abs() > DENSITY_SHARE {
            self.console.warning(&format!(
                "stage `{}`: the air is that of {own:.0} m, but the frame is at {here:.0} m, where the density differs by {:+.1} %. Remedy: \
                 altitude_m = {here:.0} in this stage",
                stage.name,
                -100.0 * share
            ));
        }
    }

    /// Reports the jump of the pressure on the canopy at the release.
    fn compare_pressures(&self, state: &InterfaceState) {
        let compared = pressure_at_release(self.scene, self.stage, self.interface, state);
        match compared.filter(|_| self.resumed.is_none()) {
            Some((text, true)) => self.console.warning(&text),
            Some((text, false)) => self.console.line(&text),
            None => {}
        }
    }

    /// Adaptation of the window length. `None` where a program or the stage does not support it.
    fn adaptive(&self, partners: &dyn Partners) -> Option<&case::AdaptiveWindow> {
        let (stage, coupling) = (self.description(), &self.scene.coupling);
        let staggered = coupling.scheme == Scheme::Staggered;
        // The flow of that scheme is offset by half a window.
        let offset = staggered && coupling.staggered.sequence == StaggeredSequence::ImprovedSerial;
        let in_time = stage.solve != Solve::Static && stage.steady.is_none();
        let flows = stage.kind.roles().contains(&Role::Flow);
        if !(coupling.adaptive.enabled && in_time && flows) || (offset && stage.kind == StageKind::Coupled) {
            return None;
        }
        let fixed = partners.fixed_windows();
        if !fixed.is_empty() {
            self.console.line(&format!(
                "stage `{}`: fixed window length, since {} cannot retry a window with another length (does not announce \
                 the effect `coupling.adaptive`)",
                stage.name,
                fixed.join(" and ")
            ));
            return None;
        }
        Some(&coupling.adaptive)
    }

    /// Limit of the window length by the energy that the coupling creates. Windows of a staggered scheme are no remedy for
    /// the energy that it creates.
    fn energy_limit(&self, adaptive: Option<&case::AdaptiveWindow>) -> EnergyLimit {
        let iterates = self.scene.coupling.scheme == Scheme::Implicit;
        let adaptive = adaptive.filter(|_| iterates && self.description().kind == StageKind::Coupled);
        adaptive.map_or_else(EnergyLimit::none, |a| EnergyLimit::new(a.energy_limit, a.halvings))
    }

    /// The location of this stage, for errors.
    pub fn place(&self) -> Location {
        Location { stage: self.description().name.clone(), window: None }
    }
}

/// The stepper for this kind of stage.
fn stepper<'c>(
    context: &'c StageContext<'c>,
    partners: &dyn Partners,
    state: InterfaceState,
) -> Result<Box<dyn Stepper + 'c>, RunError> {
    Ok(match context.description().kind {
        StageKind::PreInflation => {
            let solver = PreInflation::new(context, &state)?;
            Box::new(SingleSolve::new(context, state, solver))
        }
        StageKind::Trajectory => Box::new(TrajectoryStage::new(context, state)?),
        StageKind::FlowOnly => Box::new(SingleSolve::in_flow(context, state, FlowOnly)),
        StageKind::Coupled => Box::new(Coupled::new(context, state, context.descent_of(partners))),
        StageKind::Prescribed => {
            let solver = Prescribed::new(context, &state)?;
            Box::new(SingleSolve::in_flow(context, state, solver))
        }
    })
}

/// Checks that a reply is finite. The project's programs never send NaN; a replaced
/// program may.
fn require_finite(who: Role, place: &Location, w: &Window, values: &[f64]) -> Result<(), RunError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(at) => Err(RunError::Fault {
            role: who,
            program: who.program().into(),
            rank: None,
            place: Location { stage: place.stage.clone(), window: Some((w.index, w.iteration)) },
            message: format!("value {at} of its reply is {}", values[at]),
        }),
    }
}
