//! Mesh and flow around a canopy that moves as the scene prescribes: no structure is started.

use case::Role;
use channel::{LOAD_WIDTH, Window};
use coupling::convergence::Judge;
use coupling::error::{Place, RunError};
use coupling::partners::Partners;
use coupling::schemes::{InterfaceState, WindowReport, pack, unpack};

use super::{StageContext, Stepper, require_finite};

pub(super) struct Prescribed {
    place: Place,
    judge: Judge,
    motions: Vec<Motion>,
    /// Displacement at the start of the stage.
    start: Vec<f64>,
    /// Attempts at the present window.
    tried: u64,
    state: InterfaceState,
}

/// A table over the time of the stage for some components of some nodes.
struct Motion {
    dofs: Vec<usize>,
    table: case::Motion,
}

impl Prescribed {
    pub(super) fn new(context: &StageContext<'_>, mut state: InterfaceState) -> Result<Self, RunError> {
        let input = |e: mesh::MeshError| RunError::Input(e.to_string());
        let structure = mesh::structure_mesh(context.scene).map_err(input)?;
        let stage = context.description();
        let times = context.times();
        let mut motions = Vec::new();
        for (k, m) in stage.motions.iter().enumerate() {
            let key = format!("stage[{}].motion[{k}]", context.stage);
            let nodes = structure.nodes_of(&key, m.nodes.as_deref(), m.at_m).map_err(input)?;
            let components = ['x', 'y', 'z'].map(|c| m.components.contains(c));
            // Lines and payload are no part of the flow.
            let dofs = nodes
                .iter()
                .map(|n| *n as usize)
                .filter(|n| *n < structure.n_canopy)
                .flat_map(|n| (0..3).filter(|c| components[*c]).map(move |c| 3 * n + c))
                .collect();
            motions.push(Motion { dofs, table: m.in_stage(context.scene, context.stage, &times) });
        }
        state.acceleration = 0.0;
        state.load.get_or_insert_default().resize(context.interface.faces.len() * LOAD_WIDTH, 0.0);
        let start = state.displacement.clone();
        Ok(Self { place: context.place(), judge: context.judge(), motions, start, tried: 0, state })
    }
}

impl Stepper for Prescribed {
    fn step(
        &mut self,
        partners: &mut dyn Partners,
        mut w: Window,
        _shorter: bool,
    ) -> Result<WindowReport, RunError> {
        (w.iteration, self.tried) = (self.tried, self.tried + 1);
        w.frame_velocity = [0.0, 0.0, self.state.velocity];
        let mut report = WindowReport { iterations: 1, converged: true, ..WindowReport::default() };
        for m in &self.motions {
            let d = m.table.at(w.time + w.dt);
            for &i in &m.dofs {
                self.state.displacement[i] = self.start[i] + d[i % 3];
            }
        }
        report.add(Role::Mesh, partners.mesh(&w, &self.state.displacement)?);
        let load = self.state.load.get_or_insert_default();
        report.add(Role::Flow, partners.flow(&w, load)?);
        require_finite(Role::Flow, &self.place, &w, load)?;
        self.judge.require(&w, &report)?;
        partners.accept(&w)?;
        self.tried = 0;
        Ok(report)
    }

    fn memory(&self) -> Vec<u8> {
        pack(&self.state)
    }

    fn recall(&mut self, memory: &[u8]) -> Result<(), RunError> {
        self.state = unpack(memory)?;
        Ok(())
    }

    fn state(&self) -> &InterfaceState {
        &self.state
    }
}
