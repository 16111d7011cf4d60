//! Membranes and cables: total Lagrangian finite elements under MPI
use std::path::Path;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let comm = comm::Comm::init(None).expect("mpi");
    let scene = case::load(Path::new(&args[1])).unwrap_or_else(|e| panic!("{e}"));
    structure_solver::alone::run(&comm, &scene, 0, Path::new("."), true).unwrap_or_else(|e| panic!("{e}"));
}
