//! Prescribed stage: mesh and flow around a canopy with the motion of the scene, without a structure solver.

use case::{NodeMotion, RigidMotion, Role};
use coupling::error::RunError;
use coupling::schemes::InterfaceState;

use super::StageContext;
use super::single::{WindowSolve, WindowSolver};

pub(super) struct Prescribed {
    motions: Vec<Motion>,
    /// Unstressed positions of the canopy, m.
    coords: Vec<[f64; 3]>,
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

/// A motion over the time of the stage for degrees of freedom of the canopy.
struct Motion {
    dofs: Vec<usize>,
    by_time: NodeMotion,
}

impl Motion {
    /// Sets its components of the `displacement` at `t` (s); `start` is that at the start of the stage, at which the nodes are where `coords` (m) say
    /// without it.
    fn set(&self, t: f64, coords: &[[f64; 3]], start: &[f64], displacement: &mut [f64]) {
        let pose = self.by_time.at(t);
        for &i in &self.dofs {
            let (node, c) = (i / 3, i % 3);
            let moved = if self.by_time.rotates() {
                let x = [0, 1, 2].map(|c| coords[node][c] + start[3 * node + c]);
                pose.apply(x)[c] - x[c]
            } else {
                pose.displacement[c]
            };
            displacement[i] = start[i] + moved;
        }
    }
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
            let by_time = m
                .in_stage(context.scene, context.stage, &times)
                .map_err(|e| RunError::Input(format!("{key}: {e}")))?;
            motions.push(Motion { dofs, by_time });
        }
        let rigid = RigidCanopy::of(context, &state.displacement)?;
        let coords = structure.coords[..structure.n_canopy].to_vec();
        Ok(Self { motions, coords, start: state.displacement.clone(), rigid })
    }
}

impl WindowSolver for Prescribed {
    fn solve(&mut self, solve: &mut WindowSolve<'_>) -> Result<(), RunError> {
        let w = solve.window;
        let displacement = &mut solve.state.displacement;
        for m in &self.motions {
            m.set(w.time + w.dt, &self.coords, &self.start, displacement);
        }
        if let Some(rigid) = &self.rigid {
            rigid.add(w.time + w.dt, &self.start, displacement);
        }
        solve.report.add(Role::Mesh, solve.partners.mesh(w, displacement)?);
        solve.flow()
    }
}
