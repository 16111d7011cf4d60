//! A uniform stream stays uniform whatever the grid does.

#![allow(clippy::needless_range_loop)]

use crate::common::{Noise, isothermal, settings, solver_of};
use flow_solver::Step;
use flow_solver::geometry::Metrics;
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{Gas, IdealGas, Inviscid, Laminar, Viscosity};
use mesh::{BoxShape, FlowGrid, Patch, box_grid_of};

const SHAPES: [BoxShape; 4] =
    [BoxShape::Hexahedra, BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra];

fn shaken(shape: BoxShape) -> FlowGrid {
    let mut grid = box_grid_of(shape, [4, 3, 5], [0.0; 3], [1.0, 0.8, 1.1], [Patch::FarField; 6]);
    let mut noise = Noise(7);
    for x in grid.coords.iter_mut().flatten() {
        *x += 0.02 * noise.next();
    }
    grid
}

fn drift<G: Gas<N>, V: Viscosity, const N: usize>(shape: BoxShape, gas: G, viscosity: V) -> f64 {
    let even = drift_on(&shaken(shape), gas, viscosity, 8, false);
    even.max(drift_on(&shaken(shape), gas, viscosity, 8, true))
}

fn drift_on<G: Gas<N>, V: Viscosity, const N: usize>(
    grid: &FlowGrid,
    gas: G,
    viscosity: V,
    steps: usize,
    uneven: bool,
) -> f64 {
    let wind = [3.0, -2.0, 4.0];
    let mut s = solver_of(grid, gas, viscosity, settings(wind, 1e-10));
    let start = s.nodes.clone();
    let mut noise = Noise(11);
    let mut lengths = Noise(5);
    for k in 0..steps {
        // Random lengths, each at most 2.25 times the one before it.
        let dt = if uneven { 4e-3 * 1.5f64.powf(lengths.next()) } else { 4e-3 };
        for (x, x0) in s.nodes.iter_mut().zip(&start) {
            for (x, x0) in x.iter_mut().zip(x0) {
                *x = x0 + 0.02 * noise.next();
            }
        }
        let frame = Vec3::new(0.3 * (k % 8) as f64, 1.0, -4.9);
        s.advance(&Step { dt, frame, repeat: false, moved: true }).unwrap();
        s.accept(dt, true);
    }
    let far = s.spatial.gas.undisturbed(wind.into());
    let mut worst: f64 = 0.0;
    for q in &s.q {
        // Pressure in units of the dynamic pressure, velocity in units of the stream.
        worst = worst.max((q[0] - far[0]).abs() / 18.0);
        for d in 1..4 {
            worst = worst.max((q[d] - far[d]).abs() / 5.4);
        }
    }
    worst
}

/// Hexahedra, prisms, pyramids and tetrahedra in one box, each against the next kind.
fn mixed() -> FlowGrid {
    let n = [5, 3, 3];
    let base = mesh::box_grid(n, [0.0; 3], [1.0, 0.8, 0.9], [Patch::FarField; 6]);
    let mut grid = FlowGrid { coords: base.coords.clone(), ..Default::default() };
    for (at, cell) in base.cells.iter().enumerate() {
        let [a, b, c, d, e, f, g, h] = *cell;
        match at % n[0] {
            // A layer of prisms, cut along the diagonals of its z-faces.
            0 => grid.cells.extend([[a, b, c, c, e, f, g, g], [a, c, d, d, e, g, h, h]]),
            1 | 4 => grid.cells.push(*cell),
            _ => {
                let m = grid.coords.len() as u32;
                let mean = |x: usize| cell.iter().map(|&v| base.coords[v as usize][x]).sum::<f64>() / 8.0;
                grid.coords.push(std::array::from_fn(mean));
                for (side, face) in mesh::HEX_FACES.iter().enumerate() {
                    let [p, q, r, s] = face.map(|v| cell[v]);
                    // Two layers of pyramids; those that face each other become tetrahedra.
                    let facing = if at % n[0] == 2 { side == 3 } else { side == 5 };
                    if !facing {
                        grid.cells.push([s, r, q, p, m, m, m, m]);
                        continue;
                    }
                    let nodes = [p, q, r, s];
                    let low = (0..4).min_by_key(|&i| nodes[i]).unwrap();
                    let [p, q, r, s] = std::array::from_fn(|i| nodes[(low + i) % 4]);
                    grid.cells.extend([[r, q, p, p, m, m, m, m], [s, r, p, p, m, m, m, m]]);
                }
            }
        }
    }
    for &(patch, face) in &base.boundary {
        let level =
            |d: usize| face.iter().all(|&v| base.coords[v as usize][d] == base.coords[face[0] as usize][d]);
        let prism = face.iter().all(|&v| base.coords[v as usize][0] < 0.21);
        if level(2) && prism {
            let low = (0..4).min_by_key(|&i| face[i]).unwrap();
            let [p, q, r, s] = std::array::from_fn(|i| face[(low + i) % 4]);
            grid.boundary.extend([(patch, [p, q, r, r]), (patch, [p, r, s, s])]);
        } else {
            grid.boundary.push((patch, face));
        }
    }
    grid
}

#[test]
fn free_stream_is_preserved_over_a_thousand_steps() {
    let air = settings([0.0; 3], 1.0).air;
    for uneven in [false, true] {
        let gas = flow_solver::physics::Isothermal::new(air);
        let e = drift_on(&mixed(), gas, Laminar { viscosity: 1e-3 }, 1000, uneven);
        println!("free stream after 1000 steps{}: {e:.1e}", if uneven { " of random lengths" } else { "" });
        assert!(e < 1e-12, "{e:e}");
    }
}

#[test]
fn free_stream_is_preserved_on_moving_grids_of_all_cell_types() {
    let air = settings([0.0; 3], 1.0).air;
    for shape in SHAPES {
        // Gauge pressure carries the round-off of the compressibility: rho c^2 / (rho U^2) larger.
        let e = drift(shape, flow_solver::physics::Isothermal::new(air), Inviscid);
        assert!(e < 1e-12, "{shape:?}: {e:e}");
        let e = drift(shape, flow_solver::physics::Isothermal::new(air), Laminar { viscosity: 1e-3 });
        assert!(e < 1e-12, "{shape:?}, viscous: {e:e}");
        let e = drift(shape, IdealGas::new(air), Inviscid);
        assert!(e < 1e-10, "{shape:?}, energy: {e:e}");
    }
}

#[test]
fn swept_volumes_sum_to_the_change_of_volume() {
    for shape in SHAPES {
        let s = isothermal(&shaken(shape), Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
        let mut noise = Noise(3);
        let moved: Vec<_> = s.nodes.iter().map(|x| x.map(|x| x + 0.03 * noise.next())).collect();
        let after = Metrics::new(&s.topology, &s.halo, &moved);
        let mut swept = vec![0.0; s.topology.face_nodes.len()];
        Metrics::swept(&s.topology, &s.nodes, &moved, &mut swept);
        let mut change: Vec<f64> = after.volume.iter().zip(&s.metrics.volume).map(|(a, b)| a - b).collect();
        let mut area = vec![[0.0; 3]; change.len()];
        s.topology.for_each_side(|f, c, sign| {
            change[c] -= sign * swept[f];
            for d in 0..3 {
                area[c][d] += sign * after.faces[f].area[d];
            }
        });
        let worst = change.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        assert!(worst < 1e-16, "{shape:?}: {worst:e} m3 of cells of about 5e-3 m3 or less");
        let open = area.iter().flatten().fold(0.0, |m: f64, x| m.max(x.abs()));
        assert!(open < 1e-15, "{shape:?}: cell open by {open:e} m2");
        let total: f64 = s.metrics.volume.iter().sum();
        assert!(total > 0.7 && total < 1.1);
    }
}

#[test]
fn gradients_of_linear_fields_are_exact() {
    for shape in SHAPES {
        let mut s = isothermal(&shaken(shape), Inviscid, settings([1.0, 0.0, 0.0], 1e-3));
        let slope = [[2.0, -1.0, 0.5], [0.3, 4.0, 1.0], [1.0, 1.0, -3.0], [0.0, 2.0, 0.7]];
        for (q, x) in s.q.iter_mut().zip(&s.metrics.centre) {
            *q = std::array::from_fn(|v| 1.0 + (0..3).map(|d| slope[v][d] * x[d]).sum::<f64>());
        }
        let least = flow_solver::gradient::LeastSquares::new(&s.topology, &s.metrics);
        let mut g = vec![[[0.0; 4]; 3]; s.q.len()];
        least.apply(&s.topology, &s.q, &mut g);
        // Cells in a corner that see fewer than three neighbours cannot span space.
        let a = &s.topology.adjacency;
        let mut seen = 0;
        for (i, g) in g.iter().enumerate() {
            if a.start[i + 1] - a.start[i] < 3 {
                continue;
            }
            seen += 1;
            for v in 0..4 {
                for d in 0..3 {
                    let e = (g[d][v] - slope[v][d]).abs();
                    // Weights of single precision (6e-8), amplified where three neighbours are nearly coplanar:
                    // 2.3e-5 at most here.
                    assert!(e < 5e-5, "{shape:?} cell {i}: {e:e}");
                }
            }
        }
        assert!(seen * 2 > s.q.len());
    }
}

/// A periodic, rising or tabulated wind moves all air alike: without an obstacle the stream stays uniform and has the
/// wind's velocity, on grids that move, to the round-off of the solves.
#[test]
fn free_stream_follows_every_shape_of_a_gust() {
    use case::{Gust, GustShape};
    let pulse = Gust::pulse([2.0, -5.0, 1.0], 0.01, 0.04);
    let table = |time_s: &[f64], factor: &[f64]| (time_s.to_vec(), factor.to_vec());
    let (time_s, factor) = table(&[0.0, 0.013, 0.03, 0.05], &[0.2, 1.0, -0.7, 0.2]);
    let shapes = [
        ("train", Gust { period_s: Some(0.05), ..pulse.clone() }),
        ("ramp", Gust { shape: GustShape::Ramp, ..pulse.clone() }),
        ("sine", Gust { shape: GustShape::Sine, duration_s: None, period_s: Some(0.05), ..pulse.clone() }),
        (
            "table",
            Gust {
                shape: GustShape::Table,
                duration_s: None,
                period_s: Some(0.06),
                time_s,
                factor,
                ..pulse.clone()
            },
        ),
        ("pulse", pulse),
    ];
    for (name, gust) in shapes {
        let wind = case::Wind::uniform([3.0, -2.0, 4.0]).with_gust(gust, 0.0);
        for moved in [false, true] {
            let (e, least) = drift_in(&wind, moved);
            println!("free stream in a {name}, grid moved {moved}: {e:.1e}, span of the wind {least:.2} m/s");
            assert!(least > 2.0 && e < 1e-12, "{name}, grid moved {moved}: {e:e}");
        }
    }
}

/// The air follows the pulse of `[stage.perturbation]` too, across a stream that is at an angle to all axes.
#[test]
fn free_stream_follows_a_perturbation() {
    let scene = "name = \"p\"\n[canopy]\nkind = \"panel\"\nsize_m = [1, 1]\ncells = [4, 4]\n\
                 [fabric]\nyoungs_modulus_pa = 1e6\npoisson_ratio = 0.3\nthickness_m = 1e-3\ndensity_kg_m3 = 1000.0\n\
                 [flow]\nwind_m_s = [3.0, -2.0, 4.0]\n\
                 [flow.box]\nbelow_m = 1\nabove_m = 1\nlayers_below = 5\nlayers_above = 5\n\
                 [flow.box.sides]\nleft = \"far-field\"\nright = \"far-field\"\nfront = \"far-field\"\nback = \"far-field\"\n\
                 bottom = \"far-field\"\ntop = \"far-field\"\n\
                 [[stage]]\nname = \"f\"\nkind = \"flow-only\"\nduration_s = 0.15\nwindow_s = 2.5e-3\n\
                 [stage.perturbation]\nspeed_share = 0.4\nduration_s = 0.1\nstart_s = 0.01\nseed = 3\n";
    let scene = case::parse(std::path::Path::new("p.toml"), scene).unwrap_or_else(|e| panic!("{e}"));
    let wind = scene.wind(0, &case::StageTimes::planned(&scene));
    for moved in [false, true] {
        let (e, span) = drift_in(&wind, moved);
        println!(
            "free stream in a perturbation, grid moved {moved}: {e:.1e}, span of the wind {span:.2} m/s"
        );
        assert!(span > 0.5 && e < 1e-12, "grid moved {moved}: {e:e}");
    }
}

/// Largest deviation of the air from `wind` (m/s) over 60 steps, and the span of its second component, m/s.
fn drift_in(wind: &case::Wind, moved: bool) -> (f64, f64) {
    let air = settings([0.0; 3], 1.0).air;
    let gas = flow_solver::physics::Isothermal::new(air);
    let grid = shaken(BoxShape::Prisms);
    let mut s = solver_of(&grid, gas, Laminar { viscosity: 1e-3 }, settings(wind.at(0.0), 1e-11));
    let start = s.nodes.clone();
    let (mut noise, dt) = (Noise(11), 2.5e-3);
    let (mut worst, mut span) = (0.0f64, [f64::INFINITY, f64::NEG_INFINITY]);
    for k in 0..60 {
        let t = dt * f64::from(k);
        if moved {
            for (x, x0) in s.nodes.iter_mut().flatten().zip(start.iter().flatten()) {
                *x = x0 + 0.02 * noise.next();
            }
        }
        s.set_far_field_velocity([t + dt, t, t - dt].map(|t| wind.at(t).into()), dt);
        s.advance(&Step { dt, frame: Vec3::zeros(), repeat: false, moved }).unwrap();
        s.accept(dt, moved);
        let now = wind.at(t + dt);
        span = [span[0].min(now[1]), span[1].max(now[1])];
        for q in &s.q {
            worst = (0..3).map(|d| (q[1 + d] - now[d]).abs()).fold(worst, f64::max);
        }
    }
    (worst, span[1] - span[0])
}
