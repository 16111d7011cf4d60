//! Periodic patches: nothing in the flow shows where the domain is cut.

use std::f64::consts::PI;

use crate::common::{Noise, at_rest, isothermal, settings};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{EddyViscosity, Gas, Isothermal, Laminar, Turbulent, Viscosity, WallTreatment};
use flow_solver::residual::Slopes;
use flow_solver::{Solver, Step};
use mesh::{BoxShape, FlowGrid, Patch, box_grid_of};

const SHAPES: [BoxShape; 4] =
    [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra];
const ALL: [Patch; 6] = [Patch::Periodic; 6];
const RHO: f64 = 1.225;
const SIZE: [f64; 3] = [1.0, 0.8, 1.1];

/// A box whose nodes are moved by a periodic function of their places, from `cut` on.
fn wavy(shape: BoxShape, n: [usize; 3], cut: [f64; 3]) -> FlowGrid {
    let high = [0, 1, 2].map(|d| cut[d] + SIZE[d]);
    let mut grid = box_grid_of(shape, n, cut, high, ALL);
    for x in &mut grid.coords {
        let phase = [0, 1, 2].map(|d| 2.0 * PI * x[d] / SIZE[d]);
        for d in 0..3 {
            x[d] += 0.02 * (phase[d] + phase[(d + 1) % 3].sin() + 0.7 * d as f64).sin();
        }
    }
    grid
}

/// A stream with eddies that a period holds.
fn eddies(x: &[f64; 3]) -> [f64; 4] {
    let phase = [0, 1, 2].map(|d| 2.0 * PI * x[d] / SIZE[d]);
    let [a, b, c] = phase;
    [0.0, 3.0 + b.sin() + c.cos(), -2.0 + (a + c).sin(), 1.0 + (a + 0.3).cos() * b.cos()]
}

fn started<V: Viscosity>(grid: &FlowGrid, viscosity: V, upwind: f64) -> Solver<Isothermal, 4> {
    let mut settings = settings([3.0, -2.0, 1.0], 1e-9);
    settings.moving = false;
    let mut s = isothermal(grid, viscosity, settings);
    s.spatial.upwind_share = upwind;
    for (q, x) in s.q.iter_mut().zip(&s.metrics.centre) {
        *q = eddies(x);
    }
    for level in &mut s.previous {
        level.q.copy_from_slice(&s.q);
    }
    s
}

fn advance(s: &mut Solver<Isothermal, 4>, dt: f64, steps: usize) {
    for _ in 0..steps {
        s.advance(&at_rest(dt)).unwrap();
        s.accept(dt, false);
    }
}

/// Places in the first period.
fn wrapped(x: &[f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|d| (x[d] + 1e-6).rem_euclid(SIZE[d]) - 1e-6)
}

/// Largest difference of two states of the same cells, listed in different orders.
fn apart(a: &Solver<Isothermal, 4>, b: &Solver<Isothermal, 4>) -> f64 {
    let mut worst: f64 = 0.0;
    for i in 0..a.topology.n_owned {
        let x = wrapped(&a.metrics.centre[i]);
        let distance = |j: usize| {
            let y = wrapped(&b.metrics.centre[j]);
            (0..3).map(|d| (x[d] - y[d]).powi(2)).sum::<f64>()
        };
        let j = (0..b.topology.n_owned).min_by(|&j, &k| distance(j).total_cmp(&distance(k))).unwrap();
        assert!(distance(j).sqrt() < 1e-9, "cell {i} at {x:?} has no partner");
        let scale = [RHO * 25.0, 5.0, 5.0, 5.0];
        worst = (0..4).map(|v| (a.q[i][v] - b.q[j][v]).abs() / scale[v]).fold(worst, f64::max);
    }
    worst
}

/// The same flow on the same cells, with the domain cut elsewhere in all directions. A wrong image would differ at once.
#[test]
fn the_place_of_the_cut_does_not_matter() {
    let n = [6, 4, 5];
    let cut = [2.0 / 6.0 * SIZE[0], -SIZE[1] / 4.0, 3.0 / 5.0 * SIZE[2]];
    for shape in SHAPES {
        for upwind in [1.0, 0.0] {
            let run = |cut| {
                let mut s = started(&wavy(shape, n, cut), Laminar { viscosity: 2e-3 }, upwind);
                advance(&mut s, 0.01, 3);
                s
            };
            let (a, b) = (run([0.0; 3]), run(cut));
            let moved =
                a.q.iter()
                    .zip(&a.metrics.centre)
                    .map(|(q, x)| (q[1] - eddies(x)[1]).abs())
                    .fold(0.0, f64::max);
            let e = apart(&a, &b);
            println!("{shape:?}, upwind share {upwind}: {e:.1e} apart after a change of {moved:.2} m/s");
            assert!(e < 3e-7 && moved > 0.05, "{shape:?}: {e:e} apart, {moved} moved");
        }
    }
}

/// One octant between planes of symmetry is the whole periodic box of the Taylor-Green vortex to the tolerance of the solver: the flux through a
/// plane of symmetry is that between a cell and its mirror image.
#[test]
fn an_octant_is_an_eighth_of_the_periodic_box() {
    let difference = |n: usize, upwind: f64| {
        let mut octant = crate::vortex::at_start(BoxShape::Hexahedra, n, 1e-6, upwind);
        let mut whole =
            crate::vortex::at_start_in([-PI; 3], [PI; 3], ALL, BoxShape::Hexahedra, 2 * n, 1e-6, upwind);
        for _ in 0..6 {
            crate::vortex::step(&mut octant, 0.2);
            crate::vortex::step(&mut whole, 0.2);
        }
        // The energies are per volume of the octant.
        let (a, b) = (crate::vortex::energy(&octant), crate::vortex::energy(&whole) / 8.0);
        assert!(a < 0.125 && b < 0.125, "{a} and {b} of 0.125");
        a / b - 1.0
    };
    for upwind in [1.0, 0.0] {
        let found = difference(8, upwind);
        println!("upwind share {upwind}: energies of octant and box differ by {found:.1e}");
        assert!(found.abs() < 1e-8, "{found:e}");
    }
}

/// Residuals of one state are the same each time, on an octant between planes of symmetry of all cell types: the second pass of the
/// gradients keeps nothing of an earlier one.
#[test]
fn residual_depends_on_the_state_alone() {
    for shape in SHAPES {
        let mut s = crate::vortex::at_start(shape, 4, 1e-2, 0.0);
        crate::vortex::step(&mut s, 0.1);
        let n = s.q.len();
        let mut kept = s.face_flux().to_vec();
        let (mut q, mut gradient) = (s.q.clone(), vec![[[0.0; 4]; 3]; n]);
        let mut correction = vec![[[0.0; 4]; 3]; s.topology.n_owned];
        let mut residual = || {
            let mut residual = vec![[0.0; 4]; n];
            let slopes = Slopes { gradient: &mut gradient, correction: &mut correction };
            s.spatial.evaluate(&s.domain(), &s.scheme, &mut q, slopes, &mut residual, &mut kept);
            residual
        };
        let first = residual();
        assert!(first == residual(), "{shape:?}");
    }
}

/// A uniform stream on a grid whose inner nodes move at random.
#[test]
fn free_stream_is_preserved() {
    for shape in SHAPES {
        let grid = wavy(shape, [4, 3, 5], [0.0; 3]);
        let wind = [3.0, -2.0, 4.0];
        let mut s = isothermal(&grid, Laminar { viscosity: 1e-3 }, settings(wind, 1e-10));
        let mut fixed = vec![false; grid.coords.len()];
        grid.boundary.iter().flat_map(|(_, face)| *face).for_each(|n| fixed[n as usize] = true);
        let start = s.nodes.clone();
        let mut noise = Noise(11);
        for k in 0..8 {
            for ((x, x0), n) in s.nodes.iter_mut().zip(&start).zip(&s.topology.node_global) {
                if !fixed[*n as usize] {
                    *x = x0 + Vec3::from_fn(|_, _| 0.02 * noise.next());
                }
            }
            let frame = Vec3::new(0.3 * f64::from(k), 1.0, -4.9);
            s.advance(&Step { dt: 4e-3, frame, repeat: false, moved: true }).unwrap();
            s.accept(4e-3, true);
        }
        let far = s.spatial.gas.undisturbed(wind.into());
        let off =
            s.q.iter().map(|q| (0..4).map(|v| (q[v] - far[v]).abs()).fold(0.0, f64::max)).fold(0.0, f64::max);
        assert!(off < 5e-11, "{shape:?}: {off:e}");
    }
}

/// Mass and momentum of a periodic box: what leaves one cell through a periodic face enters the other.
#[test]
fn mass_and_momentum_are_conserved() {
    let eddy =
        Turbulent { viscosity: 1e-4, eddies: EddyViscosity::Smagorinsky, wall: WallTreatment::Resolved };
    for shape in SHAPES {
        let mut s = started(&wavy(shape, [6, 4, 5], [0.0; 3]), eddy, 0.0);
        let totals = |s: &Solver<Isothermal, 4>| -> [f64; 4] {
            let mut sum = [0.0; 4];
            for i in 0..s.topology.n_owned {
                let (q, v) = (&s.q[i], s.metrics.volume[i]);
                let mass = v * s.spatial.gas.density(q);
                sum[0] += mass;
                (1..4).for_each(|d| sum[d] += mass * q[d]);
            }
            sum
        };
        let before = totals(&s);
        advance(&mut s, 0.01, 5);
        let after = totals(&s);
        let mass = after[0] / before[0] - 1.0;
        let momentum = (1..4).map(|d| (after[d] - before[d]).abs() / (before[0] * 4.0)).fold(0.0, f64::max);
        println!("{shape:?}: mass {mass:.1e}, momentum {momentum:.1e}");
        assert!(mass.abs() < 1e-12 && momentum < 1e-9, "{shape:?}: mass {mass:e}, momentum {momentum:e}");
    }
}

/// Error of a two-dimensional Taylor-Green vortex that a stream carries through the periodic sides, one cell thick.
fn carried(n: usize) -> f64 {
    let nu = 0.01;
    let (stream, end) = ([1.0, 0.5], 1.0);
    let depth = 2.0 * PI / n as f64;
    let grid = box_grid_of(BoxShape::Hexahedra, [n, n, 1], [0.0; 3], [2.0 * PI, 2.0 * PI, depth], ALL);
    let settings = settings([stream[0], stream[1], 0.0], 1e-7);
    let mut s = isothermal(&grid, Laminar { viscosity: nu * RHO }, settings);
    let exact = |x: &[f64; 3], t: f64| {
        let (a, b) = (x[0] - stream[0] * t, x[1] - stream[1] * t);
        let decay = (-2.0 * nu * t).exp();
        [
            0.25 * RHO * decay * decay * ((2.0 * a).cos() + (2.0 * b).cos()),
            stream[0] + decay * a.sin() * b.cos(),
            stream[1] - decay * a.cos() * b.sin(),
            0.0,
        ]
    };
    let steps = 2 * n;
    let dt = end / steps as f64;
    for (k, level) in s.previous.iter_mut().enumerate() {
        for (q, x) in level.q.iter_mut().zip(&s.metrics.centre) {
            *q = exact(x, -(k as f64) * dt);
        }
    }
    let previous = s.previous.clone();
    s.restore(previous, dt, 0).unwrap();
    advance(&mut s, dt, steps);
    let square = |i: usize| {
        let e = exact(&s.metrics.centre[i], end);
        (1..3).map(|d| (s.q[i][d] - e[d]).powi(2)).sum::<f64>()
    };
    ((0..s.topology.n_owned).map(square).sum::<f64>() / s.topology.n_owned as f64).sqrt()
}

#[test]
fn a_vortex_that_leaves_and_enters_is_second_order() {
    let (coarse, fine) = (carried(16), carried(32));
    let order = (coarse / fine).log2();
    println!("carried vortex: error {coarse:.3e} to {fine:.3e}, order {order:.2}");
    assert!((1.8..3.2).contains(&order) && fine < 0.02, "{coarse:e} to {fine:e}: order {order:.2}");
}

/// A force drives air between two plates: a parabola, whose values at cell centres a scheme of second order has to
/// $`h^2/4`$ of the step at the wall.
#[test]
fn a_force_drives_plane_poiseuille_flow() {
    let error = |n: usize| {
        let sides =
            [Patch::Periodic, Patch::Periodic, Patch::Wall, Patch::Wall, Patch::Periodic, Patch::Periodic];
        let grid = box_grid_of(BoxShape::Hexahedra, [1, n, 2], [0.0; 3], [0.2, 1.0, 0.3], sides);
        let (mu, force) = (0.5, 4.0);
        let mut settings = settings([0.0; 3], 1e-9);
        settings.moving = false;
        settings.reference_speed = 0.1;
        let mut s = isothermal(&grid, Laminar { viscosity: mu }, settings);
        s.source = vec![[0.0, force, 0.0, 0.0]; s.topology.n_owned];
        advance(&mut s, 1.0, 40);
        let exact = |y: f64| force / (2.0 * mu) * y * (1.0 - y);
        let off = |i: usize| (s.q[i][1] - exact(s.metrics.centre[i][1])).abs();
        (0..s.topology.n_owned).map(off).fold(0.0, f64::max)
    };
    let (coarse, fine) = (error(8), error(16));
    let order = (coarse / fine).log2();
    println!("plane Poiseuille flow: error {coarse:.3e} to {fine:.3e} m/s, order {order:.2}");
    assert!((order - 2.0).abs() < 0.1 && fine < 0.01, "{coarse:e} to {fine:e}: order {order:.2}");
}
