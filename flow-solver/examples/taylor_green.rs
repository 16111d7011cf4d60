//! Three-dimensional Taylor-Green vortex at Reynolds number 1600: kinetic energy and dissipation over time.
//!
//! `cargo run --release -p flow-solver --example taylor_green -- [cells per octant edge] [end] [Courant number]
//! [residual drop] [shape: 0 hexahedra, 1 tetrahedra] [smallest upwind share]`
//!
//! Columns: t, kinetic energy per mass (0.125 at the start), its rate of decay, the viscous part of that, iterations.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/common/taylor_green.rs"]
mod vortex;

use std::f64::consts::PI;

use mesh::BoxShape;

fn main() {
    flow_solver::return_large_blocks();
    let arg = |k: usize, d: f64| std::env::args().nth(k).map_or(d, |a| a.parse().expect("a number"));
    let (n, end, courant, drop) = (arg(1, 32.0) as usize, arg(2, 12.0), arg(3, 0.8), arg(4, 1e-2));
    let shape = if arg(5, 0.0) == 1.0 { BoxShape::Tetrahedra } else { BoxShape::Hexahedra };
    let mut s = vortex::at_start(shape, n, drop, arg(6, 0.0));
    let steps = (end * n as f64 / (courant * PI)).round() as usize;
    let dt = end / steps as f64;
    let every = (0.25 / dt).round().max(1.0) as usize;
    let (mut energies, mut peak) = (Vec::new(), (0.0, 0.0));
    let (mut iterations, clock) = (0, std::time::Instant::now());
    println!("# {n}^3 boxes of an octant, dt {dt:.5}");
    for k in 0..=steps {
        let energy = vortex::energy(&s);
        let decay = energies.last().map_or(f64::NAN, |before| (before - energy) / dt);
        if decay > peak.0 {
            peak = (decay, (k as f64 - 0.5) * dt);
        }
        energies.push(energy);
        if k % every == 0 || k == steps {
            let (t, viscous) = (k as f64 * dt, vortex::viscous_dissipation(&s));
            println!("{t:.4} {energy:.6} {decay:.6} {viscous:.6} {iterations}");
        }
        if k < steps {
            iterations += vortex::step(&mut s, dt);
        }
    }
    let cost = clock.elapsed().as_secs_f64() / (steps * s.topology.n_owned) as f64;
    println!(
        "# energy compared with the reference at t = 5, 9, 12: {:.4?}",
        vortex::deviations(&energies, dt)
    );
    println!("# largest rate of decay {:.5} at t = {:.2}", peak.0, peak.1);
    println!(
        "# {:.2} iterations a step, {:.2} us a cell and step",
        iterations as f64 / steps as f64,
        1e6 * cost
    );
}
