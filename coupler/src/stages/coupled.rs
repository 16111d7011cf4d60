//! Structure, mesh, flow and descent together (paper, section 5.2).

use case::{LoadShape, Role};
use channel::{Window, structure_stats};

use super::{StageContext, Stepper};
use crate::error::RunError;
use crate::interface::CanopyInterface;
use crate::partners::Partners;
use crate::schemes::{
    AddedMassRelaxation, Criterion, Field, InterfaceState, MEAN_WEIGHTS, Relaxation, Uniform, Unknowns,
    Weights, WindowLoop, WindowReport,
};

/// Share of the way that the air moves past the canopy in a window, below which
/// a change of shape over the window is no measure for convergence any more.
const SHAPE_FLOOR: f64 = 0.05;
/// Likewise for the descent speed: the share of what gravity gives in a window.
/// At a tolerance of 1e-3 the drag is then exact to 1e-4 of the weight.
const SPEED_FLOOR: f64 = 0.1;

pub(super) struct Coupled<'a> {
    interface: &'a CanopyInterface,
    windows: WindowLoop,
    start: Vec<f64>,
    energy_error: f64,
}

impl<'a> Coupled<'a> {
    pub(super) fn new(context: &StageContext<'a>, state: InterfaceState) -> Self {
        let scene = context.scene;
        let stage = context.description();
        let dt = stage.window_s;
        let descent = context.descent();
        let unknowns = Unknowns::new(context.interface.nodes(), dt, descent.is_some());
        let wind = scene.flow.as_ref().map_or([0.0; 3], |f| f.wind_m_s);
        let speed = (wind[0] * wind[0] + wind[1] * wind[1] + (wind[2] - state.velocity).powi(2)).sqrt();
        let moved = unknowns.displacements();
        let root = (context.interface.nodes() as f64).sqrt();
        let mut fields = vec![Field { range: 0..moved, floor: SHAPE_FLOOR * speed * dt * root }];
        if let Some(model) = &descent {
            let floor = SPEED_FLOOR * model.gravity_m_s2 * dt * unknowns.velocity_scale();
            fields.push(Field { range: moved..moved + 1, floor });
        }
        let criterion = Criterion { fields, tolerance: scene.coupling.tolerance };
        let start = state.displacement.clone();
        let rest = relaxation(context, unknowns, &state);
        let windows = WindowLoop::new(
            &stage.name,
            &scene.coupling,
            unknowns,
            criterion,
            context.interface.faces.len(),
            descent,
            state,
            rest,
            context.options.keep_going,
        );
        Self { interface: context.interface, windows, start, energy_error: 0.0 }
    }
}

/// Relaxation by the canopy's added mass; uniform where that is not to be had.
fn relaxation(context: &StageContext<'_>, unknowns: Unknowns, state: &InterfaceState) -> Box<dyn Relaxation> {
    let scene = context.scene;
    let interface = context.interface;
    let positions: Vec<mesh::Vec3> = interface
        .coords
        .iter()
        .zip(state.displacement.chunks_exact(3))
        .map(|(x, d)| std::array::from_fn(|i| x[i] + d[i]))
        .collect();
    let weights = Weights {
        fabric_kg_m2: scene.fabric.thickness_m * scene.fabric.density_kg_m3,
        air_kg_m3: scene.flow.as_ref().map_or(0.0, |f| f.density_kg_m3),
        response: 0.5 * if scene.coupling.load == LoadShape::Mean { MEAN_WEIGHTS[0] } else { 1.0 },
        falling_kg: context.descent().map_or(0.0, |d| d.mass_kg),
    };
    match AddedMassRelaxation::new(unknowns, &positions, &interface.faces, &weights) {
        Some(model) => {
            context.console.line(&format!(
                "stage `{}`: the air adds {:.0} kg to the canopy's {:.2} kg of fabric in vertical motion",
                context.description().name,
                model.vertical_added_mass,
                interface.masses.fabric
            ));
            Box::new(model)
        }
        None => Box::new(Uniform(scene.coupling.relaxation)),
    }
}

impl Stepper for Coupled<'_> {
    fn step(&mut self, partners: &mut dyn Partners, w: Window) -> Result<WindowReport, RunError> {
        self.start.copy_from_slice(&self.windows.state().displacement);
        let report = self.windows.run(partners, w)?;
        let state = self.windows.state();
        let load = state.load.as_deref().unwrap_or(&[]);
        let felt = report.stats[Role::Structure as usize].values[structure_stats::LOAD_WORK];
        self.energy_error = felt - self.interface.work(load, &self.start, &state.displacement);
        Ok(report)
    }

    fn state(&self) -> &InterfaceState {
        self.windows.state()
    }

    fn energy_error(&self) -> f64 {
        self.energy_error
    }
}
