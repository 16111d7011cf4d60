//! Air without friction on badly shaped cells: nothing may feed it energy.

use std::f64::consts::PI;

use crate::common::{Noise, at_rest, isothermal, settings};
use flow_solver::physics::Inviscid;
use mesh::{BoxShape, Patch, box_grid_of};

/// Boxes along each side.
const N: usize = 6;

/// Kinetic energy over that at the start, in unit mass, after each of `steps` steps: eddies in
/// a box whose inner nodes were displaced by up to `shake` of a box's side, stretched by `thin`; `upwind`: smallest upwind share.
fn energies(shape: BoxShape, shake: f64, thin: f64, upwind: f64, steps: usize) -> Vec<f64> {
    let mut grid = box_grid_of(shape, [N; 3], [0.0; 3], [1.0; 3], [Patch::Slip; 6]);
    let mut noise = Noise(5);
    for x in &mut grid.coords {
        let inside = x.iter().all(|x| (1e-9..1.0 - 1e-9).contains(x));
        let d: [f64; 3] = std::array::from_fn(|_| shake / N as f64 * noise.next());
        if inside {
            (0..3).for_each(|k| x[k] += d[k]);
        }
        x[2] *= thin;
    }
    let mut settings = settings([0.0; 3], 1e-3);
    settings.reference_speed = 0.1;
    settings.moving = false;
    let mut s = isothermal(&grid, Inviscid, settings);
    s.spatial.upwind_share = upwind;
    let eddies = |x: &[f64; 3]| {
        let (a, b) = (PI * x[0], PI * x[1]);
        [0.0, a.sin() * b.cos(), -a.cos() * b.sin(), 0.0]
    };
    for previous in &mut s.previous {
        previous.q = s.metrics.centre.iter().map(eddies).collect();
    }
    s.q = s.previous[0].q.clone();
    let energy = |q: &[[f64; 4]], volume: &[f64], n: usize| -> f64 {
        q[..n].iter().zip(volume).map(|(q, v)| v * (q[1] * q[1] + q[2] * q[2] + q[3] * q[3])).sum()
    };
    let n = s.topology.n_owned;
    let start = energy(&s.q, &s.metrics.volume, n);
    // Courant number of about one.
    let dt = 1.0 / N as f64;
    (0..steps)
        .map(|_| {
            s.advance(&at_rest(dt)).unwrap();
            s.accept(dt, true);
            energy(&s.q, &s.metrics.volume, n) / start
        })
        .collect()
}

#[test]
fn kinetic_energy_does_not_grow_on_poor_quality_cells() {
    for shape in [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
        // Flat tetrahedra of a tenth make the pressure's iterations stall: see the known gaps in
        // docs/records/verification.md.
        let flat = if shape == BoxShape::Tetrahedra { 0.2 } else { 0.1 };
        for (shake, thin, upwind) in [
            (0.0, 1.0, 1.0),
            (0.25, 1.0, 1.0),
            (0.2, flat, 1.0),
            (0.0, 1.0, 0.0),
            (0.25, 1.0, 0.0),
            (0.2, flat, 0.0),
        ] {
            let e = energies(shape, shake, thin, upwind, 120);
            let most = e.iter().fold(0.0f64, |m, e| m.max(*e));
            println!(
                "{shape:?}, shaken by {shake}, thin {thin}, upwind {upwind}: most {most:.3}, at the end {:.3}",
                e[119]
            );
            assert!(most < 1.0, "{shape:?}, shaken by {shake}, thin {thin}, upwind {upwind}: {most}");
        }
    }
}
