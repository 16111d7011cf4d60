//! Schemes against a closed-form added-mass problem: a tensioned membrane
//! (modes of a string) on a fluid whose only effect is an added mass per mode.

use std::path::Path;

use case::{Acceleration, Coupling, Role, Scheme};
use channel::{LOAD_WIDTH, Stats, Window, flow_stats};

use super::*;
use crate::descent::DescentModel;
use crate::error::RunError;
use crate::partners::{Answer, LoadOverWindow, Partners};

const NODES: usize = 24;
const DT: f64 = 5e-3;
const SUBSTEPS: u32 = 10;
/// Weight of the falling body that the descent tests use, kg.
const BODY: f64 = 100.0;

/// Position, velocity, acceleration of a mode.
#[derive(Clone, Copy, Default)]
struct Mode {
    x: f64,
    v: f64,
    a: f64,
}

/// Newmark (gamma 1/2, beta 1/4) over the substeps, load linear in time.
fn newmark(start: Mode, mass: f64, stiffness: f64, load: [f64; 2], dt: f64) -> Mode {
    let h = dt / f64::from(SUBSTEPS);
    (1..=SUBSTEPS).fold(start, |s, i| {
        let load = load[0] + (load[1] - load[0]) * f64::from(i) / f64::from(SUBSTEPS);
        let known = s.x + h * s.v + 0.25 * h * h * s.a;
        let a = (load - stiffness * known) / (mass + 0.25 * h * h * stiffness);
        Mode { x: known + 0.25 * h * h * a, v: s.v + 0.5 * h * (s.a + a), a }
    })
}

/// Membrane and fluid as participants: node `i` moves in z and carries face `i`.
struct AddedMass {
    stiffness: Vec<f64>,
    added: Vec<f64>,
    body_added: f64,
    drag: f64,
    accepted: Vec<Mode>,
    trial: Vec<Mode>,
    fluid: [Vec<f64>; 2],
    grid: Vec<f64>,
    velocity: [f64; 2],
}

impl AddedMass {
    /// Fabric of unit modal mass; the first mode carries `ratio` times as much air.
    fn new(ratio: f64) -> Self {
        let angle = |j: usize| std::f64::consts::PI * (j + 1) as f64 / (NODES + 1) as f64;
        Self {
            stiffness: (0..NODES).map(|j| 3e4 * (2.0 - 2.0 * angle(j).cos())).collect(),
            added: (0..NODES).map(|j| ratio / (j + 1) as f64).collect(),
            body_added: 0.0,
            drag: 0.0,
            accepted: vec![Mode::default(); NODES],
            trial: vec![Mode::default(); NODES],
            fluid: [vec![0.0; NODES], vec![0.0; NODES]],
            grid: vec![0.0; NODES],
            velocity: [0.0; 2],
        }
    }

    fn shape(j: usize, i: usize) -> f64 {
        let n = (NODES + 1) as f64;
        (2.0 / n).sqrt() * (std::f64::consts::PI * ((j + 1) * (i + 1)) as f64 / n).sin()
    }

    fn modal(values: impl Fn(usize) -> f64) -> Vec<f64> {
        (0..NODES).map(|j| (0..NODES).map(|i| Self::shape(j, i) * values(i)).sum()).collect()
    }

    fn nodal(modes: &[f64], i: usize) -> f64 {
        modes.iter().enumerate().map(|(j, m)| Self::shape(j, i) * m).sum()
    }

    /// Pressure that drives mode `j`, before the added mass: a steady push.
    fn drive(j: usize) -> f64 {
        Self::modal(|_| 200.0)[j]
    }

    /// Fluid pressure of mode `j` at window end position `x`: affine in it.
    fn pressure(&self, j: usize, x: f64, dt: f64) -> f64 {
        let acceleration = (x - 2.0 * self.fluid[0][j] + self.fluid[1][j]) / (dt * dt);
        Self::drive(j) - self.added[j] * acceleration
    }
}

impl Partners for AddedMass {
    fn structure(
        &mut self,
        w: &Window,
        load: LoadOverWindow<'_>,
        displacement: &mut [f64],
    ) -> Result<Answer, RunError> {
        let start = Self::modal(|i| load.start[i * LOAD_WIDTH]);
        let end = Self::modal(|i| load.end[i * LOAD_WIDTH]);
        for j in 0..NODES {
            self.trial[j] = newmark(self.accepted[j], 1.0, self.stiffness[j], [start[j], end[j]], w.dt);
        }
        let positions: Vec<f64> = self.trial.iter().map(|m| m.x).collect();
        for (i, node) in displacement.chunks_exact_mut(3).enumerate() {
            let z = Self::nodal(&positions, i);
            // Tangential motion follows and does not move the air.
            node.copy_from_slice(&[0.3 * z, 0.0, z]);
        }
        Ok(Answer::default())
    }

    fn mesh(&mut self, _w: &Window, displacement: &[f64]) -> Result<Answer, RunError> {
        self.grid = Self::modal(|i| displacement[3 * i + 2]);
        Ok(Answer::default())
    }

    fn flow(&mut self, w: &Window, load: &mut [f64]) -> Result<Answer, RunError> {
        let modes: Vec<f64> = (0..NODES).map(|j| self.pressure(j, self.grid[j], w.dt)).collect();
        for (i, face) in load.chunks_exact_mut(LOAD_WIDTH).enumerate() {
            face.copy_from_slice(&[Self::nodal(&modes, i), 0.0, 0.0, 0.0]);
        }
        let v = w.frame_velocity[2];
        self.velocity[1] = v;
        let mut stats = Stats::default();
        stats.values[flow_stats::FORCE + 2] =
            self.drag * v * v - self.body_added * (v - self.velocity[0]) / w.dt;
        Ok(Answer { stats, wall_s: 0.0 })
    }

    fn accept(&mut self, _w: &Window) -> Result<(), RunError> {
        self.accepted.copy_from_slice(&self.trial);
        let last = std::mem::replace(&mut self.fluid[0], self.grid.clone());
        self.fluid[1] = last;
        self.velocity[0] = self.velocity[1];
        Ok(())
    }

    fn save(&mut self, _folder: &Path) -> Result<(), RunError> {
        Ok(())
    }

    fn snapshot(&mut self, _role: Role, _time: f64, _folder: &Path) -> Result<(), RunError> {
        Ok(())
    }
}

fn coupling(acceleration: Acceleration, relaxation: f64) -> Coupling {
    Coupling { acceleration, relaxation, max_iterations: 60, tolerance: 1e-6, ..Coupling::default() }
}

fn window_loop(coupling: &Coupling, descent: Option<DescentModel>, velocity: f64) -> WindowLoop {
    let unknowns = Unknowns::new(NODES, DT, descent.is_some());
    let mut fields = vec![Field { range: 0..3 * NODES, floor: 1e-7 }];
    if descent.is_some() {
        fields.push(Field { range: 3 * NODES..3 * NODES + 1, floor: 1e-7 });
    }
    let state = InterfaceState {
        displacement: vec![0.0; 3 * NODES],
        load: Some(vec![0.0; NODES * LOAD_WIDTH]),
        velocity,
        acceleration: 0.0,
    };
    let criterion = Criterion { fields, tolerance: coupling.tolerance };
    WindowLoop::new("test", coupling, unknowns, criterion, NODES, descent, state, false)
}

fn window(index: u64) -> Window {
    Window {
        index,
        substeps: u64::from(SUBSTEPS),
        time: index as f64 * DT,
        dt: DT,
        ..Window::default()
    }
}

/// Iterations of each window; error of the last positions against the exact solution
/// of the coupled discrete equations, relative to the largest.
fn fly(mass_ratio: f64, coupling: &Coupling, windows: u64) -> Result<(Vec<u32>, f64), RunError> {
    let mut model = AddedMass::new(mass_ratio);
    let mut exact = AddedMass::new(mass_ratio);
    let mut loads = vec![0.0; NODES];
    let mut scheme = window_loop(coupling, None, 0.0);
    let mut iterations = Vec::new();
    for index in 0..windows {
        iterations.push(scheme.run(&mut model, window(index))?.iterations);
        // Both answers are affine in their input, so each mode is one equation.
        let mut positions = vec![0.0; NODES];
        for j in 0..NODES {
            let start = loads[j];
            let answer = |end| newmark(exact.accepted[j], 1.0, exact.stiffness[j], [start, end], DT);
            let (alpha, beta) = (answer(0.0).x, answer(1.0).x - answer(0.0).x);
            let gamma = exact.pressure(j, 0.0, DT);
            let delta = exact.pressure(j, 1.0, DT) - gamma;
            positions[j] = (alpha + beta * gamma) / (1.0 - beta * delta);
            loads[j] = gamma + delta * positions[j];
            exact.trial[j] = answer(loads[j]);
        }
        exact.grid = positions;
        exact.accept(&window(index))?;
    }
    let largest = exact.accepted.iter().fold(0.0f64, |m, s| m.max(s.x.abs()));
    let error =
        model.accepted.iter().zip(&exact.accepted).fold(0.0f64, |m, (a, b)| m.max((a.x - b.x).abs()));
    Ok((iterations, error / largest))
}

#[test]
fn iqn_ils_converges_for_every_mass_ratio() {
    for ratio in [0.1, 1.0, 10.0, 50.0, 100.0, 1000.0] {
        let (iterations, error) = fly(ratio, &coupling(Acceleration::IqnIls, 0.05), 60).unwrap();
        let mean = f64::from(iterations.iter().sum::<u32>()) / iterations.len() as f64;
        let late = f64::from(iterations[40..].iter().sum::<u32>()) / 20.0;
        println!("ratio {ratio}: {iterations:?} mean {mean:.2}, late {late:.2}, error {error:.1e}");
        assert!(error < 1e-4, "ratio {ratio}: error {error:.1e}");
        assert!(mean < 12.0, "ratio {ratio}: {mean} iterations a window");
    }
}
