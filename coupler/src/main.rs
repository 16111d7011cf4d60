//! The command line `ripstop`.
fn main() {}
