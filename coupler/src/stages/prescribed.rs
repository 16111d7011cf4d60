//! Prescribed stage: mesh and flow around a canopy with the motion of the scene, without a structure solver.

use case::Role;
use coupling::error::RunError;
use coupling::schemes::InterfaceState;

use super::StageContext;
use super::single::{WindowSolve, WindowSolver};

pub(super) struct Prescribed {
    motions: Vec<Motion>,
    /// Displacement at the start of the stage.
    start: Vec<f64>,
}

/// A displacement table over the time of the stage for degrees of freedom of the canopy.
struct Motion {
    dofs: Vec<usize>,
    table: case::Motion,
}

impl Prescribed {
    pub(super) fn new(context: &StageContext<'_>, state: &InterfaceState) -> Result<Self, RunError> {
        let input = |e: mesh::MeshError| RunError::Input(e.to_string());
        let structure = mesh::structure_mesh(context.scene).map_err(input)?;
        let stage = context.description();
        let times = context.times();
        let mut motions = Vec::new();
        for (k, m) in stage.motions.iter().enumerate() {
            let key = format!("stage[{}].motion[{k}]", context.stage);
            let nodes = structure.nodes_of(&key, m.nodes.as_deref(), m.at_m).map_err(input)?;
            let components = ['x', 'y', 'z'].map(|c| m.components.contains(c));
            // Lines and payload are not part of the flow boundary.
            let dofs = nodes
                .iter()
                .map(|n| *n as usize)
                .filter(|n| *n < structure.n_canopy)
                .flat_map(|n| (0..3).filter(|c| components[*c]).map(move |c| 3 * n + c))
                .collect();
            motions.push(Motion { dofs, table: m.in_stage(context.scene, context.stage, &times) });
        }
        Ok(Self { motions, start: state.displacement.clone() })
    }
}

impl WindowSolver for Prescribed {
    fn solve(&mut self, solve: &mut WindowSolve<'_>) -> Result<(), RunError> {
        let w = solve.window;
        let displacement = &mut solve.state.displacement;
        for m in &self.motions {
            let d = m.table.at(w.time + w.dt);
            for &i in &m.dofs {
                displacement[i] = self.start[i] + d[i % 3];
            }
        }
        solve.report.add(Role::Mesh, solve.partners.mesh(w, displacement)?);
        solve.flow()
    }
}
