//! A uniform stream stays uniform whatever the grid does.

#![allow(clippy::needless_range_loop)]

mod common;

use common::{Noise, isothermal, settings, solver_of};
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
