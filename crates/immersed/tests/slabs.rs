//! The same flow on several ranks, which are threads here: slabs, exchanges and sums give the flow of one rank.

use std::rc::Rc;
use std::sync::{Arc, Barrier, Mutex};

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::eddy_viscosity::SubgridModel;
use immersed::flow::{Flow, PredictedFluxes, PressureJumps, Settings};
use immersed::free_edges::{EdgeFluxes, free_edges};
use immersed::friction::Friction;
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes;
use immersed::slabs::{Alone, Ranks, Slabs};
use nalgebra::Vector3;

/// What the threads of a flow share.
struct Shared {
    barrier: Barrier,
    posts: Mutex<Vec<Vec<f64>>>,
}

/// A thread as a rank.
#[derive(Clone)]
struct Thread {
    rank: usize,
    size: usize,
    shared: Arc<Shared>,
}

impl std::fmt::Debug for Thread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} of {}", self.rank, self.size)
    }
}

impl Thread {
    /// What every thread has posted.
    fn all(&self, own: &[f64]) -> Vec<Vec<f64>> {
        self.shared.posts.lock().expect("no panic")[self.rank] = own.to_vec();
        self.shared.barrier.wait();
        let all = self.shared.posts.lock().expect("no panic").clone();
        self.shared.barrier.wait();
        all
    }
}

impl Ranks for Thread {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn sum(&self, values: &mut [f64]) {
        let all = self.all(values);
        values.iter_mut().enumerate().for_each(|(i, v)| *v = all.iter().map(|of| of[i]).sum());
    }

    fn largest(&self, values: &mut [f64]) {
        let all = self.all(values);
        values
            .iter_mut()
            .enumerate()
            .for_each(|(i, v)| *v = all.iter().map(|of| of[i]).fold(f64::MIN, f64::max));
    }

    fn all_to_all(&self, send: &[f64], sent: &[usize], receive: &mut [f64], received: &[usize]) {
        let (data, counts) = (self.all(send), self.all(&sent.iter().map(|n| *n as f64).collect::<Vec<_>>()));
        let mut got = Vec::new();
        for (from, (data, counts)) in data.iter().zip(&counts).enumerate() {
            let start: f64 = counts[..self.rank].iter().sum();
            assert_eq!(counts[self.rank] as usize, received[from], "{self:?}");
            got.extend_from_slice(&data[start as usize..][..received[from]]);
        }
        receive.copy_from_slice(&got);
    }

    fn shift(&self, up: bool, send: &[f64], receive: &mut [f64]) {
        let all = self.all(send);
        let from = if up { self.rank.checked_sub(1) } else { Some(self.rank + 1).filter(|r| *r < self.size) };
        if let Some(from) = from {
            receive[..all[from].len()].copy_from_slice(&all[from]);
        }
    }

    fn gather(&self, values: &mut [f64], ends: &[usize]) {
        let all = self.all(values);
        for (rank, of) in all.iter().enumerate() {
            let start = if rank == 0 { 0 } else { ends[rank - 1] };
            values[start..ends[rank]].copy_from_slice(&of[start..ends[rank]]);
        }
    }
}

/// The result of `run` on each of `size` ranks.
fn on_threads<T: Send>(size: usize, run: impl Fn(Rc<dyn Ranks>) -> T + Sync) -> Vec<T> {
    let shared = Arc::new(Shared { barrier: Barrier::new(size), posts: Mutex::new(vec![Vec::new(); size]) });
    std::thread::scope(|scope| {
        let threads: Vec<_> = (0..size)
            .map(|rank| {
                let (shared, run) = (shared.clone(), &run);
                scope.spawn(move || run(Rc::new(Thread { rank, size, shared })))
            })
            .collect();
        threads.into_iter().map(|t| t.join().expect("a rank")).collect()
    })
}

/// The end of a run: complete velocity and pressure, jumps, friction, and what is reduced over the ranks.
#[derive(Debug)]
struct Outcome {
    velocity: Vec<f64>,
    pressure: Vec<f64>,
    jumps: Vec<f64>,
    friction: Vec<f64>,
    figures: Vec<f64>,
}

/// A surface that moves and is permeable, in a stream at an angle, over steps of several lengths and a new grid; all kinds of ends.
fn run(
    ranks: Rc<dyn Ranks>,
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

fn compare(what: &str, one: &[f64], other: &[f64]) {
    let size = one.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let error = one.iter().zip(other).fold(0.0f64, |most, (a, b)| most.max((a - b).abs()));
    println!("{what}: {error:e} of {size:e}");
    assert!(one.len() == other.len() && error < 1e-9 * size, "{what}: {error:e} of {size:e}");
}

/// Conjugate gradients end at 1e-12 of the load, so that results agree to some 1e-11.
#[test]
fn any_number_of_ranks_computes_the_same_flow() {
    let plate = shapes::plate(6);
    let sphere = shapes::sphere(0.45, 2);
    for (name, (nodes, faces), low, model) in [
        ("plate", &plate, End::Inflow, None),
        ("sphere", &sphere, End::Outflow, None),
        ("plate", &plate, End::Slip, None),
        ("plate", &plate, End::Inflow, Some(SubgridModel::Wale)),
        ("sphere", &sphere, End::Slip, Some(SubgridModel::Smagorinsky)),
    ] {
        let one = run(Rc::new(Alone), nodes, faces, low, model);
        assert_eq!(*one.figures.last().expect("figures") > 0.01, model.is_some());
        for size in [1, 2, 3, 5, 8] {
            for end in on_threads(size, |ranks| run(ranks, nodes, faces, low, model)) {
                println!("{name}, {low:?}, {model:?}, {size} ranks:");
                compare("velocity", &one.velocity, &end.velocity);
                compare("pressure", &one.pressure, &end.pressure);
                compare("jumps", &one.jumps, &end.jumps);
                compare("friction", &one.friction, &end.friction);
                compare("figures", &one.figures, &end.figures);
            }
        }
    }
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

impl Windows<'_> {
    /// Solves the step at `time` for a surface that moves at `speed`, from a prediction if `fluxes` are known.
    fn step(
        &mut self,
        time: f64,
        speed: f64,
        dt: f64,
        fluxes: Option<&PredictedFluxes>,
    ) -> (CutFaces, PressureJumps) {
        let (flow, faces) = (&mut self.flow, self.faces);
        let moved: Vec<_> = self.nodes.iter().map(|x| x * (1.0 + 0.1 * time)).collect();
        let mut cut = CutFaces::new(&flow.grid, &moved, faces, 0.0).expect("inside");
        cut.rows.target.iter_mut().for_each(|flux| *flux = 1e-3 * speed);
        if fluxes.is_none() {
            let mut friction = Friction::new(&flow.grid, &moved, faces).expect("inside");
            friction.set_velocities(faces, &vec![Vector3::new(0.1, 0.0, -0.2); moved.len()]);
            let edges = EdgeFluxes::new(&flow.grid, &moved, &free_edges(faces)).expect("inside");
            flow.predict_around(dt, Vector3::new(0.0, 0.1, 0.2), &edges, Some(&mut friction));
            let mut forces = vec![0.0; 3 * faces.len()];
            friction.add_face_forces(&(0..faces.len() as u32).collect::<Vec<_>>(), &mut forces);
            flow.slabs().ranks().sum(&mut forces);
            self.friction.extend(forces);
        }
        flow.start_from(Vec::new());
        let jumps = match fluxes {
            Some(fluxes) => flow.solve_constraints_from(&cut.rows, fluxes, None),
            None => flow.solve_constraints(&cut.rows),
        };
        (cut, jumps)
    }

    /// Solves `count` steps of a window but for the end of the last one.
    fn solve(&mut self, time: f64, speed: f64, dt: f64, count: usize) -> (CutFaces, PressureJumps) {
        self.friction.clear();
        let mut last = self.step(time, speed, dt, None);
        let fluxes = self.flow.predicted_fluxes(&last.0.rows);
        let motions: &[f64] = if self.repeated { &[2.0, -1.0, 1.0] } else { &[1.0] };
        for (solve, motion) in motions.iter().enumerate() {
            if solve > 0 && count > 1 {
                self.flow.return_to_prediction();
            }
            last = self.step(time, motion * speed, dt, Some(&fluxes));
            let of_first = 3 * self.faces.len();
            self.friction.truncate(of_first);
            for step in 1..count {
                if self.repeated && step == 1 {
                    self.flow.accept_and_keep(&last.0.rows, &last.1);
                } else {
                    self.flow.accept(&last.0.rows, &last.1);
                }
                last = self.step(time + dt * step as f64, motion * speed, dt, None);
            }
        }
        last
    }
}

/// Velocity, rates and friction at the end of windows of one to four steps.
fn windows(ranks: Rc<dyn Ranks>, nodes: &[Vector3<f64>], faces: &[[u32; 3]], repeated: bool) -> Vec<f64> {
    let axis = || Axis::stretched([-1.0, 1.0], 0.125, [1.0, 2.0], 1.3, 2);
    let open = Ends::Open([End::Outflow, End::Inflow]);
    let grid = Grid::new([Axis::even(-1.5, 1.5, 24), axis(), axis()], [Ends::Periodic, open, open]);
    let momentum = Momentum { upwind_share: 0.7, viscosity: 0.02 };
    let settings = Settings { density: 1.2, far: Vector3::new(0.4, 0.3, -1.0), momentum, tolerance: 1e-6 };
    let flow = Flow::on_ranks(grid, settings, ranks).expect("slabs");
    let mut windows = Windows { flow, nodes, faces, repeated, friction: Vec::new() };
    let mut friction = Vec::new();
    for (index, count) in [3, 1, 2, 4, 1].into_iter().enumerate() {
        let time = 0.1 * index as f64;
        if repeated {
            windows.solve(time, 0.5, 0.03, 3);
            windows.flow.return_to_start();
        }
        let (cut, jumps) = windows.solve(time, 1.0, 0.06 / count as f64, count);
        windows.flow.accept(&cut.rows, &jumps);
        windows.flow.release_kept();
        friction.extend_from_slice(&windows.friction);
    }
    let mut flow = windows.flow;
    flow.gather();
    let state = flow.state();
    let all = state.velocity.into_iter().chain(state.rates).flatten();
    all.chain(state.jump).chain(friction).chain(flow.pressures()).collect()
}

/// What precedes the last solution of a window leaves no trace, on any number of ranks.
#[test]
fn repeated_and_rejected_windows_change_no_digit() {
    let (nodes, faces) = shapes::sphere(0.45, 2);
    for size in [1, 3] {
        let run = |repeated| on_threads(size, |ranks| windows(ranks, &nodes, &faces, repeated));
        for (rank, (once, repeated)) in run(false).iter().zip(&run(true)).enumerate() {
            let differ = once.iter().zip(repeated).position(|(a, b)| a.to_bits() != b.to_bits());
            assert!(
                once.len() == repeated.len() && differ.is_none(),
                "rank {rank} of {size}: value {differ:?}"
            );
        }
    }
}

#[test]
fn more_ranks_than_slabs_are_refused() {
    let axis = || Axis::even(0.0, 1.0, 7);
    let slip = Ends::Open([End::Slip, End::Slip]);
    let grid = Grid::new([axis(), axis(), axis()], [slip, slip, slip]);
    let words = on_threads(4, |ranks| Slabs::new(ranks, &grid).expect_err("too many").to_string());
    assert!(
        words.iter().all(|w| w.contains("7 cells along z") && w.contains("ranks.flow to 3")),
        "{words:?}"
    );
}
