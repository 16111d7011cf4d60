//! Structure, mesh, flow and descent together (paper, section 5.2).

use case::Role;
use channel::{Window, structure_stats};

use super::{StageContext, Stepper};
use crate::error::RunError;
use crate::interface::CanopyInterface;
use crate::partners::Partners;
use crate::schemes::{Criterion, Field, InterfaceState, Unknowns, WindowLoop, WindowReport};

/// Share of the way that the air moves past the canopy in a window, and of the
/// velocity that gravity gives in it, below which a change over the window is
/// no measure for convergence any more.
const FLOOR: f64 = 1e-2;

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
        let mut fields = vec![Field { range: 0..moved, floor: FLOOR * speed * dt * root }];
        if let Some(model) = &descent {
            let floor = FLOOR * model.gravity_m_s2 * dt * unknowns.velocity_scale();
            fields.push(Field { range: moved..moved + 1, floor });
        }
        let criterion = Criterion { fields, tolerance: scene.coupling.tolerance };
        let start = state.displacement.clone();
        let windows = WindowLoop::new(
            &stage.name,
            &scene.coupling,
            unknowns,
            criterion,
            context.interface.faces.len(),
            descent,
            state,
            context.options.keep_going,
        );
        Self { interface: context.interface, windows, start, energy_error: 0.0 }
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
