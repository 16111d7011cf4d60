//! The wake of a sphere, half of it between a plane of symmetry and the far field.

use std::f64::consts::PI;

use flow_solver::physics::Laminar;

use super::bodies;
use super::common::{at_rest, isothermal, settings, wall_force};

const RHO: f64 = 1.225;

/// Frequency at the largest amplitude of the lift in `rows` (time in D/U, drag, lift), with a Hann window, from two cycles to 0.5.
fn main_frequency(rows: &[[f64; 3]]) -> f64 {
    let (start, end) = (rows[0][0], rows[rows.len() - 1][0]);
    let mean = rows.iter().map(|r| r[2]).sum::<f64>() / rows.len() as f64;
    let amplitude = |f: f64| {
        let sum = rows.iter().fold([0.0; 2], |[re, im], [t, _, lift]| {
            let hann = 1.0 - (2.0 * PI * (t - start) / (end - start)).cos();
            let (s, c) = (2.0 * PI * f * t).sin_cos();
            [re + hann * (lift - mean) * c, im + hann * (lift - mean) * s]
        });
        sum[0].hypot(sum[1])
    };
    let step = 0.05 / (end - start);
    let frequencies = (40..).map(|k| step * f64::from(k)).take_while(|f| *f < 0.5);
    frequencies.max_by(|a, b| amplitude(*a).total_cmp(&amplitude(*b))).unwrap_or(0.0)
}

/// Mean drag coefficient, mean lift coefficient towards the side of the symmetry plane that the
/// wake leans to, and Strouhal number of the lift.
pub fn wake(reynolds: f64, [n, nr]: [usize; 2], end: f64, upwind: f64) -> [f64; 3] {
    let grid = bodies::half_shell(n, nr, 15.0);
    let speed = 4.0;
    let mut set = settings([speed, 0.0, 0.0], 1e-2);
    set.moving = false;
    let mut s = isothermal(&grid, Laminar { viscosity: RHO * speed / reynolds }, set);
    s.spatial.upwind_share = upwind;
    // A push to one side: the wake need not find the asymmetry by round-off.
    for previous in &mut s.previous {
        for (q, x) in previous.q.iter_mut().zip(&s.metrics.centre) {
            let r2 = x.iter().map(|x| x * x).sum::<f64>();
            q[3] += speed * 0.3 * (x[0] / r2) * (-0.1 * r2).exp();
        }
    }
    let scale = 0.5 * RHO * speed * speed * PI / 8.0;
    let mut series: Vec<[f64; 3]> = Vec::new();
    let (mut t, mut k) = (0.0, 0);
    while t < end {
        let dt = if k < 20 { 0.005 } else { 0.02 };
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
        t += dt * speed;
        k += 1;
        let force = wall_force(&s) / scale;
        series.push([t, force.x, force.z]);
        if k % 100 == 0 {
            println!("t U/D {t:.1}: cd {:.4} cl {:.4}", force.x, force.z);
        }
    }
    // Whole periods in the second half, from one upward crossing of the mean lift to another.
    let late: Vec<[f64; 3]> = series.iter().filter(|r| r[0] > 0.5 * end).copied().collect();
    let mean = |rows: &[[f64; 3]], c: usize| rows.iter().map(|r| r[c]).sum::<f64>() / rows.len() as f64;
    let middle = mean(&late, 2);
    let up: Vec<usize> =
        (1..late.len()).filter(|&k| late[k - 1][2] < middle && late[k][2] >= middle).collect();
    // A steady wake has no crossings, or those of its last digits: the mean is over all of it.
    let range = late.iter().fold([f64::MAX, f64::MIN], |[low, high], r| [low.min(r[2]), high.max(r[2])]);
    let swing = range[1] - range[0];
    let (first, last, periods) = match up[..] {
        [first, .., last] if swing > 1e-3 => (first, last, up.len() as f64 - 1.0),
        _ => (0, late.len() - 1, 0.0),
    };
    let strouhal = if periods > 0.0 { main_frequency(&late) } else { 0.0 };
    let found = [mean(&late[first..last], 1), mean(&late[first..last], 2).abs(), strouhal];
    let [_, drag, lift] = late[late.len() - 1];
    println!(
        "sphere Re {reynolds}, {} cells, upwind share {upwind}: mean cd {:.4}, cl {:.4}, St {strouhal:.4}; at the end cd {drag:.4}, cl {lift:.4}; \
         lift moves by {swing:.4}",
        grid.cells.len(),
        found[0],
        found[1],
    );
    found
}
