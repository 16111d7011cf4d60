//! The flow grid as a pseudo-solid that follows the canopy.

fn main() {}
