//! Coupled stage: structure, mesh, flow and descent (paper, section 5.2).

use case::{AirMotion, LoadShape, Role, Scheme};
use channel::{Window, structure_stats};
use coupling::assembly::CoupledStage;
use coupling::balance::{SystemBalance, WindowTerms};
use coupling::descent::{DescentModel, Weight};
use coupling::descent_limits::Limits;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowLoop, WindowReport, pack, unpack};
use mesh::geometry::Vec3;

use super::{StageContext, Stepper};

pub(super) struct Coupled<'a> {
    interface: &'a CanopyInterface,
    windows: WindowLoop,
    /// The undisturbed air, for the drag of a payload that moves with the frame.
    undisturbed: AirMotion,
    /// Height of the release above ground, m; zero where the wind is the same at all heights.
    release_m: f64,
    start: Vec<f64>,
    /// Interface work of the last window, J: on the structure, by the flow.
    work: (f64, f64),
    descent: Option<DescentModel>,
    balance: SystemBalance,
    /// The load at the end of a window acts on the structure throughout it.
    load_is_constant: bool,
    /// Pending warning of an upward acceleration that the line forces cannot cause.
    rise: Option<String>,
    rise_reported: bool,
}

impl<'a> Coupled<'a> {
    pub(super) fn new(
        context: &StageContext<'a>,
        state: InterfaceState,
        descent: Option<DescentModel>,
    ) -> Self {
        let undisturbed = context.scene.air_motion(context.stage, &context.times());
        let start = state.displacement.clone();
        let stage = CoupledStage {
            scene: context.scene,
            stage: context.stage,
            interface: context.interface,
            descent,
            wind_m_s: undisturbed.wind().steady(),
            accept_unconverged: context.options.accept_unconverged,
        };
        let (windows, lines) = stage.window_loop(state);
        lines.iter().for_each(|line| context.console.line(line));
        let windows = if context.structure_was_coupled() { windows } else { windows.from_held() };
        Self {
            interface: context.interface,
            windows,
            undisturbed,
            release_m: context.scene.release_height().unwrap_or(0.0),
            start,
            work: (0.0, 0.0),
            descent,
            balance: SystemBalance::default(),
            load_is_constant: context.scene.coupling.scheme == Scheme::Implicit
                && context.scene.load_shape() == LoadShape::Constant,
            rise: None,
            rise_reported: false,
        }
    }

    /// Adds the last window, with initial `velocity` (m/s) and force `before` of the load at its start (N), to the system balance. A load that is constant over the window
    /// acts on faces that turn and grow in it.
    fn add_to_balance(&mut self, report: &WindowReport, dt: f64, velocity: [f64; 3], before: Option<Vec3>) {
        // The energy of a payload that moves in the frame is in no statistic.
        let Some(model) = self.descent.filter(|d| d.weight != Weight::Body) else { return };
        let state = self.windows.state();
        let stats = &report.stats[Role::Structure as usize];
        let forces = report.forces(state.acceleration);
        if model.support_known && !self.rise_reported {
            self.rise = Limits::of(&model, state.acceleration, state.velocity, &forces).upward();
        }
        let lines = model.air_on_lines(stats);
        let load = state.load.as_deref().unwrap_or(&[]);
        let end = self.interface.force(load, &state.displacement);
        let before =
            if self.load_is_constant { Some(self.interface.force(load, &self.start)) } else { before };
        let terms = WindowTerms {
            dt,
            velocity: [velocity.into(), state.velocity.into()],
            air: [before.unwrap_or(end) + lines, end + lines],
            drag: model.payload_drag.map_or(Vec3::zeros(), |d| d.force(state.velocity.into())),
            support: model.support(&forces).0,
            momentum: Vec3::from_column_slice(&stats.values[structure_stats::MOMENTUM..][..3]),
            work: self.work.1,
            prescribed_work: stats.values[structure_stats::PRESCRIBED_WORK],
            energy: [
                stats.values[structure_stats::KINETIC_ENERGY],
                stats.values[structure_stats::STRAIN_ENERGY],
            ],
        };
        self.balance.add_window(&model, &terms);
    }
}

impl Stepper for Coupled<'_> {
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        w: Window,
        shorter: bool,
    ) -> Result<WindowReport, RunError> {
        let state = self.windows.state();
        self.start.copy_from_slice(&state.displacement);
        let velocity = state.velocity;
        // The supports carry the load of a canopy that was fixed until now.
        let known = state.load.as_ref().filter(|_| !self.windows.released());
        let before = known.map(|load| self.interface.force(load, &self.start));
        // The height at the end of the window, but for the change of the speed in it.
        let height = self.release_m + state.position[2] + velocity[2] * w.dt;
        self.windows.set_wind(self.undisturbed.at(w.time + w.dt).over_ground(height));
        let report = self.windows.run(partners, w, shorter)?;
        let state = self.windows.state();
        let load = state.load.as_deref().unwrap_or(&[]);
        let on_structure = report.stats[Role::Structure as usize].values[structure_stats::LOAD_WORK];
        self.work = (on_structure, self.interface.work(load, &self.start, &state.displacement));
        self.add_to_balance(&report, w.dt, velocity, before);
        Ok(report)
    }

    fn save_state(&self) -> Vec<u8> {
        pack(&(self.windows.save_state(), &self.balance))
    }

    fn restore_state(&mut self, saved: &[u8]) -> Result<(), RunError> {
        let windows: Vec<u8>;
        (windows, self.balance) = unpack(saved)?;
        self.windows.restore_state(&windows)
    }

    fn warning(&mut self) -> Option<String> {
        if let Some(text) = self.rise.take() {
            self.rise_reported = true;
            return Some(text);
        }
        let known = self.descent.is_some_and(|d| d.support_known && d.weight != Weight::Body);
        if known { self.balance.warning() } else { None }
    }

    fn system_balance(&self) -> Option<&SystemBalance> {
        self.descent.filter(|d| d.support_known && d.weight != Weight::Body).map(|_| &self.balance)
    }

    fn state(&self) -> &InterfaceState {
        self.windows.state()
    }

    fn interface_work(&self) -> Option<(f64, f64)> {
        Some(self.work)
    }
}
