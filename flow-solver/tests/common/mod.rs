//! Shared by the tests: a solver on one rank.
#![allow(dead_code)]

use comm::Comm;
use flow_solver::face_permeability::FacePermeability;
use flow_solver::geometry::vec3::Vec3;
use flow_solver::permeable::Permeability;
use flow_solver::physics::{Air, Gas, Isothermal, VELOCITY_DIFFUSION, Viscosity};
use flow_solver::residual::Spatial;
use flow_solver::topology::Topology;
use flow_solver::{Method, Settings, Solver, Step};
use mesh::{FaceTable, FlowGrid};

/// Air, wind and tolerances of the tests.
pub fn settings(wind: impl Into<Vec3>, drop: f64) -> Settings {
    let wind = wind.into();
    let speed = wind.norm();
    Settings {
        air: Air::new(1.225, 288.15),
        wind,
        residual_drop: drop,
        coupling: None,
        max_iterations: 100,
        method: Method::PressureCorrection { depth: 5 },
        reference_speed: 0.1 * speed,
        velocity_diffusion: VELOCITY_DIFFUSION,
        ambient_pressure: 0.0,
        moving: true,
    }
}

/// A solver for the whole of `grid`.
pub fn solver_of<G: Gas<N>, V: Viscosity, const N: usize>(
    grid: &FlowGrid,
    gas: G,
    viscosity: V,
    settings: Settings,
) -> Solver<G, N> {
    solver_with_cloth(grid, gas, viscosity, settings, None)
}

/// As [`solver_of`]; the grid is gone before the solver's arrays are filled.
pub fn solver_on<G: Gas<N>, V: Viscosity, const N: usize>(
    grid: FlowGrid,
    gas: G,
    viscosity: V,
    settings: Settings,
) -> Solver<G, N> {
    let faces = FaceTable::new(&grid).unwrap();
    let order: Vec<u32> = (0..grid.cells.len() as u32).collect();
    let part = vec![0; grid.cells.len()];
    let topology = Topology::new(&grid, &faces, &part, &order, 0, V::ACTIVE);
    let nodes = topology.node_global.iter().map(|&n| grid.coords[n as usize].into()).collect();
    drop((grid, faces, order, part));
    let spatial =
        Spatial { gas, viscosity: viscosity.into(), chi: 1.0 / 3.0, limiter: None, upwind_share: 1.0 };
    Solver::new(&Comm::solo(), topology, nodes, spatial, settings).unwrap()
}

/// A solver for the whole of `grid`, with a canopy of `cloth`.
pub fn solver_with_cloth<G: Gas<N>, V: Viscosity, const N: usize>(
    grid: &FlowGrid,
    gas: G,
    viscosity: V,
    settings: Settings,
    cloth: Option<Permeability>,
) -> Solver<G, N> {
    solver_with_cloths(grid, gas, viscosity, settings, &FacePermeability::uniform(cloth))
}

/// As [`solver_with_cloth`], each face of the canopy with a cloth of its own.
pub fn solver_with_cloths<G: Gas<N>, V: Viscosity, const N: usize>(
    grid: &FlowGrid,
    gas: G,
    viscosity: V,
    settings: Settings,
    cloths: &FacePermeability,
) -> Solver<G, N> {
    let faces = FaceTable::new(grid).unwrap();
    let order: Vec<u32> = (0..grid.cells.len() as u32).collect();
    let part = vec![0; grid.cells.len()];
    let topology = Topology::with_cloth(grid, &faces, &part, &order, 0, V::ACTIVE, cloths);
    let nodes = topology.node_global.iter().map(|&n| grid.coords[n as usize].into()).collect();
    let spatial =
        Spatial { gas, viscosity: viscosity.into(), chi: 1.0 / 3.0, limiter: None, upwind_share: 1.0 };
    Solver::new(&Comm::solo(), topology, nodes, spatial, settings).unwrap()
}

/// Isothermal.
pub fn isothermal<V: Viscosity>(grid: &FlowGrid, v: V, settings: Settings) -> Solver<Isothermal, 4> {
    solver_of(grid, Isothermal::new(settings.air), v, settings)
}

/// A step on a grid at rest.
pub fn at_rest(dt: f64) -> Step {
    Step { dt, frame: Vec3::zeros(), repeat: false, moved: false }
}

/// Small reproducible numbers in -1..1.
pub struct Noise(pub u64);

impl Noise {
    /// The next one.
    pub fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Force of the air on all no-slip walls, N.
pub fn wall_force(s: &Solver<Isothermal, 4>) -> Vec3 {
    let domain = s.domain();
    let of_side = |side: &flow_solver::topology::Side| {
        let face = &s.metrics.faces[side.face as usize];
        let pressure = s.spatial.wall_pressure(&domain, &s.q, &s.gradient, side);
        let shear = s.spatial.wall_traction(&domain, &s.scheme, &s.q, side);
        face.area * (pressure * side.sign) + shear * face.magnitude()
    };
    s.topology.no_slip.iter().map(of_side).sum()
}

/// `n` cells over `length`, the first of size `h`, growing by a constant factor: their ends.
pub fn growing(n: usize, length: f64, h: f64) -> Vec<f64> {
    let sum = |q: f64| (0..n).map(|k| h * q.powi(k as i32)).sum::<f64>();
    let (mut low, mut high) = (1.0, 3.0);
    for _ in 0..200 {
        let q = 0.5 * (low + high);
        *(if sum(q) < length { &mut low } else { &mut high }) = q;
    }
    let mut x = vec![0.0];
    (0..n).for_each(|k| x.push(x[k] + h * low.powi(k as i32)));
    x[n] = length;
    x
}
