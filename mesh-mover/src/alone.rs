//! The developer's command: a prescribed motion without partners.

use std::path::{Path, PathBuf};
use std::time::Instant;

use case::Scene;
use channel::{Fault, Input, Participant, Window, mesh_stats};
use clap::Parser;
use comm::Comm;
use mesh::StructureMesh;

use crate::motion::Limits;
use crate::participant::{MeshMover, Setup, owners, regridder};
use crate::resample::resample;

/// Moves the grid of a scene without structure and flow: the canopy breathes about
/// its start shape, each window is asked for several times with a shrinking
/// error, as a coupled run does. Prints quality, iterations and seconds.
///
/// Example: mpirun -n 2 mesh-mover alone --scene cases/atps-descent/scene.toml
/// --out runs/atps-descent --stage 2
#[derive(Clone, Debug, Parser)]
#[command(name = "mesh-mover alone")]
pub struct AloneArgs {
    /// Scene file.
    #[arg(long, value_name = "PATH")]
    pub scene: PathBuf,
    /// Stage to start: its grid is built around the shape an earlier stage left in `--out`.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub stage: usize,
    /// Folder of the run's results.
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
    /// Ranks, as passed to `mpirun -n` (checked where given).
    #[arg(long, value_name = "N")]
    pub ranks: Option<usize>,
    /// Windows to move through.
    #[arg(long, value_name = "N", default_value_t = 40)]
    pub windows: u64,
    /// Coupling iterations of a window.
    #[arg(long, value_name = "N", default_value_t = 4)]
    pub iterations: u64,
    /// Share by which the canopy grows and shrinks about its axis.
    #[arg(long, value_name = "SHARE", default_value_t = 0.1)]
    pub amplitude: f64,
    /// Canopy shape (a `canopy.bin`) to move to in a straight line, instead of breathing.
    #[arg(long, value_name = "PATH")]
    pub toward: Option<PathBuf>,
    /// Scene whose canopy mesh `--toward` belongs to, where it is another one.
    #[arg(long, value_name = "PATH", requires = "toward")]
    pub toward_scene: Option<PathBuf>,
    /// Build the start grid around the shape at this share of the way from the unstressed canopy
    /// to `--toward`, not around that of an earlier stage.
    #[arg(long, value_name = "SHARE", requires = "toward")]
    pub from: Option<f64>,
    /// Draw cuts through the middle of the grid at the start and at the end: PATH-start.svg, PATH-end.svg
    /// (on one rank).
    #[arg(long, value_name = "PATH")]
    pub cut: Option<PathBuf>,
    /// Print every that many windows.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub every: u64,
    /// Windows of one breath.
    #[arg(long, value_name = "N", default_value_t = 40.0)]
    pub period: f64,
}

impl AloneArgs {
    /// The arguments of this process behind the word `alone`; ends the process where they are wrong.
    pub fn parse_after_verb() -> Self {
        Self::parse_from(std::env::args_os().take(1).chain(std::env::args_os().skip(2)))
    }
}

/// Runs the command. Collective.
///
/// # Errors
/// What the mesh-mover says.
pub fn run(scene: &Scene, args: &AloneArgs, comm: &Comm) -> Result<(), Fault> {
    if args.stage >= scene.stages.len() {
        return Err(Fault::new(format!("the scene has {} stages, counted from 0", scene.stages.len())));
    }
    let clock = Instant::now();
    let structure = mesh::structure_mesh(scene).map_err(Fault::new)?;
    let goal = args.toward.as_ref().map(|path| goal(path, args, &structure)).transpose()?;
    let mut mover = match (&goal, args.from) {
        (Some(goal), Some(share)) => {
            let unstressed = &structure.coords[..structure.n_canopy];
            let mix = |(x, g): (&[f64; 3], &[f64; 3])| [0, 1, 2].map(|i| x[i] + share * (g[i] - x[i]));
            let positions: Vec<_> = unstressed.iter().zip(goal).map(mix).collect();
            let grid = mesh::flow_grid(scene, &structure, &positions).map_err(Fault::new)?;
            let owner = owners(&grid, comm.size())?;
            let limits = Limits::from(&scene.mesh);
            let mover = crate::movers::mover(&scene.mesh);
            let (outer, regridder) = (scene.mesh.outer, regridder(scene, &structure, &grid));
            let setup = Setup {
                grid: &grid,
                structure: &structure,
                owner: &owner,
                mover,
                limits,
                state: None,
                outer,
                regridder,
            };
            MeshMover::on_grid(setup, comm)?
        }
        _ => MeshMover::new(scene, args.stage, &args.out, comm)?,
    };
    let n_cells = mover.motion().grid.n_cells_global;
    let start = mover.positions().canopy.clone();
    let shape = mover.motion().shape(&mover.positions().grid);
    let say = |line: String| {
        if comm.is_root() {
            println!("{line}");
        }
    };
    say(format!(
        "{} grid nodes, {n_cells} cells, {} ranks: start {:.2} s, {:.0} bytes per cell, worst scaled Jacobian {:.4} (cell {})",
        mover.motion().grid.n_global,
        comm.size(),
        clock.elapsed().as_secs_f64(),
        mover.motion().bytes() as f64 * comm.size() as f64 / n_cells as f64,
        shape.quality,
        shape.cell,
    ));
    let draw = |mover: &MeshMover, name: &str| -> Result<(), Fault> {
        let Some(path) = &args.cut else { return Ok(()) };
        let at = mover.positions();
        let nodes = at.canopy.as_chunks::<3>().0;
        let mean = |i: usize| nodes.iter().map(|p| p[i]).sum::<f64>() / nodes.len() as f64;
        let half = 1.6 * nodes.iter().map(|p| (p[0] - mean(0)).abs()).fold(0.0, f64::max);
        // Not through the middle itself, where a layer of faces may lie.
        let svg =
            crate::cut::cut(&mover.motion().grid, &at.grid, mean(1) + 0.03 * half, [mean(0), mean(2)], half);
        let path = format!("{}-{name}.svg", path.display());
        std::fs::write(&path, svg).map_err(|e| Fault::new(format!("{path}: {e}")))
    };
    draw(&mover, "start")?;
    let dt = scene.stages[args.stage].window_s;
    let mut output = vec![0.0; 6 * mover.output_rows().len()];
    let mut displacement = vec![0.0; start.len()];
    let (mut seconds, mut total, mut worst) = (0.0, 0.0, f64::INFINITY);
    for index in 0..args.windows {
        let mut line = format!("window {index:4}:");
        let mut last = None;
        for iteration in 0..args.iterations {
            // The first guesses of a window miss by a share of the window's motion.
            let miss =
                0.3 * 0.1f64.powi(iteration as i32) * if iteration + 1 < args.iterations { 1.0 } else { 0.0 };
            let now = index as f64 + 1.0 - miss;
            let phase = std::f64::consts::TAU * now / args.period;
            match &goal {
                Some(goal) => {
                    go(&start, goal, now / args.windows as f64, &structure.coords, &mut displacement);
                }
                None => {
                    let share = args.amplitude * phase.sin();
                    breathe(&start, &structure.coords, share, phase, &mut displacement);
                }
            }
            let w =
                Window { index, iteration, substeps: 1, time: index as f64 * dt, dt, ..Window::default() };
            let input = Input { canopy: &displacement, grid: Default::default() };
            comm.barrier();
            let clock = Instant::now();
            let stats = mover.advance(&w, &input, &mut output)?;
            let spent = comm.max(clock.elapsed().as_secs_f64());
            seconds += spent;
            total += stats.values[mesh_stats::ITERATIONS];
            line += &format!(" {}it {:.1}ms", stats.values[mesh_stats::ITERATIONS], 1e3 * spent);
            if let Some(fault) = mover.stuck() {
                return Err(fault.clone());
            }
            last = Some((w, stats.values));
        }
        let Some((w, v)) = last else { break };
        let clock = Instant::now();
        mover.accept(&w)?;
        worst = f64::min(worst, v[mesh_stats::MIN_QUALITY]);
        if (index + 1) % args.every.max(1) != 0 {
            continue;
        }
        say(format!(
            "{line} | quality {:.4} cell {} volume {:.3} increments {} references {} accept {:.1}ms",
            v[mesh_stats::MIN_QUALITY],
            v[mesh_stats::WORST_CELL],
            v[mesh_stats::MIN_VOLUME_RATIO],
            v[mesh_stats::INCREMENTS],
            mover.motion().rebased(),
            1e3 * clock.elapsed().as_secs_f64(),
        ));
    }
    draw(&mover, "end")?;
    let calls = (args.windows * args.iterations).max(1) as f64;
    say(format!(
        "worst scaled Jacobian {worst:.4}; {:.2} iterations and {:.2} ms a call, {:.2} us per cell and call; \
         {:.0} bytes per cell at most",
        total / calls,
        1e3 * seconds / calls,
        1e6 * seconds / calls / n_cells as f64,
        comm.sum(peak_bytes()) / n_cells as f64,
    ));
    Ok(())
}

/// Most memory that this process has had, from the kernel's accounts (Linux; else 0).
fn peak_bytes() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    1024.0 * line.and_then(|l| l.trim().split(' ').next()?.parse::<f64>().ok()).unwrap_or(0.0)
}

/// The shape to go to, on this scene's canopy mesh.
fn goal(path: &Path, args: &AloneArgs, structure: &StructureMesh) -> Result<Vec<[f64; 3]>, Fault> {
    let Some(other) = &args.toward_scene else {
        return mesh::load_shape(path, structure.n_canopy).map_err(Fault::new);
    };
    let other = case::load(other).map_err(Fault::new)?;
    let from = mesh::structure_mesh(&other).map_err(Fault::new)?;
    let positions = mesh::load_shape(path, from.n_canopy).map_err(Fault::new)?;
    resample(&from, &positions, structure)
        .ok_or_else(|| Fault::new(format!("{} is the shape of another canopy", path.display())))
}

/// The shape at share `s` of the way from the start to `goal`, as displacement from the unstressed shape.
fn go(start: &[f64], goal: &[[f64; 3]], s: f64, unstressed: &[[f64; 3]], displacement: &mut [f64]) {
    let rows = displacement.as_chunks_mut::<3>().0.iter_mut().zip(start.as_chunks::<3>().0);
    for (((d, a), b), x) in rows.zip(goal).zip(unstressed) {
        (0..3).for_each(|i| d[i] = a[i] + s * (b[i] - a[i]) - x[i]);
    }
}

/// The start shape, wider by `share` about its axis and waved a little, as
/// displacement from the unstressed shape.
fn breathe(start: &[f64], unstressed: &[[f64; 3]], share: f64, phase: f64, displacement: &mut [f64]) {
    let rows = displacement.as_chunks_mut::<3>().0.iter_mut().zip(start.as_chunks::<3>().0);
    for ((d, s), x) in rows.zip(unstressed) {
        let wave = 0.1 * share.abs() * (3.0 * s[0] + 0.7 * phase).sin() * (3.0 * s[1]).cos();
        let p = [s[0] * (1.0 + share), s[1] * (1.0 + share), s[2] * (1.0 - 0.5 * share) + wave];
        (0..3).for_each(|i| d[i] = p[i] - x[i]);
    }
}
