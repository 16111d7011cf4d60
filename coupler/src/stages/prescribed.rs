//! Prescribed stage: mesh and flow around a canopy with the motion of the scene, without a structure solver.

use case::{RigidMotion, Role};
use coupling::error::RunError;
use coupling::schemes::InterfaceState;

use super::StageContext;
use super::single::{WindowSolve, WindowSolver};

pub(super) struct Prescribed {
    motions: Vec<Motion>,
    /// Displacement at the start of the stage.
    start: Vec<f64>,
    rigid: Option<RigidCanopy>,
}

/// A canopy that moves as a rigid body.
struct RigidCanopy {
    motion: RigidMotion,
    /// Positions at the start of the stage, m.
    start: Vec<[f64; 3]>,
}

impl RigidCanopy {
    /// That of the stage, if its canopy is one; `displacement` at its start.
    fn of(context: &StageContext<'_>, displacement: &[f64]) -> Result<Option<Self>, RunError> {
        let mut motions = context.description().body_motions.iter();
        let Some(motion) = motions.find(|m| context.scene.moves_canopy(m)) else { return Ok(None) };
        let motion = motion.compiled().map_err(|e| RunError::Input(e.to_string()))?;
        let moved = context.interface.coords.iter().zip(displacement.as_chunks::<3>().0);
        let start = moved.map(|(x, d)| [0, 1, 2].map(|i| x[i] + d[i])).collect();
        Ok(Some(Self { motion, start }))
    }

    /// Adds its motion until `t` (s) to the displacement at the start of the stage.
    fn add(&self, t: f64, start: &[f64], displacement: &mut [f64]) {
        let pose = self.motion.at(t);
        let nodes = displacement.as_chunks_mut::<3>().0.iter_mut().zip(start.as_chunks::<3>().0);
        for ((d, d0), x) in nodes.zip(&self.start) {
            let moved = pose.apply(*x);
            *d = [0, 1, 2].map(|i| d0[i] + (moved[i] - x[i]));
        }
    }
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
        let rigid = RigidCanopy::of(context, &state.displacement)?;
        Ok(Self { motions, start: state.displacement.clone(), rigid })
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
        if let Some(rigid) = &self.rigid {
            rigid.add(w.time + w.dt, &self.start, displacement);
        }
        solve.report.add(Role::Mesh, solve.partners.mesh(w, displacement)?);
        solve.flow()
    }
}
