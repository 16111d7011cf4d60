//! How the cost of a time step grows with the mesh:
//! `cargo bench -p structure-solver --bench scaling [-- steps n ...]`
//!
//! The paper's air bag (section 1.4) with wrinkling and spectral radius 0, 2 n^2 triangles, the first steps of
//! 1e-4 s on one rank. Seconds are of the processor (Linux), so that a busy machine does not
//! change them much. Last column: the exponent of N in the seconds per step since the first size.

mod support;

use structure_solver::dynamics::LoadPath;

fn peak_mib() -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").expect("Linux");
    let line = text.lines().find_map(|l| l.strip_prefix("VmHWM:")).expect("Linux tells the peak");
    line.trim().trim_end_matches(" kB").parse::<f64>().expect("kB") / 1024.0
}

fn main() {
    let numbers: Vec<usize> = std::env::args().filter_map(|a| a.parse().ok()).collect();
    let (steps, sizes) = match numbers.split_first() {
        Some((steps, sizes)) if !sizes.is_empty() => (*steps, sizes.to_vec()),
        Some((steps, _)) => (*steps, vec![50, 71, 100, 141, 200, 283, 388]),
        None => (20, vec![50, 71, 100, 141, 200, 283, 388]),
    };
    println!(
        "{:>9} {:>8} {:>10} {:>12} {:>13} {:>11} {:>7} {:>9} {:>9}",
        "triangles",
        "start s",
        "s/step",
        "Newton/step",
        "ms/Newton",
        "it/Newton",
        "factors",
        "MiB",
        "exponent"
    );
    let mut first = None;
    for n in sizes {
        let clock = support::seconds_run();
        let mut d = support::air_bag(n, true, "spectral_radius = 0.0");
        let start = support::seconds_run() - clock;
        let p = vec![23.94; d.system.model.n_faces];
        let load = LoadPath { pressure: [&p; 2], traction: [&[]; 2] };
        let clock = support::seconds_run();
        let mut newton = 0;
        for _ in 0..steps {
            newton += d.window(1e-4, 1, load, [0.0; 3], false).expect("a solvable step").newton_steps;
            d.accept();
        }
        let seconds = (support::seconds_run() - clock) / steps as f64;
        let newton = newton as f64;
        let triangles = (2 * n * n) as f64;
        let &mut (n0, s0) = first.get_or_insert((triangles, seconds));
        let exponent = if triangles > n0 { (seconds / s0).ln() / (triangles / n0).ln() } else { f64::NAN };
        let cost = d.linear.cost;
        println!(
            "{triangles:>9} {start:>8.2} {seconds:>10.4} {:>12.2} {:>13.2} {:>11.1} {:>7} {:>9.0} {exponent:>9.2}",
            newton / steps as f64,
            1e3 * seconds * steps as f64 / newton,
            cost.iterations as f64 / newton,
            cost.factorisations,
            peak_mib(),
        );
    }
}
