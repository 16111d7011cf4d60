//! Drag of rigid shapes in laminar flow with no slip.
//!
//! `cargo run --release -p immersed --example viscous -- [plate|sphere|cylinder] [cells across] [end, D/U] [Reynolds number] [upwind share]
//! [perturbation, share of the stream] [far field across, D] [1: no slip, 0: slip] [Courant number] [offset in a cell: x, y, z]
//! [1: upwind differences at free edges, 0: the same share as elsewhere] [none|smagorinsky|wale]`; on a GPU with `DEVICE=gpu`
//!
//! The cylinder spans a grid of four cells that is periodic along its axis: two-dimensional flow.

use std::time::Instant;

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::eddy_viscosity::SubgridModel;
use immersed::face_transfer::FaceTransfer;
use immersed::flow::{Flow, Settings};
use immersed::free_edges::{EdgeFluxes, free_edges};
use immersed::friction::Friction;
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes::{self, Surface};
use immersed::slabs::Alone;
use nalgebra::Vector3;

/// Lines of the history that are printed.
const LINES: usize = 10;
/// Courant number and diffusion number of a step, as in the flow-solver.
const MAX_COURANT: f64 = 0.4;
/// Largest velocity, of the stream, and by how much the sum over the axes exceeds it.
const FASTEST: f64 = 2.2;
/// Largest rate of an eddy viscosity, in speeds of the stream over cells.
const EDDIES: f64 = 1.5;

fn argument(k: usize, default: f64) -> f64 {
    std::env::args().nth(k).map_or(default, |a| a.parse().expect("a number"))
}

/// The shape, with a diameter of 1, off the symmetric place in its cell.
fn surface(shape: &str, across: usize) -> Surface {
    let [x, y, z] = [(10, 0.07), (11, 0.11), (12, -0.13)].map(|(k, default)| argument(k, default));
    let h = 1.0 / across as f64;
    let (nodes, faces) = match shape {
        "plate" => shapes::plate(across),
        "sphere" => shapes::sphere(0.5, (across as f64 * 1.5).log2().ceil() as u32),
        _ => shapes::cylinder(0.5, 4 * across, 5.0 * h),
    };
    let middle = if shape == "cylinder" { 2.0 * h } else { 0.0 };
    let offset = Vector3::new(x * h, y * h + middle, z * h);
    (nodes.iter().map(|x| x + offset).collect(), faces)
}

/// An even core around the shape and 1.5 diameters of its wake along z, and flanks to `far` diameters around and 2 `far` behind.
fn grid(shape: &str, across: f64, far: f64) -> Grid {
    let h = 1.0 / across;
    let side = || Axis::stretched([-0.5 - 4.0 * h, 0.5 + 4.0 * h], h, [far - 0.5; 2], 1.12, 2);
    let along = Axis::stretched([-0.5 - 4.0 * h, 2.0 + 4.0 * h], h, [far - 0.5, 2.0 * far - 2.0], 1.12, 2);
    let slip = Ends::Open([End::Slip; 2]);
    let open = Ends::Open([End::Inflow, End::Outflow]);
    if shape == "cylinder" {
        Grid::new([side(), Axis::even(0.0, 4.0 * h, 4), along], [slip, Ends::Periodic, open])
    } else {
        Grid::new([side(), side(), along], [slip, slip, open])
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Force coefficients of a step.
#[derive(Clone, Copy, Default)]
struct Coefficients {
    /// Drag by the forces at cut faces, by those normal to the faces of the surface, and by friction.
    cut: f64,
    normal: f64,
    friction: f64,
    /// Side force along x, and the size of that across the stream; normal and friction.
    lift: f64,
    side: f64,
}

/// The surface with its constraints and its friction.
struct Case {
    faces: Vec<[u32; 3]>,
    nodes: usize,
    own: Vec<u32>,
    cut: CutFaces,
    transfer: FaceTransfer,
    edges: EdgeFluxes,
    friction: Option<Friction>,
    area: f64,
}

impl Case {
    fn new(shape: &str, across: usize, flow: &Flow, no_slip: bool) -> Self {
        let (nodes, faces) = surface(shape, across);
        let inside = "a surface in the even core";
        let cut = CutFaces::new(&flow.grid, &nodes, &faces, 0.0).expect(inside);
        let own: Vec<u32> = (0..faces.len() as u32).collect();
        let transfer = FaceTransfer::new(&flow.grid, &nodes, &faces, &own, &cut, &Alone).expect(inside);
        let clock = Instant::now();
        let friction = no_slip.then(|| Friction::new(&flow.grid, &nodes, &faces).expect(inside));
        println!(
            "# {} constraints of {} cut faces, {} segments crossed, found in {:.1} ms",
            cut.rows.len(),
            cut.crossings().len(),
            friction.as_ref().map_or(0, Friction::len),
            1e3 * clock.elapsed().as_secs_f64()
        );
        let upwind = argument(13, 1.0) > 0.0;
        let edges = if upwind { free_edges(&faces) } else { Vec::new() };
        let edges = EdgeFluxes::new(&flow.grid, &nodes, &edges).expect(inside);
        let area = match shape {
            "plate" => 1.0,
            "sphere" => std::f64::consts::FRAC_PI_4,
            _ => 4.0 / across as f64,
        };
        Self { nodes: nodes.len(), faces, own, cut, transfer, edges, friction, area }
    }

    /// One step; seconds of the prediction and of the rest.
    fn step(&mut self, flow: &mut Flow, dt: f64) -> (Coefficients, [f64; 2]) {
        let clock = Instant::now();
        flow.predict_around(dt, Vector3::zeros(), &self.edges, self.friction.as_mut());
        let predicted = clock.elapsed().as_secs_f64();
        let jumps = flow.solve_constraints(&self.cut.rows);
        flow.accept(&self.cut.rows, &jumps);
        let parts = [predicted, clock.elapsed().as_secs_f64() - predicted];
        let mut at_nodes = vec![Vector3::zeros(); self.nodes];
        self.cut.add_forces(&self.faces, &jumps.jump, &mut at_nodes);
        let mut normal = vec![Vector3::zeros(); self.own.len()];
        let mut wall = vec![0.0; 3 * self.own.len()];
        self.transfer.add_forces(&jumps.jump, &mut normal);
        if let Some(friction) = &self.friction {
            friction.add_face_forces(&self.own, &mut wall);
        }
        let wall: Vec<_> = wall.chunks_exact(3).map(Vector3::from_column_slice).collect();
        let total = |forces: &[Vector3<f64>]| forces.iter().sum::<Vector3<f64>>() / (0.5 * self.area);
        let [cut, normal, wall] = [&at_nodes, &normal, &wall].map(|f| total(f));
        let both = normal + wall;
        (
            Coefficients {
                cut: cut.z,
                normal: normal.z,
                friction: wall.z,
                lift: both.x,
                side: both.xy().norm(),
            },
            parts,
        )
    }
}

/// Strouhal number by the upward crossings of the mean, and half the range, of the side force; `dt` s between values.
fn oscillation(lift: &[f64], dt: f64) -> (f64, f64) {
    let average = mean(lift);
    let up: Vec<usize> = (1..lift.len()).filter(|i| lift[i - 1] < average && lift[*i] >= average).collect();
    let range = lift.iter().fold([f64::MAX, f64::MIN], |[l, h], x| [l.min(*x), h.max(*x)]);
    let periods = up.len().saturating_sub(1) as f64;
    let time = up.last().zip(up.first()).map_or(f64::INFINITY, |(last, first)| dt * (last - first) as f64);
    (periods / time, 0.5 * (range[1] - range[0]))
}

/// Means of steps, and the oscillation of the side force.
fn summary(steps: &[Coefficients], dt: f64) -> String {
    let of = |f: fn(&Coefficients) -> f64| mean(&steps.iter().map(f).collect::<Vec<_>>());
    let lift: Vec<f64> = steps.iter().map(|c| c.lift).collect();
    let (strouhal, amplitude) = oscillation(&lift, dt);
    format!(
        "drag {:.4} (at cut faces {:.4}), pressure {:.4}, friction {:.4}; side {:.4}, along x {:.4} +- {amplitude:.4}, Strouhal number {strouhal:.4}",
        of(|c| c.normal + c.friction),
        of(|c| c.cut + c.friction),
        of(|c| c.normal),
        of(|c| c.friction),
        of(|c| c.side),
        mean(&lift)
    )
}

fn model() -> Option<SubgridModel> {
    match std::env::args().nth(14).as_deref() {
        None | Some("none") => None,
        Some("smagorinsky") => Some(SubgridModel::Smagorinsky),
        Some("wale") => Some(SubgridModel::Wale),
        Some(other) => panic!("{other}: none, smagorinsky or wale"),
    }
}

fn main() {
    let shape = std::env::args().nth(1).unwrap_or("plate".into());
    let (across, end, reynolds) = (argument(2, 16.0), argument(3, 20.0), argument(4, 200.0));
    let (share, perturbation, far) = (argument(5, 0.0), argument(6, 0.0), argument(7, 5.0));
    let grid = grid(&shape, across, far);
    let eddies = if model().is_some() { EDDIES * across } else { 0.0 };
    let rate = FASTEST * across + 12.0 * across * across / reynolds + eddies;
    let steps = (end * rate / argument(9, MAX_COURANT)).ceil() as usize;
    let dt = end / steps as f64;
    let momentum = Momentum { upwind_share: share, viscosity: 1.0 / reynolds };
    let settings = Settings { density: 1.0, far: Vector3::z(), momentum, tolerance: 1e-3 };
    let (cells, extents) = (grid.count(), grid.cells());
    println!("# {shape} at Re {reynolds}, upwind share {share}: {cells} cells {extents:?}, {steps} steps");
    let mut flow = Flow::new(grid, settings);
    flow.set_subgrid_model(model());
    flow.perturb(perturbation);
    if std::env::var("DEVICE").as_deref() == Ok("gpu") {
        let device = gpu::open().unwrap_or_else(|e| panic!("{e}"));
        println!("# on {}", device.name());
        flow.set_device(Some(device)).unwrap_or_else(|e| panic!("{e}"));
    }
    let mut case = Case::new(&shape, across as usize, &flow, argument(8, 1.0) > 0.0);
    let (mut history, mut parts) = (Vec::with_capacity(steps), [0.0; 2]);
    let chunk = (steps / LINES).max(1);
    for k in 1..=steps {
        let (coefficients, seconds) = case.step(&mut flow, dt);
        history.push(coefficients);
        parts = [parts[0] + seconds[0], parts[1] + seconds[1]];
        if k % chunk == 0 {
            println!("{:7.2} D/U: {}", k as f64 * dt, summary(&history[k - chunk..], dt));
        }
    }
    flow.gather();
    println!("second half: {}", summary(&history[steps / 2..], dt));
    println!("last step: {}", summary(&history[steps - 1..], dt));
    let rates = [flow.largest_rate(Vector3::zeros()), flow.largest_eddy_rate(case.friction.as_ref())];
    println!(
        "# largest Courant number {:.2} at the end, rate of the eddy viscosity {:.2}",
        rates[0] * dt,
        rates[1] * dt
    );
    let per_cell = 1e6 / (cells * steps) as f64;
    println!(
        "# {:.4} us a cell and step in the prediction, {:.4} in the rest",
        parts[0] * per_cell,
        parts[1] * per_cell
    );
}
