//! Flows around moving surfaces that several tests compute in different ways.

use std::rc::Rc;

use immersed::axis::Axis;
use immersed::constraints::FluxConstraints;
use immersed::cut_faces::CutFaces;
use immersed::device::Device;
use immersed::eddy_viscosity::SubgridModel;
use immersed::flow::{Flow, PredictedFluxes, PressureJumps, Settings};
use immersed::free_edges::{EdgeFluxes, free_edges};
use immersed::friction::Friction;
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes;
use immersed::slabs::Ranks;
use nalgebra::Vector3;

/// The end of a run: complete velocity and pressure, jumps, friction, and what is reduced over the ranks.
#[derive(Debug)]
pub struct Outcome {
    pub velocity: Vec<f64>,
    pub pressure: Vec<f64>,
    pub jumps: Vec<f64>,
    pub friction: Vec<f64>,
    pub figures: Vec<f64>,
}

/// A surface that moves and is permeable, in a stream at an angle, over steps of several lengths and a new grid; all kinds of ends.
pub fn run(
    ranks: Rc<dyn Ranks>,
    device: Option<Rc<dyn Device>>,
    nodes: &[Vector3<f64>],
    faces: &[[u32; 3]],
    low: End,
    model: Option<SubgridModel>,
) -> Outcome {
    let axis = || Axis::stretched([-1.0, 1.0], 0.125, [1.0, 2.0], 1.3, 2);
    let open = Ends::Open([low, End::Outflow]);
    let grid = || Grid::new([Axis::even(-1.5, 1.5, 24), axis(), axis()], [Ends::Periodic, open, open]);
    let momentum = Momentum { upwind_share: 0.7, viscosity: 0.02 };
    let far = Vector3::new(0.4, 0.3, 1.0);
    let settings = Settings { density: 1.2, far, momentum, tolerance: 1e-12 };
    let mut flow = Flow::on_ranks(grid(), settings, ranks).expect("slabs");
    flow.set_subgrid_model(model);
    flow.set_device(device).expect("memory");
    flow.perturb(0.1);
    let mut friction_forces = vec![0.0; 3 * faces.len()];
    let own: Vec<u32> = (0..faces.len() as u32).collect();
    let mut figures = Vec::new();
    for step in 0..6 {
        let dt = 0.02 + 0.01 * f64::from(step % 2);
        let moved: Vec<_> = nodes.iter().map(|x| x * (1.0 + 0.01 * f64::from(step))).collect();
        let mut cut = CutFaces::new(&flow.grid, &moved, faces, 0.0).expect("inside");
        cut.rows.permeability.iter_mut().for_each(|r| *r *= 0.01);
        let mut friction = Friction::new(&flow.grid, &moved, faces).expect("inside");
        friction.set_velocities(faces, &vec![Vector3::new(0.1, 0.0, -0.2); nodes.len()]);
        let edges = EdgeFluxes::new(&flow.grid, &moved, &free_edges(faces)).expect("inside");
        flow.predict_around(dt, Vector3::new(0.0, 0.1, 0.2), &edges, Some(&mut friction));
        let jumps = flow.solve_constraints(&cut.rows);
        assert!(jumps.residual < 1e-12, "{}", jumps.residual);
        flow.accept(&cut.rows, &jumps);
        friction_forces.fill(0.0);
        friction.add_face_forces(&own, &mut friction_forces);
        flow.slabs().ranks().sum(&mut friction_forces);
        figures = vec![flow.largest_rate(far), flow.largest_speed(far)];
        figures.extend(flow.pressure_range());
        figures.push(flow.largest_eddy_rate(Some(&friction)));
        if flow.device().is_some() {
            flow.gather();
        }
        assert!(flow.largest_divergence() < 1e-11, "{}", flow.largest_divergence());
        if step == 3 {
            flow = flow.on_grid(grid(), Vector3::new(0.01, -0.02, 0.03), None).expect("slabs");
        }
    }
    flow.gather();
    let state = flow.state();
    Outcome {
        velocity: flow.cell_velocities().into_iter().flat_map(<[f64; 3]>::from).collect(),
        pressure: flow.pressures().collect(),
        friction: friction_forces,
        jumps: state.jump,
        figures,
    }
}

/// Judges what two runs have computed.
pub fn compare(what: &str, one: &[f64], other: &[f64]) {
    let size = one.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let error = one.iter().zip(other).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
    println!("{what}: {error:e} of {size:e}");
    assert!(one.len() == other.len() && error < 1e-9 * size, "{what}: {error:e} of {size:e}");
}

/// [`compare`] of two runs.
pub fn compare_all(one: &Outcome, other: &Outcome) {
    compare("velocity", &one.velocity, &other.velocity);
    compare("pressure", &one.pressure, &other.pressure);
    compare("jumps", &one.jumps, &other.jumps);
    compare("friction", &one.friction, &other.friction);
    compare("figures", &one.figures, &other.figures);
}

/// Name, nodes and triangles of a surface, the low ends of y and z, and the model of small eddies.
pub type Case = (&'static str, (Vec<Vector3<f64>>, Vec<[u32; 3]>), End, Option<SubgridModel>);

/// Surfaces in a stream.
pub fn cases() -> [Case; 5] {
    let (plate, sphere) = (|| shapes::plate(6), || shapes::sphere(0.45, 2));
    [
        ("plate", plate(), End::Inflow, None),
        ("sphere", sphere(), End::Outflow, None),
        ("plate", plate(), End::Slip, None),
        ("plate", plate(), End::Inflow, Some(SubgridModel::Wale)),
        ("sphere", sphere(), End::Slip, Some(SubgridModel::Smagorinsky)),
    ]
}

/// A flow in windows of several steps. `repeated`: each window is first solved for other motions of the surface, and in other steps that are rejected.
struct Windows<'a> {
    flow: Flow,
    nodes: &'a [Vector3<f64>],
    faces: &'a [[u32; 3]],
    repeated: bool,
    /// Forces of friction, N, in all steps of the last solution.
    friction: Vec<f64>,
}

/// A solution of a window but for the end of its last step.
struct Solved {
    cut: CutFaces,
    jumps: PressureJumps,
    /// Constraints of all steps, and what their jumps differ from those of the prediction.
    rows: FluxConstraints,
    changes: Vec<f64>,
}

impl Windows<'_> {
    /// The surface at `time`, as it moves at `speed`.
    fn cut(&self, time: f64, speed: f64) -> CutFaces {
        let moved: Vec<_> = self.nodes.iter().map(|x| x * (1.0 + 0.1 * time)).collect();
        let mut cut = CutFaces::new(&self.flow.grid, &moved, self.faces, 0.0).expect("inside");
        cut.rows.target.iter_mut().for_each(|flux| *flux = 1e-3 * speed);
        cut
    }

    fn predict(&mut self, time: f64, dt: f64) {
        let (flow, faces) = (&mut self.flow, self.faces);
        let moved: Vec<_> = self.nodes.iter().map(|x| x * (1.0 + 0.1 * time)).collect();
        let mut friction = Friction::new(&flow.grid, &moved, faces).expect("inside");
        friction.set_velocities(faces, &vec![Vector3::new(0.1, 0.0, -0.2); moved.len()]);
        let edges = EdgeFluxes::new(&flow.grid, &moved, &free_edges(faces)).expect("inside");
        flow.predict_around(dt, Vector3::new(0.0, 0.1, 0.2), &edges, Some(&mut friction));
        let mut forces = vec![0.0; 3 * faces.len()];
        friction.add_face_forces(&(0..faces.len() as u32).collect::<Vec<_>>(), &mut forces);
        flow.slabs().ranks().sum(&mut forces);
        self.friction.extend(forces);
    }

    fn jumps(&mut self, cut: &CutFaces, fluxes: &PredictedFluxes) -> PressureJumps {
        self.flow.start_from(Vec::new());
        self.flow.solve_constraints_from(&cut.rows, fluxes, None)
    }

    /// Solves `count` steps of a window, predicted for half of the speed.
    fn solve(&mut self, time: f64, speed: f64, dt: f64, count: usize) -> Solved {
        self.friction.clear();
        let at = |step: usize| time + dt * step as f64;
        let mut rows = FluxConstraints::new(&self.flow.grid);
        let (mut fluxes, mut predicted) = (Vec::new(), Vec::new());
        for step in 0..count {
            self.predict(at(step), dt);
            let cut = self.cut(at(step), 0.5 * speed);
            fluxes.push(self.flow.predicted_fluxes(&cut.rows));
            rows.append(&cut.rows);
            if step + 1 < count {
                let jumps = self.jumps(&cut, &fluxes[step]);
                if self.repeated && step == 0 {
                    self.flow.accept_and_keep(&cut.rows, &jumps);
                } else {
                    self.flow.accept(&cut.rows, &jumps);
                }
                predicted.extend(jumps.jump);
            }
        }
        let motions: &[f64] = if self.repeated { &[2.0, -1.0, 1.0] } else { &[1.0] };
        let mut last = None;
        for motion in motions {
            let (mut changes, mut first) = (vec![0.0; rows.len()], 0);
            for (step, fluxes) in fluxes.iter().enumerate() {
                let cut = self.cut(at(step), motion * speed);
                let earlier = self.flow.flux_changes(&rows, &changes);
                let jumps = self.jumps(&cut, &fluxes.clone().changed_by(&earlier[first..]));
                for (i, predicted) in predicted.iter().enumerate().skip(first).take(jumps.jump.len()) {
                    changes[i] = jumps.jump[i - first] - predicted;
                }
                first += jumps.jump.len();
                last = Some((cut, jumps));
            }
            if let Some((cut, jumps)) = last.take_if(|_| *motion == 1.0) {
                return Solved { cut, jumps, rows, changes };
            }
        }
        unreachable!("the last motion is 1")
    }
}

/// Velocity, rates and friction at the end of windows of one to four steps.
pub fn windows(
    ranks: Rc<dyn Ranks>,
    device: Option<Rc<dyn Device>>,
    nodes: &[Vector3<f64>],
    faces: &[[u32; 3]],
    repeated: bool,
) -> Vec<f64> {
    let axis = || Axis::stretched([-1.0, 1.0], 0.125, [1.0, 2.0], 1.3, 2);
    let open = Ends::Open([End::Outflow, End::Inflow]);
    let grid = Grid::new([Axis::even(-1.5, 1.5, 24), axis(), axis()], [Ends::Periodic, open, open]);
    let momentum = Momentum { upwind_share: 0.7, viscosity: 0.02 };
    let settings = Settings { density: 1.2, far: Vector3::new(0.4, 0.3, -1.0), momentum, tolerance: 1e-6 };
    let mut flow = Flow::on_ranks(grid, settings, ranks).expect("slabs");
    flow.set_device(device).expect("memory");
    let mut windows = Windows { flow, nodes, faces, repeated, friction: Vec::new() };
    let mut friction = Vec::new();
    for (index, count) in [3, 1, 2, 4, 1].into_iter().enumerate() {
        let time = 0.1 * index as f64;
        if repeated {
            windows.solve(time, 0.5, 0.03, 3);
            windows.flow.return_to_start();
        }
        let Solved { cut, jumps, rows, changes } = windows.solve(time, 1.0, 0.06 / count as f64, count);
        windows.flow.accept_after(&cut.rows, &jumps, (count > 1).then_some((&rows, &changes[..])));
        windows.flow.release_kept();
        friction.extend_from_slice(&windows.friction);
    }
    let mut flow = windows.flow;
    flow.gather();
    // Once more changes nothing.
    flow.gather();
    let state = flow.state();
    let all = state.velocity.into_iter().chain(state.rates).flatten();
    let all = all.chain(state.jump).chain(friction).chain(flow.pressures());
    all.chain(state.wall_rates.iter().map(|(_, rate)| rate)).collect()
}
