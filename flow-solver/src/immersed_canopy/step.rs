//! The steps of a window.
//!
//! A window is computed once with the canopy at its accepted velocity. All its solutions start from there: convection, viscous stress and friction of each step are those of
//! that computation, so that the velocity of step k differs from it by what the pressure jumps $`\varphi_j`$ of its solution differ,
//! ```math
//! u_k = u_k^0 - \tfrac{\Delta t}{\rho}\, P \sum_{j \le k} C_j^T \left(\varphi_j - \varphi_j^0\right),
//! ```
//! with the projection P of the whole flow and the constraints $`C_j`$ of each step. A solution needs the constraints of all steps, but no convection and no projection beyond the
//! box around the canopy. The load of a window is affine in the motion, and depends on earlier solutions by the tolerance of the constraints only.
//!
//! Why: `docs/decisions/0084-solutions-of-a-divided-window.md`.

use immersed::constraints::FluxConstraints;
use immersed::cut_faces::OutsideCore;
use immersed::flow::{Flow, PredictedFluxes, PressureJumps};
use immersed::free_edges::EdgeFluxes;
use immersed::friction::Friction;
use immersed::pressure_jumps::SolveHistory;
use nalgebra::Vector3;

use super::canopy::CanopySurface;
use super::cut::Cut;
use super::impulsive_start::rate_after_start;
use super::wind_by_height::Climb;
use crate::face_permeability::FacePermeability;

/// Sum over the axes of Courant numbers that a step has at most.
const MAX_COURANT: f64 = 0.4;
/// Steps of a window at most.
const MAX_STEPS: usize = 1000;
/// Share of a cell by which a node moves at most in the prediction of a step.
const PREDICTED_MOTION: f64 = 0.5;

/// A window that is solved, perhaps repeatedly, and not accepted yet.
pub struct OpenWindow {
    /// Number and length, s.
    pub index: u64,
    pub dt: f64,
    /// Velocity of the grid relative to the wind, m/s, and in the falling frame.
    pub velocity: Vector3<f64>,
    pub drift: Vector3<f64>,
    /// Positions of the nodes for which loads are given: those predicted for the end.
    pub nodes: Vec<Vector3<f64>>,
    /// The cuts of its steps.
    pub cuts: Vec<Cut>,
    /// The canopy in the prediction of each step. It is where it is at the start of the step, and has the accepted velocity: what it does there is the
    /// same in all solutions of the window.
    predictions: Vec<AroundCanopy>,
    /// Face of each triangle.
    face_of: Vec<u32>,
    /// Velocities of the faces of the canopy relative to the wind at the start, m/s.
    start_velocities: Vec<Vector3<f64>>,
    /// Pressure jumps from which the window starts, Pa; where several steps are needed.
    start_jumps: Vec<f64>,
    /// What its solutions start from, once it is predicted.
    prediction: Option<Prediction>,
    /// What the solutions of the constraints of each step have left for the next ones.
    histories: Vec<SolveHistory>,
    /// Its way through a wind that changes with height.
    climb: Option<Climb>,
    /// Courant number of the window, sum over the axes, and largest speed relative to the grid, m/s: at its start, after an impulsive start in its first step.
    pub courant: f64,
    pub speed: f64,
    /// Jumps of the last step of the last solution.
    pub jumps: Option<PressureJumps>,
}

/// A window with the canopy at its accepted velocity.
#[derive(Clone, Debug, Default)]
struct Prediction {
    /// Predicted fluxes of each step.
    fluxes: Vec<PredictedFluxes>,
    /// Constraints of all steps, where there are several.
    rows: FluxConstraints,
    /// Pressure jumps of all steps but the last one, Pa, one after the other, and the iterations for them.
    jumps: Vec<f64>,
    iterations: usize,
    /// What the jumps of the last solution differ from these, at all constraints; zero in the last step.
    changes: Vec<f64>,
}

/// Solution of a window.
#[derive(Clone, Debug, Default)]
pub struct Solution {
    /// Mean force on each face, N.
    pub forces: Vec<Vector3<f64>>,
    /// Iterations of all steps, and the largest residual.
    pub iterations: usize,
    pub residual: f64,
    /// Air that passes airtight cloth in the last step, m3/s.
    pub leakage: f64,
}

/// What a window starts from.
pub struct Start<'a> {
    /// Positions of the nodes, m, and their velocities in the falling frame, m/s.
    pub positions: &'a [Vector3<f64>],
    pub velocities: &'a [Vector3<f64>],
    /// Origin of the grid in the falling frame, m.
    pub origin: Vector3<f64>,
    /// Velocity of the frame relative to the wind, m/s.
    pub frame: Vector3<f64>,
    /// Way of the grid through a wind that changes with height.
    pub climb: Option<Climb>,
}

/// Number of equal steps of a window of `dt` s; `eddies`: rate of the eddy viscosity, 1/s. The stress of walls is implicit and does not shorten them.
pub fn steps(flow: &Flow, dt: f64, courant: f64, eddies: f64) -> usize {
    let h = flow.grid.axes[0].spacing;
    let viscous = 12.0 * flow.settings.momentum.viscosity * dt / (h * h) + eddies * dt;
    // Not a number: one step, whose result is judged.
    (((courant + viscous) / MAX_COURANT).ceil().max(1.0) as usize).min(MAX_STEPS)
}

/// Nodes after `time` s at their velocities, each moved by a part of a cell at most.
pub fn predicted(start: &Start<'_>, time: f64, spacing: f64) -> Vec<Vector3<f64>> {
    let most = PREDICTED_MOTION * spacing;
    let moved = |(x, v): (&Vector3<f64>, &Vector3<f64>)| {
        let step = v * time;
        x + step * (most / step.norm().max(most))
    };
    start.positions.iter().zip(start.velocities).map(moved).collect()
}

/// What the canopy does in the prediction of a step.
#[derive(Clone, Debug, Default)]
pub struct AroundCanopy {
    /// Vertices of the surface, m.
    vertices: Vec<Vector3<f64>>,
    /// Fluxes near its free edges.
    edges: EdgeFluxes,
    /// Friction; `None` without viscosity.
    friction: Option<Friction>,
    /// Force of friction on each face, N, once the step is predicted.
    friction_forces: Vec<Vector3<f64>>,
}

impl AroundCanopy {
    /// Of the canopy with `vertices` in coordinates of the grid, m, at the velocities of the start. `last`: that of the step before.
    fn new(
        last: Option<&Self>,
        flow: &Flow,
        surface: &CanopySurface,
        start: &Start<'_>,
        vertices: &[Vector3<f64>],
    ) -> Result<Self, OutsideCore> {
        let momentum = flow.settings.momentum;
        let last = last.filter(|last| last.vertices == vertices);
        let mut around = Self { vertices: vertices.to_vec(), ..Self::default() };
        if momentum.upwind_share < 1.0 {
            around.edges = match last.filter(|last| !last.edges.is_empty()) {
                Some(last) => last.edges.clone(),
                None => EdgeFluxes::new(&flow.grid, vertices, &surface.free_edges)?,
            };
        }
        if momentum.viscosity > 0.0 {
            let mut friction = match last.and_then(|last| last.friction.clone()) {
                Some(friction) => friction,
                None => Friction::new(&flow.grid, vertices, &surface.triangles)?,
            };
            friction.set_velocities(&surface.triangles, &surface.vertices(start.velocities, -start.frame));
            around.friction = Some(friction);
        }
        Ok(around)
    }

    /// Convection, viscosity and friction of a step of `dt` s on a grid of velocity `frame` (m/s) around the canopy.
    fn predict(&mut self, flow: &mut Flow, dt: f64, frame: Vector3<f64>, face_of: &[u32], faces: usize) {
        flow.predict_around(dt, frame, &self.edges, self.friction.as_mut());
        if let Some(friction) = &self.friction {
            let mut forces = vec![0.0; 3 * faces];
            friction.add_face_forces(face_of, &mut forces);
            flow.slabs().ranks().sum(&mut forces);
            self.friction_forces = forces.chunks_exact(3).map(Vector3::from_column_slice).collect();
        }
    }
}

impl OpenWindow {
    /// Opens a window: the canopy cuts the grid where its nodes are expected. `last`: cut and prediction of the last step before it, which hold on
    /// where the canopy rests in the grid.
    ///
    /// # Errors
    /// A node outside the even cells.
    pub fn new(
        flow: &mut Flow,
        surface: &CanopySurface,
        start: &Start<'_>,
        (index, dt): (u64, f64),
        [velocity, drift]: [Vector3<f64>; 2],
        last: Option<&(Cut, AroundCanopy)>,
    ) -> Result<Self, OutsideCore> {
        let _part = timing::part("cut");
        let mut courant = flow.largest_rate(velocity) * dt;
        let spacing = flow.grid.axes[0].spacing;
        let mut nodes = Vec::new();
        let mut vertices = surface.vertices(start.positions, start.origin);
        let mut predictions =
            vec![AroundCanopy::new(last.map(|(_, around)| around), flow, surface, start, &vertices)?];
        let eddies = flow.largest_eddy_rate(predictions[0].friction.as_ref());
        let mut count = steps(flow, dt, courant, eddies);
        let velocities: Vec<_> = start.velocities.iter().map(|v| v + start.frame).collect();
        let start_velocities = surface.means(&velocities);
        if count > 1 && flow.last_step().1.is_none() && flow.is_undisturbed() {
            let cut = Cut::new(flow, surface, &vertices)?;
            courant = dt * rate_after_start(flow, cut, &start_velocities, velocity, dt / count as f64);
            count = steps(flow, dt, courant, eddies);
        }
        let mut cuts: Vec<Cut> = Vec::with_capacity(count);
        for step in 1..=count {
            if step > 1 {
                let around = AroundCanopy::new(predictions.last(), flow, surface, start, &vertices)?;
                predictions.push(around);
            }
            let time = dt * step as f64 / count as f64;
            nodes = predicted(start, time, spacing);
            vertices = surface.vertices(&nodes, start.origin + drift * time);
            let before = cuts.last().or(last.map(|(cut, _)| cut));
            let cut = Cut::from_last(before, flow, surface, &vertices)?;
            cuts.push(cut);
        }
        let speed = flow.largest_speed(velocity);
        Ok(Self {
            index,
            dt,
            velocity,
            drift,
            nodes,
            cuts,
            predictions,
            face_of: surface.face_of.clone(),
            start_velocities,
            start_jumps: Vec::new(),
            prediction: None,
            histories: vec![SolveHistory::default(); count],
            climb: start.climb.clone(),
            courant,
            speed,
            jumps: None,
        })
    }

    /// Prepares for a single solution of the window: of a canopy that does not answer.
    pub fn solve_once(&mut self) {
        self.histories.fill_with(SolveHistory::of_last_solution);
    }

    /// Sets what passes through the cloth at the pressure jumps of the last window ([`Cut::set_cloth`]).
    pub fn set_cloth(&mut self, cloth: &FacePermeability, jumps: &[f64], floor: f64) {
        for step in 0..self.cuts.len() {
            let jumps = self.cuts[step].faces.transfer(&self.cuts[0].faces, jumps);
            self.cuts[step].set_cloth(cloth, &self.face_of, &jumps, floor);
        }
    }

    /// Starts the first solution of the window from these jumps.
    pub fn start_from(&mut self, flow: &mut Flow, jumps: Vec<f64>) {
        if self.cuts.len() > 1 {
            self.start_jumps.clone_from(&jumps);
        }
        flow.start_from(jumps);
    }

    /// Solves the window with the mean velocities of the faces relative to the wind, m/s.
    pub fn solve(&mut self, flow: &mut Flow, face_velocities: &[Vector3<f64>]) -> Solution {
        let mut prediction = self.prediction.take().unwrap_or_else(|| self.predict(flow));
        let count = self.cuts.len();
        // Those of the prediction count once.
        let mut solution = Solution {
            forces: vec![Vector3::zeros(); face_velocities.len()],
            iterations: std::mem::take(&mut prediction.iterations),
            ..Solution::default()
        };
        let _part = timing::part("constraints");
        prediction.changes.fill(0.0);
        let mut first = 0;
        for step in 0..count {
            let friction = &self.predictions[step].friction_forces;
            solution.forces.iter_mut().zip(friction).for_each(|(sum, f)| *sum += f / count as f64);
            let mut fluxes = prediction.fluxes[step].clone();
            if step > 0 {
                let changes = flow.flux_changes(&prediction.rows, &prediction.changes);
                fluxes = fluxes.changed_by(&changes[first..]);
            }
            let jumps = self.solve_step(flow, step, face_velocities, &fluxes);
            solution.iterations += jumps.iterations;
            solution.residual = jumps.residual.max(solution.residual);
            solution.leakage = flow.leakage(&self.cuts[step].faces.rows, &jumps.jump);
            let share: Vec<f64> = jumps.jump.iter().map(|j| j / count as f64).collect();
            self.cuts[step].transfer.add_forces(&share, &mut solution.forces);
            if step + 1 < count {
                let changes = &mut prediction.changes[first..];
                for ((change, jump), predicted) in
                    changes.iter_mut().zip(&jumps.jump).zip(&prediction.jumps[first..])
                {
                    *change = jump - predicted;
                }
                first += jumps.jump.len();
            }
            self.jumps = Some(jumps);
        }
        self.prediction = Some(prediction);
        solution
    }

    /// Jumps of one step with these velocities of the faces and predicted fluxes. The first solution of the step starts from the jumps of the step before.
    fn solve_step(
        &mut self,
        flow: &mut Flow,
        step: usize,
        velocities: &[Vector3<f64>],
        fluxes: &PredictedFluxes,
    ) -> PressureJumps {
        if step > 0 && self.histories[step].is_empty() {
            let start = self.cuts[step].faces.transfer(&self.cuts[step - 1].faces, flow.jumps());
            flow.start_from(start);
        }
        let cut = &mut self.cuts[step];
        cut.transfer.fluxes(velocities, self.velocity, &mut cut.faces.rows.target);
        flow.solve_constraints_from(&cut.faces.rows, fluxes, Some(&mut self.histories[step]))
    }

    /// Computes the window with the canopy at its accepted velocity, but for the constraints of its last step.
    fn predict(&mut self, flow: &mut Flow) -> Prediction {
        let (count, velocities) = (self.cuts.len(), std::mem::take(&mut self.start_velocities));
        let mut prediction = Prediction::default();
        if count > 1 {
            prediction.rows = FluxConstraints::new(&flow.grid);
            self.cuts.iter().for_each(|cut| prediction.rows.append(&cut.faces.rows));
            prediction.changes = vec![0.0; prediction.rows.len()];
            // One box around the canopy for all.
            self.cuts.iter_mut().for_each(|cut| cut.faces.rows.cells.clone_from(&prediction.rows.cells));
        }
        for step in 0..count {
            self.predict_step(flow, step, velocities.len());
            let fluxes = flow.predicted_fluxes(&self.cuts[step].faces.rows);
            if step + 1 < count {
                let jumps = {
                    let _part = timing::part("constraints");
                    self.solve_step(flow, step, &velocities, &fluxes)
                };
                let _part = timing::part("projection");
                let rows = &self.cuts[step].faces.rows;
                if step == 0 {
                    flow.accept_and_keep(rows, &jumps);
                } else {
                    flow.accept(rows, &jumps);
                }
                prediction.iterations += jumps.iterations;
                prediction.jumps.extend(jumps.jump);
            }
            prediction.fluxes.push(fluxes);
        }
        prediction
    }

    /// The far field of one step.
    fn set_far_field(&self, flow: &mut Flow, step: usize) {
        let dt = self.dt / self.cuts.len() as f64;
        if let Some(climb) = &self.climb {
            climb.set_far_field(flow, [step, step + 1].map(|k| dt * k as f64));
        }
    }

    /// Convection, viscosity and friction of one step.
    fn predict_step(&mut self, flow: &mut Flow, step: usize, faces: usize) {
        let _part = timing::part("momentum");
        let dt = self.dt / self.cuts.len() as f64;
        self.set_far_field(flow, step);
        self.predictions[step].predict(flow, dt, self.velocity, &self.face_of, faces);
    }

    /// Mean friction on the canopy over the steps that were predicted, N.
    pub fn friction(&self) -> Vector3<f64> {
        let of_step = |p: &AroundCanopy| p.friction_forces.iter().sum::<Vector3<f64>>();
        self.predictions.iter().map(of_step).sum::<Vector3<f64>>() / self.predictions.len() as f64
    }

    /// Returns the flow to the start of the window.
    pub fn reject(&mut self, flow: &mut Flow) {
        if self.cuts.len() > 1 {
            flow.return_to_start();
            flow.start_from(self.start_jumps.clone());
        }
        self.jumps = None;
    }

    /// Ends the window with its last solution; returns cut and prediction of the last step. `None` where there is no solution.
    pub fn accept(mut self, flow: &mut Flow) -> Option<(Cut, AroundCanopy)> {
        let _part = timing::part("projection");
        let (jumps, cut, around) = (self.jumps?, self.cuts.pop()?, self.predictions.pop()?);
        let prediction = self.prediction?;
        // A canopy at rest changes nothing.
        let changed = prediction.changes.iter().any(|change| *change != 0.0);
        let earlier = changed.then_some((&prediction.rows, &prediction.changes[..]));
        flow.accept_after(&cut.faces.rows, &jumps, earlier);
        flow.release_kept();
        Some((cut, around))
    }
}

#[cfg(test)]
mod tests {
    use immersed::axis::Axis;
    use immersed::flow::Settings;
    use immersed::grid::{End, Ends, Grid};
    use immersed::momentum::Momentum;

    use super::*;

    /// A window of 0.1 s on cells of 0.1 m: by the Courant number, molecular viscosity and eddy viscosity, alone and together.
    #[test]
    fn eddy_viscosity_divides_a_window() {
        let axis = || Axis::even(0.0, 0.4, 4);
        let grid = Grid::new([axis(), axis(), axis()], [Ends::Open([End::Slip; 2]); 3]);
        let flow = |viscosity: f64| {
            let momentum = Momentum { upwind_share: 0.0, viscosity };
            let settings = Settings { density: 1.0, far: Vector3::zeros(), momentum, tolerance: 1e-3 };
            Flow::new(grid.clone(), settings)
        };
        // 12 nu dt / h^2 is 0.3 with the viscosity.
        let (inviscid, viscous) = (flow(0.0), flow(0.0025));
        let found =
            [(0.3, 0.0), (0.3, 2.0), (0.0, 7.9), (0.0, 8.1)].map(|(c, e)| steps(&inviscid, 0.1, c, e));
        assert_eq!(found, [1, 2, 2, 3]);
        assert_eq!([0.9, 1.1, 5.1].map(|eddies| steps(&viscous, 0.1, 0.0, eddies)), [1, 2, 3]);
    }
}
