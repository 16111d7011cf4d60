//! The contract of the participant on one rank.

mod common;

use case::{MeshMotion, Role};
use channel::{Participant, Window, mesh_stats};
use comm::Comm;
use common::{MoverFixture, window};
use mesh_mover::state::State;

/// Largest difference of two solutions for one input, m: the tolerance is 3e-3 of the shortest edge (0.07) in the
/// estimate of the preconditioner; smooth errors (which do not deform cells) may be a few times larger.
const CLOSE: f64 = 1e-3;

fn fixture() -> MoverFixture {
    MoverFixture::new(&Comm::solo(), &MeshMotion::default(), None)
}

fn positions(output: &[f64]) -> Vec<f64> {
    output.as_chunks::<6>().0.iter().flat_map(|r| [r[0], r[1], r[2]]).collect()
}

#[test]
fn canopy_is_bitwise_exact_outer_boundary_at_rest_and_velocities_are_bdf2() {
    let mut fixture = fixture();
    let dt = window(0, 0).dt;
    let mut history = vec![fixture.grid.coords.as_flattened().to_vec()];
    for index in 0..4 {
        let d = fixture.displacement(0.5 * (index + 1) as f64);
        let stats = fixture.advance(&window(index, 0), &d).unwrap();
        assert!(stats.values[mesh_stats::MIN_QUALITY] > 0.1);
        assert_eq!(stats.values[mesh_stats::INCREMENTS], 1.0);
        assert!(stats.values[mesh_stats::RESIDUAL] <= 3e-3);
        let rows = fixture.output.as_chunks::<6>().0;
        for (k, &a) in fixture.grid.canopy_nodes.iter().enumerate() {
            for i in 0..3 {
                assert_eq!(rows[a as usize][i], fixture.structure.coords[k][i] + d[3 * k + i]);
            }
        }
        for &a in fixture.grid.boundary.iter().flat_map(|(_, f)| f) {
            assert_eq!(rows[a as usize][..3], fixture.grid.coords[a as usize]);
            assert_eq!(rows[a as usize][3..], [0.0; 3]);
        }
        let now = positions(&fixture.output);
        for (a, row) in rows.iter().enumerate() {
            for i in 0..3 {
                let (x, x1) = (now[3 * a + i], history[index as usize][3 * a + i]);
                let v = match index {
                    0 => (x - x1) / dt,
                    _ => (3.0 * x - 4.0 * x1 + history[index as usize - 1][3 * a + i]) / (2.0 * dt),
                };
                // The two forms of the formula differ by round-off of positions of order one.
                assert!((row[3 + i] - v).abs() < 1e-14 / dt, "node {a}: {} {v}", row[3 + i]);
            }
        }
        history.push(now);
        fixture.mover.accept(&window(index, 0)).unwrap();
    }
}

#[test]
fn iterations_restart_from_the_accepted_state() {
    let mut fixture = fixture();
    let (d1, d2) = (fixture.displacement(0.6), fixture.displacement(0.9));
    fixture.advance(&window(0, 0), &d1).unwrap();
    fixture.mover.accept(&window(0, 0)).unwrap();
    fixture.advance(&window(1, 0), &d2).unwrap();
    let once = fixture.output.clone();
    let wild = fixture.displacement(-1.5);
    fixture.advance(&window(1, 1), &wild).unwrap();
    fixture.advance(&window(1, 2), &d2).unwrap();
    let max_difference = |i: usize, bound: f64| {
        for (a, b) in fixture.output.as_chunks::<6>().0.iter().zip(once.as_chunks::<6>().0) {
            assert!((a[i] - b[i]).abs() < bound, "{} {}", a[i], b[i]);
        }
    };
    (0..3).for_each(|i| max_difference(i, CLOSE));
    (3..6).for_each(|i| max_difference(i, 1.5 * CLOSE / 0.25));
}

#[test]
fn small_motions_within_a_window_are_one_linear_function_bitwise() {
    let mut fixture = fixture();
    let d = fixture.displacement(0.6);
    fixture.advance(&window(0, 0), &d).unwrap();
    let first = fixture.output.clone();
    // Smooth and rough, up to 4 mm: the shortest edges are 70 mm.
    let nudge = |s: f64| -> Vec<f64> {
        d.iter()
            .enumerate()
            .map(|(i, d)| d + 4e-3 * s * (0.1 * i as f64).sin() * (1.7 * i as f64).cos())
            .collect()
    };
    let whole = fixture.advance(&window(0, 1), &nudge(1.0)).unwrap();
    assert_eq!(whole.values[mesh_stats::ITERATIONS], 0.0);
    let moved = fixture.output.clone();
    fixture.advance(&window(0, 2), &nudge(-0.5)).unwrap();
    let back = fixture.output.clone();
    let (mut near, mut far) = (0, 0);
    for (i, ((a, b), c)) in first.iter().zip(&moved).zip(&back).enumerate() {
        assert!((b - a + 2.0 * (c - a)).abs() < 1e-13, "a line through {a}: {b} {c}");
        // Positions: most of the motion is new to past solutions, and stays near the canopy.
        match (b - a).abs() {
            _ if i % 6 >= 3 => {}
            d if d > 4e-4 => near += 1,
            d if d < 4e-5 => far += 1,
            _ => {}
        }
    }
    assert!(near > 0 && far > near / 4, "{near} {far}");
    fixture.advance(&window(0, 3), &d).unwrap();
    assert_eq!(fixture.output, first, "the same input gives the same bits");
    // The next window starts from the canopy's position alone: no error has accumulated.
    fixture.advance(&window(0, 4), &nudge(1.0)).unwrap();
    fixture.mover.accept(&window(0, 4)).unwrap();
    fixture.advance(&window(1, 0), &vec![0.0; d.len()]).unwrap();
    assert_eq!(positions(&fixture.output), fixture.grid.coords.as_flattened());
}

#[test]
fn repeated_calls_are_bitwise_reproducible() {
    let run = || {
        let mut fixture = fixture();
        for index in 0..3 {
            for iteration in 0..3 {
                let d = fixture.displacement(0.3 * index as f64 + 0.1 * iteration as f64);
                fixture.advance(&window(index, iteration), &d).unwrap();
            }
            fixture.mover.accept(&window(index, 2)).unwrap();
        }
        fixture.output
    };
    assert_eq!(run(), run());
}

#[test]
fn invalid_input_is_named_and_keeps_the_state() {
    let mut fixture = fixture();
    let good = fixture.displacement(0.5);
    fixture.advance(&window(0, 0), &good).unwrap();
    fixture.mover.accept(&window(0, 0)).unwrap();
    let before = fixture.mover.positions().clone();
    for value in [f64::NAN, f64::INFINITY] {
        let mut bad = good.clone();
        bad[3 * 7 + 1] = value;
        let fault = fixture.advance(&window(1, 0), &bad).unwrap_err();
        assert!(fault.message.contains("canopy node 7 (panel 0)"), "{fault}");
        assert!(fault.message.contains("along y"), "{fault}");
    }
    let fault = fixture.advance(&window(1, 0), &good[3..]).unwrap_err();
    assert!(fault.message.contains("expected"), "{fault}");
    // A jump through the wall of the box.
    let far: Vec<f64> = good.iter().enumerate().map(|(i, d)| if i % 3 == 2 { d + 2.5 } else { *d }).collect();
    // The failure is reported in the response, so that the coupler can save the accepted state.
    let stats = fixture.advance(&window(1, 0), &far).unwrap();
    assert_eq!(stats.values[mesh_stats::STUCK], 1.0);
    assert!(stats.values[mesh_stats::NEAREST_NODE] >= 0.0 && stats.values[mesh_stats::WORST_CELL] >= 0.0);
    let fault = fixture.mover.failure().expect("a message").clone();
    assert!(fault.message.contains("cell ") && fault.message.contains("nearest canopy node"), "{fault}");
    assert_eq!(positions(&fixture.output), before.grid, "the grid is unchanged");
    assert!(fixture.mover.accept(&window(1, 0)).is_err(), "a failed window cannot be accepted");
    assert_eq!(*fixture.mover.positions(), before);
    let stats = fixture.advance(&window(1, 1), &good).unwrap();
    assert!(stats.values[mesh_stats::STUCK] == 0.0 && fixture.mover.failure().is_none());
}

#[test]
fn saved_state_continues_to_the_solver_tolerance() {
    let folder = tempfile::tempdir().unwrap();
    let mut fixture = fixture();
    let path: Vec<Vec<f64>> = [0.2, 0.5, 0.4].iter().map(|&t| fixture.displacement(t)).collect();
    for index in 0..2 {
        fixture.advance(&window(index, 0), &path[index as usize]).unwrap();
        fixture.mover.accept(&window(index, 0)).unwrap();
    }
    fixture.mover.save(folder.path()).unwrap();
    fixture.advance(&window(2, 0), &path[2]).unwrap();
    let state = State::load(&case::state_file(folder.path(), Role::Mesh), fixture.grid.coords.len()).unwrap();
    assert!(state.reference.is_empty(), "the reference is the start grid");
    let mut again = MoverFixture::new(&Comm::solo(), &MeshMotion::default(), Some(state));
    assert_eq!(fixture.mover.positions(), again.mover.positions());
    again.advance(&window(2, 0), &path[2]).unwrap();
    for (i, (a, b)) in fixture.output.iter().zip(&again.output).enumerate() {
        // Without the past solutions: the tolerance of the solver, and its velocity.
        let bound = if i % 6 < 3 { CLOSE } else { 1.5 * CLOSE / 0.25 };
        assert!((a - b).abs() < bound, "{i}: {a} {b}");
    }
}

/// Derivative at `t[0]` of the parabola through the points `x` at the times `t`.
fn slope(t: [f64; 3], x: [f64; 3]) -> f64 {
    let [a, b] = [t[0] - t[1], t[0] - t[2]];
    x[0] * (1.0 / a + 1.0 / b) - x[1] * b / (a * (b - a)) + x[2] * a / (b * (b - a))
}

/// Windows of unequal lengths: velocities are those of a parabola through the last three positions, also after a
/// window was repeated with another length and after the mover was restarted from its saved state.
#[test]
fn velocities_are_second_order_over_unequal_windows() {
    let folder = tempfile::tempdir().unwrap();
    let mut fixture = fixture();
    let nodes = fixture.grid.coords.len();
    // Quadratic in time: the canopy's velocities are exact.
    let path = |t: f64| 0.4 * t - 0.3 * t * t;
    let pace = |t: f64| 0.4 - 0.6 * t;
    let lengths = [0.25, 0.125, 0.25, 0.2, 0.05, 0.1];
    let (mut times, mut history) = (vec![0.0], vec![fixture.grid.coords.as_flattened().to_vec()]);
    for (index, &dt) in lengths.iter().enumerate() {
        let begin = times[index];
        let window = |iteration, dt| Window { dt, time: begin, ..window(index as u64, iteration) };
        if index == 3 {
            // Rejected, and retried.
            let d = fixture.displacement(path(begin + 0.4));
            fixture.advance(&window(0, 0.4), &d).unwrap();
        }
        let d = fixture.displacement(path(begin + dt));
        fixture.advance(&window(1, dt), &d).unwrap();
        let now = positions(&fixture.output);
        times.push(begin + dt);
        if index > 0 {
            let t = [times[index + 1], times[index], times[index - 1]];
            let scale = fixture.displacement(1.0);
            for (k, &a) in fixture.grid.canopy_nodes.iter().enumerate() {
                for i in 0..3 {
                    let v = fixture.output[6 * a as usize + 3 + i];
                    let exact = pace(t[0]) * scale[3 * k + i];
                    assert!((v - exact).abs() < 1e-13, "window {index}, canopy node {k}: {v} {exact}");
                }
            }
            for (j, row) in fixture.output.as_chunks::<6>().0.iter().enumerate() {
                for i in 0..3 {
                    let n = 3 * j + i;
                    let v = slope(t, [now[n], history[index][n], history[index - 1][n]]);
                    // Round-off of positions of order one over the shortest window.
                    assert!((row[3 + i] - v).abs() < 1e-13, "window {index}, node {j}: {} {v}", row[3 + i]);
                }
            }
        }
        history.push(now);
        fixture.mover.accept(&window(1, dt)).unwrap();
        if index == 4 {
            fixture.mover.save(folder.path()).unwrap();
            let state = State::load(&case::state_file(folder.path(), Role::Mesh), nodes).unwrap();
            fixture = MoverFixture::new(&Comm::solo(), &MeshMotion::default(), Some(state));
        }
    }
}

/// A canopy that swings by 60 degrees about a point below it: the cells around it keep their shape, its nodes are exact, and a run that
/// resumes in the middle finds the same grid.
#[test]
fn grid_turns_with_a_swinging_canopy() {
    let swing = |structure: &mesh::StructureMesh, degrees: f64| -> Vec<f64> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let turned = |p: &[f64; 3]| {
            let z = p[2] + 0.3;
            [cos * p[0] + sin * z - p[0], 0.0, cos * z - sin * p[0] - 0.3 - p[2]]
        };
        structure.coords.iter().flat_map(turned).collect()
    };
    let folder = tempfile::tempdir().unwrap();
    let mut fixture = fixture();
    let start = fixture.advance(&window(0, 0), &swing(&fixture.structure, 0.0)).unwrap();
    let mut worst = 1.0f64;
    let last = 12;
    for index in 0..=last {
        let d = swing(&fixture.structure, 5.0 * index as f64);
        if index == last {
            fixture.mover.save(folder.path()).unwrap();
        }
        let stats = fixture.advance(&window(index, 0), &d).unwrap();
        worst = worst.min(stats.values[mesh_stats::MIN_QUALITY]);
        assert_eq!(stats.values[mesh_stats::INCREMENTS], 1.0, "{index}");
        let rows = fixture.output.as_chunks::<6>().0;
        for (k, &a) in fixture.grid.canopy_nodes.iter().enumerate() {
            for i in 0..3 {
                assert_eq!(rows[a as usize][i], fixture.structure.coords[k][i] + d[3 * k + i]);
            }
        }
        if index < last {
            fixture.mover.accept(&window(index, 0)).unwrap();
        }
    }
    let start = start.values[mesh_stats::MIN_QUALITY];
    println!("smallest scaled Jacobian {worst:.3}, at the start {start:.3}");
    assert!(worst > 0.8 * start, "{worst} of {start}");
    // The next solve of the window differs by a small motion, and so does the grid.
    let first = fixture.output.clone();
    let near = swing(&fixture.structure, 5.0 * last as f64 + 1e-4);
    fixture.advance(&window(last, 1), &near).unwrap();
    let moved = positions(&first)
        .iter()
        .zip(positions(&fixture.output))
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max);
    assert!(moved > 0.0 && moved < 1e-5, "{moved:e}");
    // Without the past solutions: a few times the tolerance, as the error is smooth.
    let state = State::load(&case::state_file(folder.path(), Role::Mesh), fixture.grid.coords.len()).unwrap();
    let mut again = MoverFixture::new(&Comm::solo(), &MeshMotion::default(), Some(state));
    again.advance(&window(last, 0), &swing(&fixture.structure, 5.0 * last as f64)).unwrap();
    for (i, (a, b)) in first.iter().zip(&again.output).enumerate() {
        let bound = if i % 6 < 3 { 3.0 * CLOSE } else { 4.5 * CLOSE / 0.25 };
        assert!((a - b).abs() < bound, "{i}: {a} {b}");
    }
}
