//! The developer's command `alone`: a prescribed motion without partners.

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::time::Instant;

use case::Scene;
use channel::{Fault, Input, Participant, Window, mesh_stats};
use clap::Parser;
use comm::Comm;
use mesh::{Point, StructureMesh};

use crate::motion::Limits;
use crate::participant::{MeshMover, Setup, owners, regridder};
use crate::resample::resample;

/// Moves the grid of a scene without structure and flow: the canopy oscillates about its start shape, and each window
/// is solved several times with a decreasing error, as in a coupled run. Prints quality, iterations and seconds.
///
/// Example: mpirun -n 2 mesh-mover alone --scene cases/atps-descent/scene.toml
/// --out runs/atps-descent --stage 2
#[derive(Clone, Debug, Parser)]
#[command(name = "mesh-mover alone")]
pub struct StandaloneArgs {
    /// Scene file.
    #[arg(long, value_name = "PATH")]
    pub scene: PathBuf,
    /// Stage to start: its grid is built around the shape that an earlier stage wrote to `--out`.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub stage: usize,
    /// Folder of the run's results.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
    /// Ranks, as passed to `mpirun -n` (checked where given).
    #[arg(long, value_name = "N")]
    pub ranks: Option<usize>,
    /// Number of windows.
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub windows: u64,
    /// Coupling iterations per window.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub iterations: u64,
    /// Relative amplitude of the canopy's oscillation about its axis.
    #[arg(long, value_name = "SHARE", default_value_t = 0.1)]
    pub amplitude: f64,
    /// Canopy shape (a `canopy.bin`) to move to in a straight line, instead of oscillating.
    #[arg(long, value_name = "PATH")]
    pub toward: Option<PathBuf>,
    /// Scene of the canopy mesh of `--toward`, where it is another one.
    #[arg(long, value_name = "PATH", requires = "toward")]
    pub toward_scene: Option<PathBuf>,
    /// Build the start grid around the shape at this fraction of the distance from the unstressed canopy to
    /// `--toward`, instead of the shape of an earlier stage.
    #[arg(long, value_name = "SHARE", requires = "toward")]
    pub from: Option<f64>,
    /// Draw cross-sections through the middle of the grid at the start and at the end: PATH-start.svg, PATH-end.svg
    /// (on one rank).
    #[arg(long, value_name = "PATH")]
    pub cut: Option<PathBuf>,
    /// Print every N-th window.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub every: u64,
    /// Windows per period of the oscillation.
    #[arg(long, value_name = "N", default_value_t = 40.0)]
    pub period: f64,
}

impl StandaloneArgs {
    /// Parses the arguments after the word `alone`; ends the process where they are invalid.
    pub fn parse_after_verb() -> Self {
        Self::parse_from(std::env::args_os().take(1).chain(std::env::args_os().skip(2)))
    }
}

/// Runs the command. Collective.
///
/// # Errors
/// Errors of the mesh-mover.
pub fn run(scene: &Scene, args: &StandaloneArgs, comm: &Comm) -> Result<(), Fault> {
    if args.stage >= scene.stages.len() {
        return Err(Fault::new(format!("the scene has {} stages, counted from 0", scene.stages.len())));
    }
    let clock = Instant::now();
    let structure = mesh::structure_mesh(scene).map_err(Fault::new)?;
    let goal = args.toward.as_ref().map(|path| goal(path, args, &structure)).transpose()?;
    let mover = match (&goal, args.from) {
        (Some(goal), Some(share)) => on_the_way(scene, &structure, goal, share, comm)?,
        _ => MeshMover::new(scene, args.stage, &args.out, comm)?,
    };
    let mut run = PrescribedMotionRun::new(scene, args, comm, &structure, goal, mover);
    run.say_start(clock);
    run.draw("start")?;
    for index in 0..args.windows {
        run.window(index)?;
    }
    run.draw("end")?;
    run.say_end();
    Ok(())
}

/// A mover whose grid is built around the shape at fraction `share` of the distance to `goal`.
fn on_the_way(
    scene: &Scene,
    structure: &StructureMesh,
    goal: &[Point],
    share: f64,
    comm: &Comm,
) -> Result<MeshMover, Fault> {
    let unstressed = &structure.coords[..structure.n_canopy];
    let mix = |(x, g): (&Point, &Point)| [0, 1, 2].map(|i| x[i] + share * (g[i] - x[i]));
    let positions: Vec<_> = unstressed.iter().zip(goal).map(mix).collect();
    let grid = mesh::flow_grid(scene, structure, &positions).map_err(Fault::new)?;
    let owner = owners(&grid, comm.size())?;
    let setup = Setup {
        grid: &grid,
        structure,
        owner: &owner,
        mover: crate::movers::mover(&scene.mesh),
        limits: Limits::from(&scene.mesh),
        state: None,
        outer: scene.mesh.outer_boundary,
        regridder: regridder(scene, structure, &grid),
        bodies: Default::default(),
    };
    MeshMover::on_grid(setup, comm)
}

/// A mover with its prescribed motion and the cost so far.
struct PrescribedMotionRun<'a> {
    args: &'a StandaloneArgs,
    comm: &'a Comm,
    structure: &'a StructureMesh,
    goal: Option<Vec<Point>>,
    mover: MeshMover,
    /// Length of a window, s.
    dt: f64,
    /// Canopy at the start.
    start: Vec<f64>,
    displacement: Vec<f64>,
    output: Vec<f64>,
    seconds: f64,
    /// Iterations of the linear solver.
    iterations: f64,
    /// Smallest quality so far.
    worst: f64,
}

impl<'a> PrescribedMotionRun<'a> {
    fn new(
        scene: &Scene,
        args: &'a StandaloneArgs,
        comm: &'a Comm,
        structure: &'a StructureMesh,
        goal: Option<Vec<Point>>,
        mover: MeshMover,
    ) -> Self {
        let start = mover.positions().canopy.clone();
        Self {
            args,
            comm,
            structure,
            goal,
            dt: scene.stages[args.stage].window_s,
            displacement: vec![0.0; start.len()],
            start,
            output: vec![0.0; 6 * mover.output_rows().len()],
            mover,
            seconds: 0.0,
            iterations: 0.0,
            worst: f64::INFINITY,
        }
    }

    fn say(&self, line: impl Display) {
        if self.comm.is_root() {
            println!("{line}");
        }
    }

    fn cells(&self) -> f64 {
        self.mover.motion().grid.n_cells_global as f64
    }

    fn say_start(&self, clock: Instant) {
        let motion = self.mover.motion();
        let shape = motion.shape(&self.mover.positions().grid);
        self.say(format_args!(
            "{} grid nodes, {} cells, {} ranks: start {:.2} s, {:.0} bytes per cell, worst scaled Jacobian {:.4} (cell {})",
            motion.grid.n_global,
            self.cells(),
            self.comm.size(),
            clock.elapsed().as_secs_f64(),
            motion.bytes() as f64 * self.comm.size() as f64 / self.cells(),
            shape.quality,
            shape.cell,
        ));
    }

    /// Draws a cross-section through the grid where the command line requests it.
    fn draw(&self, name: &str) -> Result<(), Fault> {
        let Some(path) = &self.args.cut else { return Ok(()) };
        let at = self.mover.positions();
        let nodes = at.canopy.as_chunks::<3>().0;
        let mean = |i: usize| nodes.iter().map(|p| p[i]).sum::<f64>() / nodes.len() as f64;
        let half = 1.6 * nodes.iter().map(|p| (p[0] - mean(0)).abs()).fold(0.0, f64::max);
        // Slightly off the centre, where a layer of faces may lie.
        let grid = &self.mover.motion().grid;
        let svg = crate::cross_section::cross_section(
            grid,
            &at.grid,
            mean(1) + 0.03 * half,
            [mean(0), mean(2)],
            half,
        );
        let path = format!("{}-{name}.svg", path.display());
        std::fs::write(&path, svg).map_err(|e| Fault::new(format!("{path}: {e}")))
    }

    /// One window with its coupling iterations, accepted.
    fn window(&mut self, index: u64) -> Result<(), Fault> {
        let mut line = format!("window {index:4}:");
        let mut last = None;
        for iteration in 0..self.args.iterations {
            self.set_canopy_positions(index, iteration);
            let (time, dt) = (index as f64 * self.dt, self.dt);
            let w = Window { index, iteration, substeps: 1, time, dt, ..Window::default() };
            let input = Input { canopy: &self.displacement, grid: Default::default() };
            self.comm.barrier();
            let clock = Instant::now();
            let stats = self.mover.advance(&w, &input, &mut self.output)?;
            let spent = self.comm.max(clock.elapsed().as_secs_f64());
            self.seconds += spent;
            self.iterations += stats.values[mesh_stats::ITERATIONS];
            line += &format!(" {}it {:.1}ms", stats.values[mesh_stats::ITERATIONS], 1e3 * spent);
            if let Some(fault) = self.mover.failure() {
                return Err(fault.clone());
            }
            last = Some((w, stats.values));
        }
        let Some((w, v)) = last else { return Ok(()) };
        let clock = Instant::now();
        self.mover.accept(&w)?;
        self.worst = f64::min(self.worst, v[mesh_stats::MIN_QUALITY]);
        if (index + 1).is_multiple_of(self.args.every.max(1)) {
            self.say(format_args!(
                "{line} | quality {:.4} cell {} volume {:.3} increments {} references {} accept {:.1}ms",
                v[mesh_stats::MIN_QUALITY],
                v[mesh_stats::WORST_CELL],
                v[mesh_stats::MIN_VOLUME_RATIO],
                v[mesh_stats::INCREMENTS],
                self.mover.motion().rebased(),
                1e3 * clock.elapsed().as_secs_f64(),
            ));
        }
        Ok(())
    }

    /// Sets the displacement of an iteration of a window.
    fn set_canopy_positions(&mut self, index: u64, iteration: u64) {
        let args = self.args;
        // The first iterates of a window have an error relative to the window's motion.
        let last = iteration + 1 >= args.iterations;
        let max_error = 0.3 * 0.1f64.powi(iteration as i32) * if last { 0.0 } else { 1.0 };
        let now = index as f64 + 1.0 - max_error;
        let phase = std::f64::consts::TAU * now / args.period;
        let (unstressed, displacement) = (&self.structure.coords, &mut self.displacement);
        match &self.goal {
            Some(goal) => go(&self.start, goal, now / args.windows as f64, unstressed, displacement),
            None => breathe(&self.start, unstressed, args.amplitude * phase.sin(), phase, displacement),
        }
    }

    fn say_end(&self) {
        let calls = (self.args.windows * self.args.iterations).max(1) as f64;
        self.say(format_args!(
            "worst scaled Jacobian {:.4}; {:.2} iterations and {:.2} ms per solve, {:.2} us per cell and solve; \
             {:.0} bytes per cell at peak",
            self.worst,
            self.iterations / calls,
            1e3 * self.seconds / calls,
            1e6 * self.seconds / calls / self.cells(),
            self.comm.sum(peak_bytes()) / self.cells(),
        ));
    }
}

/// Peak memory of this process, from the kernel's statistics (Linux; else 0).
fn peak_bytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    1024.0 * line.and_then(|l| l.trim().split(' ').next()?.parse::<f64>().ok()).unwrap_or(0.0)
}

/// The target shape on this scene's canopy mesh.
fn goal(path: &Path, args: &StandaloneArgs, structure: &StructureMesh) -> Result<Vec<[f64; 3]>, Fault> {
    let Some(other) = &args.toward_scene else {
        return mesh::load_shape(path, structure.n_canopy).map_err(Fault::new);
    };
    let other = case::load(other).map_err(Fault::new)?;
    let from = mesh::structure_mesh(&other).map_err(Fault::new)?;
    let positions = mesh::load_shape(path, from.n_canopy).map_err(Fault::new)?;
    resample(&from, &positions, structure)
        .ok_or_else(|| Fault::new(format!("{} is the shape of another canopy", path.display())))
}

/// The shape at fraction `s` of the distance from the start to `goal`, as displacement from the unstressed shape.
fn go(start: &[f64], goal: &[[f64; 3]], s: f64, unstressed: &[[f64; 3]], displacement: &mut [f64]) {
    let rows = displacement.as_chunks_mut::<3>().0.iter_mut().zip(start.as_chunks::<3>().0);
    for (((d, a), b), x) in rows.zip(goal).zip(unstressed) {
        (0..3).for_each(|i| d[i] = a[i] + s * (b[i] - a[i]) - x[i]);
    }
}

/// The start shape, scaled by `share` about its axis with a small wave, as displacement from the unstressed shape.
fn breathe(start: &[f64], unstressed: &[[f64; 3]], share: f64, phase: f64, displacement: &mut [f64]) {
    let rows = displacement.as_chunks_mut::<3>().0.iter_mut().zip(start.as_chunks::<3>().0);
    for ((d, s), x) in rows.zip(unstressed) {
        let wave = 0.1 * share.abs() * (3.0 * s[0] + 0.7 * phase).sin() * (3.0 * s[1]).cos();
        let p = [s[0] * (1.0 + share), s[1] * (1.0 + share), s[2] * (1.0 - 0.5 * share) + wave];
        (0..3).for_each(|i| d[i] = p[i] - x[i]);
    }
}
