//! Mesh and flow around a canopy that moves as the scene prescribes: no structure is started.

use case::Role;
use channel::{LOAD_WIDTH, Window};

use super::{StageContext, Stepper, require_finite};
use crate::error::{Place, RunError};
use crate::partners::Partners;
use crate::schemes::{InterfaceState, WindowReport, pack, unpack};

pub(super) struct Prescribed {
    place: Place,
    motions: Vec<Motion>,
    /// Displacement at the start of the stage.
    start: Vec<f64>,
    /// Attempts at the present window.
    tried: u64,
    state: InterfaceState,
}

/// A history of some components of some nodes.
struct Motion {
    dofs: Vec<usize>,
    time: Vec<f64>,
    displacement: Vec<[f64; 3]>,
}

impl Motion {
    /// Displacement since the start of the stage at time `t` (s): linear between the given
    /// times, constant beyond.
    fn at(&self, t: f64) -> [f64; 3] {
        let after = self.time.partition_point(|s| *s <= t);
        if after == 0 {
            return self.displacement[0];
        }
        let Some(end) = self.time.get(after) else { return self.displacement[after - 1] };
        let (from, to) = (self.displacement[after - 1], self.displacement[after]);
        let share = (t - self.time[after - 1]) / (end - self.time[after - 1]);
        std::array::from_fn(|i| from[i] + share * (to[i] - from[i]))
    }
}

impl Prescribed {
    pub(super) fn new(context: &StageContext<'_>, mut state: InterfaceState) -> Result<Self, RunError> {
        let input = |e: mesh::MeshError| RunError::Input(e.to_string());
        let structure = mesh::structure_mesh(context.scene).map_err(input)?;
        let stage = context.description();
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
            motions.push(Motion { dofs, time: m.time_s.clone(), displacement: m.displacement_m.clone() });
        }
        state.acceleration = 0.0;
        state.load.get_or_insert_default().resize(context.interface.faces.len() * LOAD_WIDTH, 0.0);
        Ok(Self { place: context.place(), motions, start: state.displacement.clone(), tried: 0, state })
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
            let d = m.at(w.time + w.dt);
            for &i in &m.dofs {
                self.state.displacement[i] = self.start[i] + d[i % 3];
            }
        }
        report.add(Role::Mesh, partners.mesh(&w, &self.state.displacement)?);
        let load = self.state.load.get_or_insert_default();
        report.add(Role::Flow, partners.flow(&w, load)?);
        require_finite(Role::Flow, &self.place, &w, load)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histories_are_linear_between_their_times() {
        let m = Motion { dofs: vec![2], time: vec![1.0, 3.0], displacement: vec![[0.0; 3], [0.0, 0.0, 2.0]] };
        assert_eq!([0.0, 1.5, 9.0].map(|t| m.at(t)[2]), [0.0, 0.5, 2.0]);
    }
}
