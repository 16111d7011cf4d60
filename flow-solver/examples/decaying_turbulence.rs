//! Decay of isotropic turbulence in a periodic box, compared with the spectra that Comte-Bellot and Corrsin (1971) measured.
//!
//! `cargo run --release -p flow-solver --example decaying_turbulence -- [cells along an edge] [model: 0 none, 1 smagorinsky, 2 wale,
//! 3 ddes] [smallest upwind share] [cells that 1 m/s crosses in a step]`
//!
//! For each station: resolved energy over that of the measured spectrum up to the same wave number, and the ratio of both spectra in
//! octaves around wave lengths of 2 to 32 cells.

#[path = "../tests/common/mod.rs"]
mod common;
#[path = "../tests/common/isotropic.rs"]
mod isotropic;

use isotropic::Model;

fn main() {
    flow_solver::return_large_blocks();
    let arg = |k: usize, d: f64| std::env::args().nth(k).map_or(d, |a| a.parse().expect("a number"));
    let (n, model, upwind, courant) = (arg(1, 32.0) as usize, arg(2, 2.0) as usize, arg(3, 0.0), arg(4, 0.5));
    let model = Model::ALL[model.min(3)];
    let mut s = isotropic::at_start(n, model, upwind);
    println!("# {n}^3 cells, {model:?}, upwind share {upwind}, Courant number {courant} at 1 m/s");
    let clock = std::time::Instant::now();
    let (mut steps, mut iterations) = (0, 0);
    for station in 0..3 {
        if station > 0 {
            let (more, of_them) = isotropic::to_station(&mut s, n, station, courant);
            (steps, iterations) = (steps + more, iterations + of_them);
        }
        let spectrum = isotropic::spectrum(&s, n);
        let share = isotropic::energy(&spectrum) / isotropic::resolved(station, n);
        print!("{:.4} s: energy {share:.3};", isotropic::TIMES[station]);
        for cells in [32, 16, 8, 6, 4, 3, 2] {
            let middle = n / cells;
            let band =
                (middle as f64 / 1.2).round() as usize..=((middle as f64 * 1.2).round() as usize).min(n / 2);
            let sums = band.filter(|m| *m > 0).fold([0.0; 2], |[a, b], m| {
                [a + spectrum[m], b + isotropic::measured(station, isotropic::wave_number(m))]
            });
            print!(" {cells} cells {:.2}", sums[0] / sums[1]);
        }
        println!();
    }
    let cost = clock.elapsed().as_secs_f64() / (steps.max(1) * n * n * n) as f64;
    println!(
        "# {:.2} iterations a step, {:.2} us a cell and step",
        iterations as f64 / steps.max(1) as f64,
        1e6 * cost
    );
}
