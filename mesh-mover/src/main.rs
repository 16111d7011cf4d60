//! `mesh-mover`: the flow grid as a pseudo-solid that follows the canopy.

use std::process::ExitCode;

use case::{Role, Scene};
use channel::{Fault, ProgramArgs, ServeError};
use comm::Comm;
use mesh_mover::participant::MeshMover;
use mesh_mover::standalone::{self, StandaloneArgs};

fn main() -> ExitCode {
    // The developer's command is not part of the contract with the coupler.
    if std::env::args().nth(1).as_deref() == Some("alone") {
        let args = StandaloneArgs::parse_after_verb();
        return ending(with_scene(&args.scene, args.ranks, |scene, comm| {
            standalone::run(scene, &args, comm).map_err(|e| e.message)
        }));
    }
    let args = ProgramArgs::parse_or_exit();
    ending(with_scene(&args.scene, Some(args.ranks as usize), |scene, comm| {
        let options = args.serve_options(Role::Mesh, comm.rank());
        let built = match args.stage < scene.stages.len() {
            true => match &args.resume {
                None => MeshMover::new(&scene.for_stage(args.stage), args.stage, &args.out, comm),
                Some(state) => {
                    MeshMover::resumed(&scene.for_stage(args.stage), args.stage, &args.out, state, comm)
                }
            },
            false => Err(Fault::new(format!(
                "stage {} was requested, but the scene has {} stages (counted from 0)",
                args.stage,
                scene.stages.len()
            ))),
        };
        let mut mover = built.map_err(|fault| {
            channel::report(&options, &fault);
            fault.message
        })?;
        // The whole grid and temporary data of its partition are freed.
        mesh_mover::allocator::release_free_memory();
        let (gather, send, poll) =
            (|x| comm.all_gather_u64(x), |to, x: &[f64]| comm.send(to, x), |from| comm.poll(from));
        let peers = channel::Peers { gather: &gather, send: &send, poll: &poll };
        channel::serve_across(&mut mover, &options, &peers).map(|_| ()).map_err(|e: ServeError| e.to_string())
    }))
}

fn with_scene(
    path: &std::path::Path,
    ranks: Option<usize>,
    work: impl FnOnce(&Scene, &Comm) -> Result<(), String>,
) -> Result<(), String> {
    let scene = case::load(path).map_err(|e| e.to_string())?;
    let comm = Comm::init(ranks).map_err(|e| e.to_string())?;
    let result = work(&scene, &comm);
    if let Err(message) = &result {
        eprintln!("mesh-mover (rank {}): {message}", comm.rank());
        // Other ranks may wait for this one in a collective call.
        comm.abort(1);
    }
    result
}

fn ending(result: Result<(), String>) -> ExitCode {
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("mesh-mover: {message}");
            ExitCode::FAILURE
        }
    }
}
