//! The square plate in a stream: side 1 m, normal to z, in a box of [-5, 5]^2 x
//! [-5, 10] m on a rectilinear grid; coarse grids keep every second or fourth line.

use mesh::{FlowGrid, Patch, plate_grid};

/// `n` steps that grow by a constant ratio from `h` to a sum of `length`.
fn geometric(n: usize, length: f64, h: f64) -> Vec<f64> {
    let sum = |r: f64| (0..n).map(|k| h * r.powi(k as i32)).sum::<f64>();
    let (mut a, mut b) = (1.0, 2.0);
    for _ in 0..200 {
        let m = 0.5 * (a + b);
        if sum(m) > length { b = m } else { a = m }
    }
    let r = 0.5 * (a + b);
    let mut at = 0.0;
    let steps: Vec<f64> = (0..n)
        .map(|k| {
            at += h * r.powi(k as i32);
            at
        })
        .collect();
    let end = steps[n - 1];
    steps.iter().map(|s| s * length / end).collect()
}

/// The grid with every `every`-th line of 56 x 56 x 80 cells; 0: each of these cells
/// halved in all directions; 16 and more: as many cells along the plate's side in place of
/// 16, all others in proportion.
pub fn plate(every: usize) -> FlowGrid {
    if every < 16 { lines(16, every) } else { lines(every, 1) }
}

/// The grid with `across` cells along the plate's side, of which every `every`-th line is kept.
pub fn lines(across: usize, every: usize) -> FlowGrid {
    let share = |n: usize| (n * across + 8) / 16;
    let h = 1.0 / across as f64;
    let line = |low: Vec<f64>, start: f64, uniform: usize, high: Vec<f64>| -> Vec<f64> {
        let mut x: Vec<f64> = low.iter().rev().map(|s| start - s).collect();
        x.extend((0..=uniform).map(|k| start + k as f64 * h));
        let end = start + uniform as f64 * h;
        x.extend(high.iter().map(|s| end + s));
        if every == 0 {
            let middles = x.windows(2).flat_map(|w| [w[0], 0.5 * (w[0] + w[1])]);
            return middles.chain([x[x.len() - 1]]).collect();
        }
        x.into_iter().step_by(every).collect()
    };
    let near = share(24);
    let far = 10.0 - near as f64 * h;
    let z = line(geometric(share(20), 5.0, h), 0.0, near, geometric(share(36), far, h));
    let y = line(geometric(share(20), 4.5, h), -0.5, across, geometric(share(20), 4.5, h));
    let n = [y.len() - 1, y.len() - 1, z.len() - 1];
    let side = Patch::Slip;
    let patches = [side, side, side, side, Patch::FarField, Patch::Outlet];
    let at = |line: usize| line.checked_div(every).unwrap_or(2 * line);
    let range = at(share(20))..at(share(20) + across);
    let hi = n.map(|n| n as f64);
    let mut grid = plate_grid(n, [0.0; 3], hi, patches, at(share(20)), [range.clone(), range]);
    for x in &mut grid.coords {
        *x = [y[x[0].round() as usize], y[x[1].round() as usize], z[x[2].round() as usize]];
    }
    grid
}
