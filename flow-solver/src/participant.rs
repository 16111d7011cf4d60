//! The flow as the rest of the system sees it.

use std::path::Path;
use std::time::Instant as Clock;

use case::{Flow, Role, Turbulence, Wind};
use channel::{Announcement, Fault, Input, LOAD_WIDTH, Participant, Stats, Window, flow_stats, surface_hash};
use comm::Comm;

use crate::boundary_values::BoundaryValues;
use crate::error::FlowError;
use crate::extreme::Extreme;
use crate::handover;
use crate::loads::{Loads, Total};
use crate::monitors::Monitors;
use crate::physics::{
    EddyViscosity, Gas, IdealGas, Isothermal, Laminar, Turbulent, ViscosityModel, WallTreatment, velocity,
};
use crate::residual::Spatial;
use crate::setup::Setup;
use crate::snapshot::Snapshots;
use crate::solver::{CouplingIterations, Report, Solver, Step};
use crate::state;
use crate::steady::{self, March};
use crate::surface_force::Watched;
use crate::turbulence::{self, SpalartAllmaras};
use crate::warm_start::RankWarmStart;

/// Solves of the first window before the one whose load counts, after a start from an immersed flow. The drag on a canopy at rest, 33 N before, starts with 81, 59, 39,
/// 33, 33 N after 0, 1, 2, 4, 8 of them.
const START_UP_SOLVES: usize = 4;

/// One rank of the flow-solver.
pub struct FlowParticipant<G, const N: usize> {
    solver: Solver<G, N>,
    loads: Loads,
    snapshots: Snapshots,
    monitors: Monitors,
    announcement: Announcement,
    totals: (usize, usize),
    moved: bool,
    wind: Wind,
    march: Option<March>,
    watched: Watched,
    /// Window of the last flow solve that is not accepted yet, and its length, s.
    solved_window: Option<(u64, f64)>,
    /// Unknowns from which the first window after a start from an immersed flow begins, until it is accepted.
    handed_over: Option<Vec<[f64; N]>>,
    /// Why the last flow solve failed.
    failure: Option<Fault>,
    /// Whether the log says that steps end at round-off.
    round_off_reported: bool,
}

/// Creates the participant with the effects that the scene enables. Collective.
///
/// # Errors
/// A grid that cannot be used, a saved state that does not fit.
pub fn participant(setup: &Setup, comm: &Comm) -> Result<Box<dyn Participant>, Fault> {
    let flow = &setup.flow;
    let air = setup.settings.air;
    let viscosity = viscosity(flow);
    Ok(match flow.energy {
        None => Box::new(FlowParticipant::new(setup, comm, Isothermal::new(air), viscosity)?),
        Some(_) => Box::new(FlowParticipant::new(setup, comm, IdealGas::new(air), viscosity)?),
    })
}

/// Viscosity model of a scene.
fn viscosity(flow: &Flow) -> ViscosityModel {
    let Some(v) = &flow.viscosity else { return ViscosityModel::Inviscid };
    let viscosity = v.dynamic_viscosity_pa_s;
    let eddies = match v.turbulence {
        None => return Laminar { viscosity }.into(),
        Some(Turbulence::Smagorinsky) => EddyViscosity::Smagorinsky,
        Some(Turbulence::Wale) => EddyViscosity::Wale,
        Some(Turbulence::SpalartAllmaras | Turbulence::Des97 | Turbulence::Ddes) => {
            EddyViscosity::TransportInput
        }
    };
    let wall = match v.wall_treatment() {
        Some(case::WallTreatment::Automatic) => WallTreatment::Automatic,
        Some(case::WallTreatment::Resolved) | None => WallTreatment::Resolved,
    };
    Turbulent { viscosity, eddies, wall }.into()
}

/// The solver on this rank's part of the grid, in undisturbed air. Collective.
fn started<G: Gas<N>, const N: usize>(
    setup: &Setup,
    comm: &Comm,
    gas: G,
    viscosity: ViscosityModel,
) -> Result<Solver<G, N>, Fault> {
    let topology = setup.topology(comm, viscosity.is_active())?;
    let nodes = topology.node_global.iter().map(|&n| setup.grid.coords[n as usize].into()).collect();
    let limiter = setup.flow.limiter.as_ref().map(|l| l.k);
    let spatial = Spatial {
        gas,
        viscosity,
        chi: if limiter.is_some() { 0.0 } else { 1.0 / 3.0 },
        limiter,
        upwind_share: setup.flow.upwind_share(),
    };
    let mut solver = Solver::new(comm, topology, nodes, spatial, setup.settings).map_err(Fault::new)?;
    if let Some(shear) = &setup.shear {
        solver.set_shear(shear.clone());
    }
    if setup.scene.mesh.outer_boundary == case::OuterBoundary::Sliding {
        let moves = |patch: u16| setup.moved_patches.contains(&setup.grid.patch_names[usize::from(patch)]);
        solver.set_walls_at_rest(|patch| !patch.is_some_and(moves));
    }
    let flow = &setup.flow;
    let (grid, faces) = (&setup.grid, &setup.faces);
    let values =
        BoundaryValues::new(&flow.inlets, &flow.outlets, &flow.moving_walls, grid, faces, &solver.topology);
    if let Some(values) = values.map_err(Fault::new)? {
        solver.set_boundary_values(values).map_err(Fault::new)?;
    }
    if let Some(force) = flow.body_force_n_m3 {
        let mut source = [0.0; N];
        source[1..4].copy_from_slice(&force);
        solver.source = vec![source; solver.topology.n_owned];
    }
    // Where neither the scene nor its patches have a speed.
    solver.set_speed_scale(0.0);
    Ok(solver)
}

/// Transported turbulence model of a scene, if any; `density` is that of the undisturbed air, kg/m3.
fn transported<G: Gas<N>, const N: usize>(
    solver: &Solver<G, N>,
    viscosity: &case::Viscosity,
    density: f64,
) -> SpalartAllmaras {
    let length: turbulence::Length = match viscosity.turbulence {
        Some(Turbulence::Des97) => turbulence::des97,
        Some(Turbulence::Ddes) => turbulence::ddes,
        _ => turbulence::rans,
    };
    SpalartAllmaras::new(&solver.topology, viscosity.dynamic_viscosity_pa_s, density, length)
}

/// Continues from the state in `file`. Collective.
fn restore<G: Gas<N>, const N: usize>(
    solver: &mut Solver<G, N>,
    setup: &Setup,
    file: &Path,
    totals: (usize, usize),
) -> Result<(), Fault> {
    let saved = state::load::<N>(file, &solver.topology, totals)?;
    solver.restore_extras(&saved.extras);
    // A stage of other windows begins with a step of first order: the grid that starts to move
    // there has no step before it, and wall and air must take the same difference.
    let begins = !setup.resumed && (setup.window_s - saved.last_dt).abs() > 1e-9 * setup.window_s;
    let first_order_steps = saved.first_order_steps.max(u32::from(begins));
    solver.restore(saved.previous, saved.last_dt, first_order_steps).map_err(Fault::new)?;
    solver.restore_rhie_chow(&saved.rhie_chow_fluxes);
    Ok(())
}

fn announcement(setup: &Setup, (_, grid_nodes): (usize, usize)) -> Announcement {
    Announcement {
        role: Role::Flow.name().into(),
        program: env!("CARGO_PKG_NAME").into(),
        version: env!("CARGO_PKG_VERSION").into(),
        canopy_nodes: setup.structure.n_canopy as u64,
        canopy_faces: setup.structure.faces.len() as u64,
        surface_hash: surface_hash(&setup.structure.faces),
        grid_nodes: grid_nodes as u64,
        output_width: LOAD_WIDTH as u64,
        effects: [
            channel::RESUME,
            "flow",
            "flow.gust",
            channel::STAGE_WIND,
            channel::GUST_SHAPE,
            channel::GUST_TURBULENCE,
            channel::PERTURBATION,
            channel::STAGE_ALTITUDE,
            channel::LAYERED_TURBULENCE,
            channel::BOUNDARY_VALUES,
            channel::PERIODIC,
            channel::BODY_FORCE,
            "stage.steady",
            "flow.shear",
            "fabric.permeability",
            "canopy.fabric.permeability",
            "flow.viscosity",
            "flow.viscosity.turbulence",
            "flow.viscosity.turbulence.spalart-allmaras",
            "flow.viscosity.turbulence.des",
            "flow.energy",
            "flow.limiter",
            "coupling.adaptive",
        ]
        .map(String::from)
        .to_vec(),
    }
}

impl<G: Gas<N>, const N: usize> FlowParticipant<G, N> {
    /// From a set-up scene. Collective.
    ///
    /// # Errors
    /// A grid that cannot be used, a saved state that does not fit.
    pub fn new(setup: &Setup, comm: &Comm, gas: G, viscosity: ViscosityModel) -> Result<Self, Fault> {
        let totals = (setup.grid.cells.len(), setup.grid.coords.len());
        let mut solver = started(setup, comm, gas, viscosity)?;
        if let Some(v) = setup.flow.viscosity.as_ref().filter(|_| viscosity.transported()) {
            solver.set_turbulence(transported(&solver, v, setup.flow.density_kg_m3));
        }
        if let Some(file) = &setup.handover {
            handover::start_fitted(&mut solver, setup.settings.wind, file)?;
        }
        if let Some(file) = &setup.source {
            restore(&mut solver, setup, file, totals)?;
        }
        let handed_over = setup.handover.as_ref().map(|_| solver.previous[0].q.clone());
        let mut participant = Self {
            loads: Loads::new(&solver),
            monitors: Monitors::new(setup, &solver)?,
            snapshots: Snapshots::default(),
            announcement: announcement(setup, totals),
            solver,
            totals,
            moved: false,
            wind: setup.wind.clone(),
            march: setup.march,
            watched: setup.watched.clone(),
            solved_window: None,
            handed_over,
            failure: None,
            round_off_reported: false,
        };
        if let Some(folder) = setup.source.as_ref().and_then(|f| f.parent()).filter(|_| setup.resumed) {
            participant.restore_state(comm, folder)?;
            participant.snapshots = Snapshots::resume(&setup.folder);
        }
        Ok(participant)
    }

    /// Restores the warm-start data that this rank saved in `folder`. Collective.
    fn restore_state(&mut self, comm: &Comm, folder: &Path) -> Result<(), Fault> {
        match RankWarmStart::load(comm, folder, &self.solver.topology)? {
            Some(memory) => {
                self.monitors.restore_state(memory.probes);
                let file = channel::warm_start_file(folder, Role::Flow, comm.rank(), comm.size());
                let unfit = |reason: String| Fault::new(archive::Error::content(&file, reason));
                self.solver.restore_warm_start(memory.solver).map_err(unfit)?;
            }
            None if comm.is_root() => {
                println!(
                    "the saved state is of another number of ranks: the restart is exact to the tolerance of the solvers"
                );
            }
            None => {}
        }
        Ok(())
    }

    /// Reports a failed flow solve in the statistics. The coupler may retry with a shorter window, or save and end
    /// the run. A failure that a shorter window cannot cure is returned as a fault.
    fn report_failure(
        &mut self,
        w: &Window,
        error: &FlowError,
        output: &mut [f64],
        clock: Clock,
    ) -> Result<Stats, Fault> {
        let mut values = [0.0; channel::STATS];
        values[flow_stats::NO_ANSWER] = match error {
            FlowError::Diverged { .. } => 1.0,
            FlowError::BadState { .. } => 2.0,
            FlowError::InvertedCell { .. } => 3.0,
            FlowError::Unsolved { .. } => 4.0,
            FlowError::BadNode { .. }
            | FlowError::BoundaryValue(_)
            | FlowError::Unsteady { .. }
            | FlowError::Turbulence => 0.0,
        };
        let words = format!("window {} (t = {:.4} s): {error}", w.index, w.time);
        if self.march.is_some() || values[flow_stats::NO_ANSWER] == 0.0 {
            return Err(Fault::new(words));
        }
        if let FlowError::Unsolved { target, .. } = error {
            values[flow_stats::RESIDUAL_TARGET] = *target;
        }
        if let FlowError::Diverged { start, end, iterations }
        | FlowError::Unsolved { start, end, iterations, .. } = error
        {
            values[flow_stats::RESIDUAL_START] = *start;
            values[flow_stats::RESIDUAL_END] = *end;
            values[flow_stats::ITERATIONS] = *iterations as f64;
        }
        for value in values.iter_mut().filter(|value| !value.is_finite()) {
            *value = -1.0;
        }
        if self.solver.comm().is_root() {
            eprintln!("flow-solver: {words}");
        }
        self.failure = Some(Fault::new(words));
        output.fill(0.0);
        Ok(Stats { busy_s: clock.elapsed().as_secs_f64(), values })
    }

    /// Sets the undisturbed velocity at three `times` of the window, s from its start: newest first, as the time difference sees them.
    fn set_wind(&mut self, w: &Window, times: [f64; 3]) {
        self.solver.set_far_field_velocity(times.map(|t| self.wind.at(w.time + t).into()), w.dt);
    }

    /// In the first window after a start from an immersed flow: solves the window [`START_UP_SOLVES`] times, each from the result of the
    /// one before in the wind of its start, so that pressure and velocity become those of the fitted grid around the moving canopy. Their change acts
    /// on no canopy. Collective.
    fn start_up(&mut self, w: &Window, step: &Step) -> Result<(), FlowError> {
        let Some(q) = &self.handed_over else { return Ok(()) };
        self.solver.restart_with(q);
        self.set_wind(w, [0.0; 3]);
        for _ in 0..START_UP_SOLVES {
            self.solver.advance(step)?;
            let solution = self.solver.q.clone();
            self.solver.restart_with(&solution);
        }
        Ok(())
    }

    /// Says once in a stage that the tolerances ask for less than round-off.
    fn report_round_off(&mut self, report: &Report) {
        if let Some(residual) = report.round_off.filter(|_| !self.round_off_reported) {
            self.round_off_reported = true;
            if self.solver.comm().is_root() {
                eprintln!(
                    "flow-solver: flow.solver.residual_drop asks for less than round-off: steps end at a residual of {residual:.1e} N"
                );
            }
        }
    }

    /// Says how far the first cells are from no-slip walls, where turbulence is modelled. Collective.
    fn report_wall_units(&self) {
        if !matches!(self.solver.spatial.viscosity, ViscosityModel::Turbulent(_)) {
            return;
        }
        let units = self.solver.wall_units();
        if let (true, Some([median, largest])) = (self.solver.comm().is_root(), units) {
            println!("y+ of the first cells at no-slip walls: median {median:.1}, largest {largest:.1}");
        }
    }

    fn stats(&self, total: &Total, report: &Report, dt: f64) -> [f64; channel::STATS] {
        let s = &self.solver;
        let comm = s.comm();
        let (mut mach, mut pressure) = (Extreme::default(), Extreme::default());
        let (mut courant, mut high, mut low) = (0.0f64, f64::MIN, f64::MAX);
        let cells = s.q[..s.topology.n_owned].iter().zip(&s.metrics.size);
        for (cell, (q, h)) in cells.enumerate() {
            let speed = (velocity(q) - s.scheme.frame).norm();
            mach.compare(speed * speed / s.spatial.gas.sound_speed_squared(q), cell);
            pressure.compare(q[0].abs(), cell);
            courant = courant.max(speed * dt / h);
            high = high.max(q[0]);
            low = low.min(q[0]);
        }
        let (mach, mach_at) = mach.over_ranks(comm, &s.metrics.centre);
        let (_, pressure_at) = pressure.over_ranks(comm, &s.metrics.centre);
        let mut values = [0.0; channel::STATS];
        values[flow_stats::FORCE..][..3].copy_from_slice(total.force.as_slice());
        values[flow_stats::MOMENT..][..3].copy_from_slice(total.moment.as_slice());
        values[flow_stats::RESIDUAL_START] = report.start;
        values[flow_stats::RESIDUAL_END] = report.end;
        values[flow_stats::ITERATIONS] = report.iterations as f64;
        values[flow_stats::LINEAR_ITERATIONS] = report.linear_iterations as f64;
        values[flow_stats::MAX_MACH] = mach.sqrt();
        values[flow_stats::MAX_MACH_AT..][..3].copy_from_slice(&mach_at);
        values[flow_stats::EXTREME_PRESSURE_AT..][..3].copy_from_slice(&pressure_at);
        values[flow_stats::MAX_COURANT] = comm.max(courant);
        values[flow_stats::MAX_PRESSURE] = comm.max(high);
        values[flow_stats::MIN_PRESSURE] = comm.min(low);
        values[flow_stats::MASS_DEFECT] = report.mass_defect;
        values[flow_stats::RESIDUAL_TARGET] = report.target;
        values[flow_stats::UNCONVERGED] = f64::from(u8::from(!report.met));
        values[flow_stats::CELL_ERROR] = report.cell.share;
        values[flow_stats::CELL_ERROR_TARGET] = report.cell.allowed;
        values[flow_stats::CELL_ERROR_AT..][..3].copy_from_slice(&report.cell.at);
        values[flow_stats::TURBULENCE_RESIDUAL] = s.turbulence_excess();
        values
    }
}

impl<G: Gas<N>, const N: usize> Participant for FlowParticipant<G, N> {
    fn announce(&self) -> Announcement {
        self.announcement.clone()
    }

    fn description(&self) -> Vec<String> {
        let s = &self.solver;
        let (cells, nodes) = self.totals;
        let moves = if s.settings.moving { "moves with the canopy" } else { "is fixed" };
        let repeated = s.settings.coupling.map_or_else(String::new, |c| {
            let CouplingIterations { drop, sufficient } = c;
            format!(", in repeated solves of a window {drop:.1e}, or to {sufficient:.1e} of the residual at its start")
        });
        vec![
            format!(
                "fitted grid of {cells} cells and {nodes} nodes that {moves}; {} cells on this rank",
                s.topology.n_owned
            ),
            format!(
                "{:?}; {:?}; residual drop {:.1e}{repeated}, at most {} iterations",
                s.spatial.viscosity, s.settings.method, s.settings.residual_drop, s.settings.max_iterations
            ),
        ]
    }

    fn output_rows(&self) -> Vec<u64> {
        self.solver.topology.canopy.owned().to_vec()
    }

    fn grid_rows(&self) -> Vec<u64> {
        self.solver.topology.node_global.clone()
    }

    fn waited_s(&self) -> f64 {
        self.solver.comm().waited_s()
    }

    fn advance(&mut self, w: &Window, input: &Input<'_>, output: &mut [f64]) -> Result<Stats, Fault> {
        let _part = timing::part("advance");
        let clock = Clock::now();
        self.moved = !input.grid.is_empty();
        if self.moved && !self.solver.settings.moving {
            return Err(Fault::new(
                "this stage runs the flow on a fixed grid, but received a moving grid; use a stage kind with grid motion",
            ));
        }
        if self.moved {
            let s = &mut self.solver;
            for (i, (x, v)) in s.nodes.iter_mut().zip(&mut s.node_velocity).enumerate() {
                let row = input.grid.row(i);
                x.copy_from_slice(&row[..3]);
                v.copy_from_slice(&row[3..]);
            }
        }
        let repeat = self.solved_window == Some((w.index, w.dt));
        let frame = w.frame_velocity.into();
        let step = Step { dt: w.dt, frame, repeat, moved: self.moved };
        (self.solved_window, self.failure) = (None, None);
        self.solver.set_boundary_time(w.time + w.dt);
        let started = if repeat { Ok(()) } else { self.start_up(w, &step) };
        self.set_wind(w, [w.dt, 0.0, -self.solver.step_before(w.dt)]);
        let outcome = match &self.march {
            None => started
                .and_then(|()| self.solver.advance(&step))
                .map(|report| (self.watched.compute(&self.solver, &mut self.loads), report)),
            Some(march) => {
                steady::solve_window(march, &mut self.solver, &mut self.loads, &self.watched, frame)
            }
        };
        let (total, report) = match outcome {
            Ok(answer) => answer,
            Err(error) => return self.report_failure(w, &error, output, clock),
        };
        let owned = &self.loads.faces[..self.solver.topology.canopy.n_owned];
        output.copy_from_slice(owned.as_flattened());
        self.report_round_off(&report);
        let values = self.stats(&total, &report, w.dt);
        let finite = output.iter().chain(&values).all(|x| x.is_finite());
        if !self.solver.comm().all(finite) {
            return Err(Fault::new(format!(
                "window {}: the load on the canopy is not a finite number; check the residuals of the flow",
                w.index
            )));
        }
        self.solved_window = Some((w.index, w.dt));
        Ok(Stats { busy_s: clock.elapsed().as_secs_f64(), values })
    }

    fn accept(&mut self, w: &Window) -> Result<(), Fault> {
        let _part = timing::part("accept");
        if self.solved_window.take().is_none_or(|(index, _)| index != w.index) {
            let none = || Fault::new(format!("window {} was accepted before it was solved", w.index));
            return Err(self.failure.take().unwrap_or_else(none));
        }
        self.handed_over = None;
        // A march has accepted its steps.
        if self.march.is_none() {
            self.solver.accept(w.dt, self.moved);
        }
        self.monitors.record(&self.solver, &self.loads, w, self.moved)
    }

    fn save(&mut self, folder: &Path) -> Result<(), Fault> {
        let _part = timing::part("save");
        self.report_wall_units();
        let s = &self.solver;
        let file = case::state_file(folder, Role::Flow);
        if let Some(statistics) = self.monitors.statistics() {
            statistics.save(folder, s.comm(), &s.topology, self.totals.0)?;
        }
        RankWarmStart { solver: s.warm_start(), probes: self.monitors.probes() }.save(s.comm(), folder)?;
        s.save(&file, self.totals)
    }

    fn snapshot(&mut self, time: f64, folder: &Path) -> Result<(), Fault> {
        let _part = timing::part("snapshot");
        self.snapshots.write(&self.solver, time, folder, self.monitors.statistics())
    }
}
