//! Drag, lift and Strouhal number of a sphere.
//!
//! `cargo run --release -p flow-solver --example sphere -- [Reynolds number] [cells along a quarter circle] [cells off the sphere] [end, D/U]
//! [smallest upwind share]`

#[path = "../tests/common/bodies.rs"]
mod bodies;
#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/common/sphere.rs"]
mod sphere;

fn main() {
    flow_solver::return_large_blocks();
    let arg = |k: usize, d: f64| std::env::args().nth(k).map_or(d, |a| a.parse().expect("a number"));
    let cells = [arg(2, 16.0) as usize, arg(3, 40.0) as usize];
    sphere::wake(arg(1, 100.0), cells, arg(4, 60.0), arg(5, 0.0));
}
