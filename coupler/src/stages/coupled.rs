//! Structure, mesh, flow and descent together (paper, section 5.2).

use case::{Acceleration, Coupling, CouplingOrder, LoadShape, Role, Scheme, Wind};
use channel::{LOAD_WIDTH, Window, structure_stats};
use coupling::balance::{SystemBalance, WindowTerms};
use coupling::descent::{DescentModel, Weight};
use coupling::descent_limits::Limits;
use coupling::error::RunError;
use coupling::interface::CanopyInterface;
use coupling::partners::Partners;
use coupling::schemes::{
    AddedMassRelaxation, Air, Criterion, Field, FlowModel, InterfaceState, JacobiRelaxation, Lattice,
    MEAN_WEIGHTS, Modelled, Relaxation, SAFE_DENSITY, Uniform, Unknowns, Weights, WindowLoop,
    WindowLoopSetup, WindowReport, accelerator, needs_model, pack, unpack, window_loop,
};

use super::floors::{SHAPE_FLOOR, load_floor, load_scale, speed_floor};
use super::{StageContext, Stepper};

pub(super) struct Coupled<'a> {
    interface: &'a CanopyInterface,
    windows: WindowLoop,
    /// The undisturbed air, which a payload that falls with the frame meets.
    wind: Wind,
    start: Vec<f64>,
    /// Felt by the structure, given by the flow.
    work: (f64, f64),
    descent: Option<DescentModel>,
    balance: SystemBalance,
    /// What is to be reported once: a frame that rises faster than its lines pull.
    rise: Option<String>,
    rise_reported: bool,
}

impl<'a> Coupled<'a> {
    pub(super) fn new(
        context: &StageContext<'a>,
        state: InterfaceState,
        descent: Option<DescentModel>,
    ) -> Self {
        let scene = context.scene;
        let stage = context.description();
        let dt = stage.window_s;
        let unknowns = Unknowns::new(context.interface.nodes(), dt, descent.is_some());
        let air = scene.wind(context.stage, &context.times());
        let wind = air.steady();
        let speed = (wind[0] * wind[0] + wind[1] * wind[1] + (wind[2] - state.velocity).powi(2)).sqrt();
        let moved = unknowns.displacements();
        let root = (context.interface.nodes() as f64).sqrt();
        let interface = context.interface;
        let pressure = load_scale(scene, context.stage, interface, &state, speed);
        let load = load_floor(scene, interface, &state, [pressure, dt, response(&scene.coupling)]);
        let mut fields = vec![Field { load, ..Field::new(0..moved, SHAPE_FLOOR * speed * dt * root) }];
        if descent.is_some() {
            let floor = speed_floor(scene, interface, pressure, dt) * unknowns.velocity_scale();
            fields.push(Field::new(moved..moved + 1, floor));
        }
        let motion = unknowns;
        let unknowns = with_loads(context, unknowns, &mut fields);
        let criterion = Criterion::new(fields, scene.coupling.tolerance);
        let start = state.displacement.clone();
        let lattice = lattice(context, &state);
        let added = lattice.as_ref().and_then(|lattice| added_mass(context, motion, lattice));
        let modelled = modelled(context, motion, &state, lattice.as_ref(), added.clone());
        let rest = relaxation(context, unknowns, added);
        let windows = window_loop(WindowLoopSetup {
            stage: &stage.name,
            coupling: &scene.coupling,
            unknowns,
            criterion,
            faces: context.interface.faces.len(),
            descent,
            interface: state,
            relaxation: rest,
            modelled,
            accept_unconverged: context.options.accept_unconverged,
        });
        let windows = if context.structure_was_coupled() { windows } else { windows.from_held() };
        Self {
            interface: context.interface,
            windows,
            wind: air,
            start,
            work: (0.0, 0.0),
            descent,
            balance: SystemBalance::default(),
            rise: None,
            rise_reported: false,
        }
    }

    /// Adds the last window, which began with `velocity` (m/s) and the load `before`, to the balance of the system.
    fn enter_balance(&mut self, report: &WindowReport, dt: f64, velocity: f64, before: Option<f64>) {
        // A payload that moves in the frame has energy that no statistic tells.
        let Some(model) = self.descent.filter(|d| d.weight != Weight::Body) else { return };
        let state = self.windows.state();
        let stats = &report.stats[Role::Structure as usize];
        let forces = report.forces(state.acceleration);
        if model.support_known && !self.rise_reported {
            self.rise = Limits::of(&model, state.acceleration, state.velocity, &forces).upward();
        }
        let lines = if model.drag_in_structure { stats.values[structure_stats::AIR_FORCE] } else { 0.0 };
        let end = self.interface.vertical_force(state.load.as_deref().unwrap_or(&[]), &state.displacement);
        let terms = WindowTerms {
            dt,
            velocity: [velocity, state.velocity],
            air: [before.unwrap_or(end) + lines, end + lines],
            drag: model.payload_drag.map_or(0.0, |d| d.force(state.velocity)),
            support: model.support(&forces).0,
            momentum: stats.values[structure_stats::VERTICAL_MOMENTUM],
            work: self.work.1,
            energy: [
                stats.values[structure_stats::KINETIC_ENERGY],
                stats.values[structure_stats::STRAIN_ENERGY],
            ],
        };
        self.balance.enter(&model, &terms);
    }
}

/// The canopy's positions in `state`, m.
fn positions(context: &StageContext<'_>, state: &InterfaceState) -> Vec<mesh::Point> {
    let shifted = context.interface.coords.iter().zip(state.displacement.chunks_exact(3));
    shifted.map(|(x, d)| std::array::from_fn(|i| x[i] + d[i])).collect()
}

/// The air of the scene.
fn air(context: &StageContext<'_>) -> Air {
    let flow = context.scene.flow.as_ref();
    flow.map_or(Air::incompressible(0.0), |f| Air { density: f.density_kg_m3, sound: f.sound_speed() })
}

/// The canopy in `state` as a lattice of vortex rings; `None` where it has too many faces to make groups.
fn lattice(context: &StageContext<'_>, state: &InterfaceState) -> Option<Lattice> {
    let (faces, coupling) = (&context.interface.faces, &context.scene.coupling);
    let most = coupling.model_faces as usize;
    // Relaxation alone does better with too much air than with as much as there is: on the ATPS descent 7.5
    // against 7.8 iterations of IQN-ILS.
    let screening =
        if needs_model(coupling) { air(context).screening(context.description().window_s) } else { 0.0 };
    Lattice::new(&positions(context, state), faces, most, screening)
}

/// The model of the flow for schemes that use one.
fn modelled(
    context: &StageContext<'_>,
    unknowns: Unknowns,
    state: &InterfaceState,
    lattice: Option<&Lattice>,
    added: Option<AddedMassRelaxation>,
) -> Option<Modelled> {
    let coupling = &context.scene.coupling;
    if !needs_model(coupling) {
        return None;
    }
    let mut air = air(context);
    if coupling.scheme == Scheme::Staggered {
        air.density *= SAFE_DENSITY;
    }
    let faces = &context.interface.faces;
    let most = coupling.model_faces as usize;
    let model = lattice.and_then(|lattice| {
        FlowModel::new(unknowns, lattice, &state.displacement, state.velocity, faces, air, most)
    });
    let name = &context.description().name;
    if model.is_none() {
        context.console.line(&format!(
            "stage `{name}`: {} faces make no {most} groups for a dense model of the flow: coupling by iqn-ils",
            faces.len()
        ));
    } else if faces.len() > most {
        context.console.line(&format!(
            "stage `{name}`: {} faces act in {most} groups in the model of the air's inertia",
            faces.len()
        ));
    }
    // Several solves against the model make a window: few of them are enough to learn from.
    let iqn = Coupling { acceleration: Acceleration::IqnIls, reused_windows: 4, ..coupling.clone() };
    let rest = relaxation(context, unknowns, added);
    model.map(|model| Modelled { model, accelerator: accelerator(&iqn, unknowns.len(), rest) })
}

/// In Jacobi order the load is one of the coupled unknowns, in the unit of what it moves
/// the fabric within a window.
fn with_loads(context: &StageContext<'_>, unknowns: Unknowns, fields: &mut Vec<Field>) -> Unknowns {
    let coupling = &context.scene.coupling;
    if coupling.scheme != Scheme::Implicit || coupling.order != CouplingOrder::Jacobi {
        return unknowns;
    }
    let (nodes, faces) = (context.interface.nodes() as f64, context.interface.faces.len());
    let fabric = &context.scene.fabric;
    let dt = context.description().window_s;
    let moved = response(coupling) * dt * dt / (fabric.thickness_m * fabric.density_kg_m3);
    let before = unknowns.len();
    let unknowns = unknowns.with_loads(faces * LOAD_WIDTH, moved * (nodes / faces as f64).sqrt());
    fields.push(Field { range: before..unknowns.len(), ..fields[0].clone() });
    unknowns
}

/// Displacement at the end of a window, in dt^2/m, per pressure at its end.
fn response(coupling: &Coupling) -> f64 {
    0.5 * if coupling.load == LoadShape::Mean { MEAN_WEIGHTS[0] } else { 1.0 }
}

/// What the canopy and the air weigh.
fn weights(context: &StageContext<'_>) -> Weights {
    let fabric = &context.scene.fabric;
    Weights {
        fabric_kg_m2: fabric.thickness_m * fabric.density_kg_m3,
        air: air(context),
        response: response(&context.scene.coupling),
        falling_kg: context.descent().map_or(0.0, |d| d.mass_kg),
    }
}

/// Relaxation by the canopy's added mass.
fn added_mass(
    context: &StageContext<'_>,
    motion: Unknowns,
    lattice: &Lattice,
) -> Option<AddedMassRelaxation> {
    let interface = context.interface;
    let model = AddedMassRelaxation::new(motion, &interface.faces, &weights(context), lattice)?;
    context.console.line(&format!(
        "stage `{}`: {:.2} kg of fabric move {:.0} kg of air in vertical motion{}",
        context.description().name,
        interface.masses.fabric,
        model.vertical_added_mass,
        if lattice.screening > 0.0 { " within a window" } else { "" },
    ));
    Some(model)
}

/// What is done with what no secant spans; the same factor for all where the added mass is not to be had.
fn relaxation(
    context: &StageContext<'_>,
    unknowns: Unknowns,
    added: Option<AddedMassRelaxation>,
) -> Box<dyn Relaxation> {
    match added {
        Some(model) if unknowns.loads() > 0 => {
            let dt = context.description().window_s;
            Box::new(JacobiRelaxation::new(model, unknowns, &weights(context), dt))
        }
        Some(model) => Box::new(model),
        None => Box::new(Uniform(context.scene.coupling.relaxation)),
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
        // The load of a canopy that was held until now acts on what held it.
        let known = state.load.as_ref().filter(|_| !self.windows.released());
        let before = known.map(|load| self.interface.vertical_force(load, &self.start));
        self.windows.set_wind(self.wind.at(w.time + w.dt));
        let report = self.windows.run(partners, w, shorter)?;
        let state = self.windows.state();
        let load = state.load.as_deref().unwrap_or(&[]);
        let felt = report.stats[Role::Structure as usize].values[structure_stats::LOAD_WORK];
        self.work = (felt, self.interface.work(load, &self.start, &state.displacement));
        self.enter_balance(&report, w.dt, velocity, before);
        Ok(report)
    }

    fn memory(&self) -> Vec<u8> {
        pack(&(self.windows.save_state(), &self.balance))
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        let windows: Vec<u8>;
        (windows, self.balance) = unpack(memory)?;
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
