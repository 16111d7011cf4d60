//! The structure-solver: one rank of the structure's MPI program.
//!
//! Started by the coupler with `--scene --stage --session --out --ranks`. For
//! developers, `structure-solver alone` runs a pre-inflation stage by itself.

use std::path::PathBuf;
use std::process::ExitCode;

use case::Role;
use channel::{Fault, ProgramArgs};
use clap::Parser;
use comm::Comm;
use structure_solver::alone;
use structure_solver::participant::StructureSolver;

/// Runs a pre-inflation stage without the coupler and prints a table.
#[derive(Parser)]
#[command(name = "structure-solver alone")]
struct AloneArgs {
    /// Scene file.
    #[arg(long, value_name = "PATH")]
    scene: PathBuf,
    /// Stage of the scene to run, from 0.
    #[arg(long, value_name = "N", default_value_t = 0)]
    stage: usize,
    /// Folder of the results.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Prints the share of assembly, factorisation, GMRES and the rest.
    #[arg(long)]
    profile: bool,
    /// Windows between snapshots for ParaView; 0: none.
    #[arg(long, value_name = "N", default_value_t = 0)]
    snapshot_every: u64,
}

fn main() -> ExitCode {
    let words: Vec<_> = std::env::args_os().collect();
    if words.get(1).is_some_and(|w| w == "alone") {
        let args = AloneArgs::parse_from(&words[1..]);
        end(run_alone(&args))
    } else {
        end(serve(&ProgramArgs::parse_or_exit()))
    }
}

/// A rank that failed leaves without `MPI_Finalize`, so that `mpirun` ends the others.
fn end(result: Result<(), String>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("structure-solver: {message}");
            std::process::exit(1)
        }
    }
}

fn run_alone(args: &AloneArgs) -> Result<(), String> {
    let comm = Comm::init(None).map_err(|e| e.to_string())?;
    let scene = case::load(&args.scene).map_err(|e| e.to_string())?;
    let options = alone::Options { profile: args.profile, snapshot_every: args.snapshot_every };
    let result = alone::run(&comm, &scene, args.stage, &args.out, options).map_err(|e| e.to_string());
    leave(comm, result)
}

fn serve(args: &ProgramArgs) -> Result<(), String> {
    let comm = Comm::init(Some(args.ranks as usize)).map_err(|e| e.to_string())?;
    let at = args.serve_options(Role::Structure, comm.rank());
    let solver = case::load(&args.scene).map_err(Fault::new).and_then(|scene| match &args.resume {
        None => StructureSolver::new(&comm, &scene.for_stage(args.stage), args.stage, &args.out),
        Some(state) => {
            StructureSolver::resumed(&comm, &scene.for_stage(args.stage), args.stage, &args.out, state)
        }
    });
    let (gather, send, poll) =
        (|x| comm.all_gather_u64(x), |to, x: &[f64]| comm.send(to, x), |from| comm.poll(from));
    let peers = channel::Peers { gather: &gather, send: &send, poll: &poll };
    let result = match solver {
        Ok(mut solver) => {
            channel::serve_across(&mut solver, &at, &peers).map(|_| ()).map_err(|e| e.to_string())
        }
        Err(fault) => {
            channel::report(&at, &fault);
            Err(fault.message)
        }
    };
    leave(comm, result)
}

/// Drops the last handle on MPI only after a good end.
fn leave(comm: Comm, result: Result<(), String>) -> Result<(), String> {
    if result.is_err() {
        std::mem::forget(comm);
    }
    result
}
