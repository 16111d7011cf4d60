//! The flow-solver program.

fn main() {}
