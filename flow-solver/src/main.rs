//! The flow-solver program: one rank of it.

use std::path::PathBuf;

use case::Role;
use channel::{Fault, Input, ProgramArgs, Stats, Window, flow_stats as at};
use clap::Parser;
use comm::Comm;
use flow_solver::setup::Setup;

/// Runs the flow of one stage without the coupler, on a rigid grid that falls at the initial
/// descent speed. For developers.
#[derive(Parser)]
#[command(name = "flow-solver alone")]
struct Alone {
    /// Scene file.
    #[arg(long, value_name = "PATH")]
    scene: PathBuf,
    /// Stage of the scene, from 0.
    #[arg(long, value_name = "N")]
    stage: usize,
    /// Folder of the run's results. The states of earlier stages are read from it.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Time steps. Default: the stage's duration.
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Time steps between snapshots. 0: one snapshot at the end.
    #[arg(long, value_name = "N", default_value_t = 0)]
    snapshot_every: u64,
    /// Saves the state at the end, as a coupled run does.
    #[arg(long)]
    save: bool,
}

fn main() {
    flow_solver::return_large_blocks();
    let words: Vec<_> = std::env::args_os().collect();
    let outcome = if words.get(1).is_some_and(|w| w == "alone") {
        let args = Alone::parse_from(words.into_iter().skip(1));
        alone(&args)
    } else if words.get(1).is_some_and(|w| w == "self-test") {
        self_test(&words[2..])
    } else {
        let args = ProgramArgs::parse_or_exit();
        serve(&args)
    };
    if let Err(message) = outcome {
        eprintln!("flow-solver: {message}");
        // Without MPI_Finalize, so that mpirun ends the other ranks at once.
        std::process::exit(1);
    }
}

fn serve(args: &ProgramArgs) -> Result<(), String> {
    let comm = Comm::init(Some(args.ranks as usize)).map_err(|e| e.to_string())?;
    let options = args.serve_options(Role::Flow, comm.rank());
    let (gather, send, poll) =
        (|x| comm.all_gather_u64(x), |to, x: &[f64]| comm.send(to, x), |from| comm.poll(from));
    let peers = channel::Peers { gather: &gather, send: &send, poll: &poll };
    let end = built(&args.scene, args.stage, &args.out, args.resume.as_deref(), &comm)
        .map_err(|e| {
            channel::report(&options, &e);
            e.to_string()
        })
        .and_then(|mut p| channel::serve_across(p.as_mut(), &options, &peers).map_err(|e| e.to_string()));
    if end.is_err() {
        // Keep MPI alive: the caller exits without finalising it.
        std::mem::forget(comm);
    }
    end.map(|_| ())
}

fn built(
    scene: &std::path::Path,
    stage: usize,
    out: &std::path::Path,
    resume: Option<&std::path::Path>,
    comm: &Comm,
) -> Result<Box<dyn channel::Participant>, Fault> {
    let scene = case::load(scene).map_err(Fault::new)?;
    if stage >= scene.stages.len() {
        return Err(Fault::new(format!(
            "stage {stage} does not exist: the scene has {} stages, numbered from 0",
            scene.stages.len()
        )));
    }
    let scene = scene.for_stage(stage);
    if scene.flow.as_ref().is_some_and(case::Flow::is_immersed) {
        return Ok(Box::new(flow_solver::immersed_canopy::participant(&scene, stage, out, resume, comm)?));
    }
    let setup = Setup::new(scene, stage, out)?;
    let setup = match resume {
        Some(folder) => setup.resume(folder),
        None => setup,
    };
    if comm.is_root() {
        setup.report_grid()?;
    }
    flow_solver::participant(&setup, comm)
}

/// Part of the program's own tests: see `tests/ranks.rs`.
fn self_test(words: &[std::ffi::OsString]) -> Result<(), String> {
    let comm = Comm::init(None).map_err(|e| e.to_string())?;
    let file = words.first().map(PathBuf::from).ok_or("self-test needs a file name")?;
    let effect = words.get(1).and_then(|w| w.to_str()).unwrap_or("plain");
    let force = flow_solver::self_test(&comm, &file, effect).map_err(|e| e.to_string())?;
    if comm.is_root() {
        force.iter().for_each(|f| println!("{:.15e} {:.15e} {:.15e}", f[0], f[1], f[2]));
    }
    Ok(())
}

fn alone(args: &Alone) -> Result<(), String> {
    let comm = Comm::init(None).map_err(|e| e.to_string())?;
    let run = run_alone(args, &comm).map_err(|e| e.to_string());
    if run.is_err() {
        std::mem::forget(comm);
    }
    run
}

fn run_alone(args: &Alone, comm: &Comm) -> Result<(), Fault> {
    let scene = case::load(&args.scene).map_err(Fault::new)?;
    let mut participant = built(&args.scene, args.stage, &args.out, None, comm)?;
    let stage = &scene.stages[args.stage];
    let folder = case::stage_folder(&args.out, &scene, args.stage);
    let steps = match stage.steady {
        Some(_) => 1,
        None => args.steps.unwrap_or(stage.windows()),
    };
    let frame_velocity = scene.resolved().initial_velocity_m_s;
    let mut output = vec![0.0; participant.output_rows().len() * channel::LOAD_WIDTH];
    if comm.is_root() {
        println!("   step    time s     force z N   residual start    end  steps  linear  Courant    wall s");
    }
    let (mut unconverged, mut worst) = (0, 0.0f64);
    for index in 0..steps {
        let w = Window {
            index,
            substeps: 1,
            time: index as f64 * stage.window_s,
            // A steady stage has no duration; a window needs one.
            dt: if stage.steady.is_some() { 1.0 } else { stage.window_s },
            frame_velocity,
            ..Window::default()
        };
        let input = Input { canopy: &[], grid: channel::Grid::default() };
        let stats = participant.advance(&w, &input, &mut output)?;
        participant.accept(&w)?;
        let excess = checked_excess(&w, &stats)?;
        unconverged += u64::from(excess > 1.0);
        worst = worst.max(excess);
        if comm.is_root() {
            print_row(&w, &stats);
        }
        let due = args.snapshot_every > 0 && (index + 1) % args.snapshot_every == 0;
        if due || index + 1 == steps {
            std::fs::create_dir_all(&folder).map_err(Fault::new)?;
            participant.snapshot(w.time + w.dt, &folder)?;
        }
    }
    if unconverged > 0 && comm.is_root() {
        eprintln!(
            "warning: {unconverged} of {steps} steps ended above their residual target, by a factor of at most {worst:.1}"
        );
    }
    if args.save {
        let folder = case::state_folder(&args.out, &scene, args.stage);
        std::fs::create_dir_all(&folder).map_err(Fault::new)?;
        participant.save(&folder)?;
    }
    Ok(())
}

/// Residual of a step over its target.
///
/// # Errors
/// A residual above [`channel::UNCONVERGED_LIMIT`] times its target.
fn checked_excess(w: &Window, stats: &Stats) -> Result<f64, Fault> {
    let excess = channel::excess(Role::Flow, &stats.values).unwrap_or(0.0);
    if excess > channel::UNCONVERGED_LIMIT {
        return Err(Fault::new(format!(
            "step {} (t = {:.4} s) is not converged: residual {:.3e} N, {excess:.1} times its target; raise \
             flow.solver.max_iterations, use flow.solver.method = \"gmres\", or shorten window_s",
            w.index,
            w.time,
            stats.values[at::RESIDUAL_END]
        )));
    }
    Ok(excess)
}

fn print_row(w: &Window, stats: &Stats) {
    let v = &stats.values;
    println!(
        "{:7} {:9.4} {:13.4} {:12.3e} {:9.2e} {:5} {:7} {:8.2} {:9.3}",
        w.index,
        w.time + w.dt,
        v[at::FORCE + 2],
        v[at::RESIDUAL_START],
        v[at::RESIDUAL_END],
        v[at::ITERATIONS],
        v[at::LINEAR_ITERATIONS],
        v[at::MAX_COURANT],
        stats.busy_s
    );
}
