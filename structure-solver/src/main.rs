//! Membranes and cables: total Lagrangian finite elements under MPI
fn main() {}
