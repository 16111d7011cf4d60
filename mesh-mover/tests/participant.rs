//! The contract of the participant on one rank.

mod common;

use case::{MeshMotion, Role};
use channel::{Participant, Window, mesh_stats};
use comm::Comm;
use common::{Rig, window};
use mesh_mover::state::State;

/// How near two answers to one input are, m: the tolerance is 3 thousandths of the
/// shortest edge (0.07), as far as the preconditioner sees the error; smooth errors
/// (which no cell feels) may be a few times larger.
const CLOSE: f64 = 1e-3;

fn rig() -> Rig {
    Rig::new(&Comm::solo(), &MeshMotion::default(), None)
}

fn positions(output: &[f64]) -> Vec<f64> {
    output.as_chunks::<6>().0.iter().flat_map(|r| [r[0], r[1], r[2]]).collect()
}

#[test]
fn canopy_to_the_bit_outer_boundary_at_rest_velocities_by_the_formula() {
    let mut rig = rig();
    let dt = window(0, 0).dt;
    let mut history = vec![rig.grid.coords.as_flattened().to_vec()];
    for index in 0..4 {
        let d = rig.displacement(0.5 * (index + 1) as f64);
        let stats = rig.advance(&window(index, 0), &d).unwrap();
        assert!(stats.values[mesh_stats::MIN_QUALITY] > 0.1);
        assert_eq!(stats.values[mesh_stats::INCREMENTS], 1.0);
        assert!(stats.values[mesh_stats::RESIDUAL] <= 3e-3);
        let rows = rig.output.as_chunks::<6>().0;
        for (k, &a) in rig.grid.canopy_nodes.iter().enumerate() {
            for i in 0..3 {
                assert_eq!(rows[a as usize][i], rig.structure.coords[k][i] + d[3 * k + i]);
            }
        }
        for &a in rig.grid.boundary.iter().flat_map(|(_, f)| f) {
            assert_eq!(rows[a as usize][..3], rig.grid.coords[a as usize]);
            assert_eq!(rows[a as usize][3..], [0.0; 3]);
        }
        let now = positions(&rig.output);
        for (a, row) in rows.iter().enumerate() {
            for i in 0..3 {
                let (x, x1) = (now[3 * a + i], history[index as usize][3 * a + i]);
                let v = match index {
                    0 => (x - x1) / dt,
                    _ => (3.0 * x - 4.0 * x1 + history[index as usize - 1][3 * a + i]) / (2.0 * dt),
                };
                // The two forms of the formula differ by rounding of positions of order one.
                assert!((row[3 + i] - v).abs() < 1e-14 / dt, "node {a}: {} {v}", row[3 + i]);
            }
        }
        history.push(now);
        rig.mover.accept(&window(index, 0)).unwrap();
    }
}

#[test]
fn iterations_restart_from_the_accepted_state() {
    let mut rig = rig();
    let (d1, d2) = (rig.displacement(0.6), rig.displacement(0.9));
    rig.advance(&window(0, 0), &d1).unwrap();
    rig.mover.accept(&window(0, 0)).unwrap();
    rig.advance(&window(1, 0), &d2).unwrap();
    let once = rig.output.clone();
    let wild = rig.displacement(-1.5);
    rig.advance(&window(1, 1), &wild).unwrap();
    rig.advance(&window(1, 2), &d2).unwrap();
    let apart = |i: usize, bound: f64| {
        for (a, b) in rig.output.as_chunks::<6>().0.iter().zip(once.as_chunks::<6>().0) {
            assert!((a[i] - b[i]).abs() < bound, "{} {}", a[i], b[i]);
        }
    };
    (0..3).for_each(|i| apart(i, CLOSE));
    (3..6).for_each(|i| apart(i, 1.5 * CLOSE / 0.25));
}

#[test]
fn within_a_window_small_motions_are_one_linear_function_to_the_bit() {
    let mut rig = rig();
    let d = rig.displacement(0.6);
    rig.advance(&window(0, 0), &d).unwrap();
    let first = rig.output.clone();
    // Smooth and rough, up to 4 mm: the shortest edges are 70 mm.
    let nudge = |s: f64| -> Vec<f64> {
        d.iter()
            .enumerate()
            .map(|(i, d)| d + 4e-3 * s * (0.1 * i as f64).sin() * (1.7 * i as f64).cos())
            .collect()
    };
    let whole = rig.advance(&window(0, 1), &nudge(1.0)).unwrap();
    assert_eq!(whole.values[mesh_stats::ITERATIONS], 0.0);
    let moved = rig.output.clone();
    rig.advance(&window(0, 2), &nudge(-0.5)).unwrap();
    let back = rig.output.clone();
    let (mut near, mut far) = (0, 0);
    for ((a, b), c) in first.iter().zip(&moved).zip(&back) {
        assert!((b - a + 2.0 * (c - a)).abs() < 1e-13, "a line through {a}: {b} {c}");
        if a == b { far += 1 } else { near += 1 }
    }
    assert!(near > 0 && far > near / 4, "{near} {far}");
    rig.advance(&window(0, 3), &d).unwrap();
    assert_eq!(rig.output, first, "the same input, the same bits");
    // The next window starts from the canopy's position alone: nothing has piled up.
    rig.advance(&window(0, 4), &nudge(1.0)).unwrap();
    rig.mover.accept(&window(0, 4)).unwrap();
    rig.advance(&window(1, 0), &vec![0.0; d.len()]).unwrap();
    assert_eq!(positions(&rig.output), rig.grid.coords.as_flattened());
}

#[test]
fn the_same_calls_give_the_same_bits() {
    let run = || {
        let mut rig = rig();
        for index in 0..3 {
            for iteration in 0..3 {
                let d = rig.displacement(0.3 * index as f64 + 0.1 * iteration as f64);
                rig.advance(&window(index, iteration), &d).unwrap();
            }
            rig.mover.accept(&window(index, 2)).unwrap();
        }
        rig.output
    };
    assert_eq!(run(), run());
}

#[test]
fn bad_input_is_named_and_leaves_the_state() {
    let mut rig = rig();
    let good = rig.displacement(0.5);
    rig.advance(&window(0, 0), &good).unwrap();
    rig.mover.accept(&window(0, 0)).unwrap();
    let before = rig.mover.positions().clone();
    for value in [f64::NAN, f64::INFINITY] {
        let mut bad = good.clone();
        bad[3 * 7 + 1] = value;
        let fault = rig.advance(&window(1, 0), &bad).unwrap_err();
        assert!(fault.message.contains("canopy node 7 (panel 0)"), "{fault}");
        assert!(fault.message.contains("along y"), "{fault}");
    }
    let fault = rig.advance(&window(1, 0), &good[3..]).unwrap_err();
    assert!(fault.message.contains("expected"), "{fault}");
    // A jump through the wall of the box.
    let far: Vec<f64> = good.iter().enumerate().map(|(i, d)| if i % 3 == 2 { d + 2.5 } else { *d }).collect();
    // The coupler hears of it in an answer, so that it can save what was accepted.
    let stats = rig.advance(&window(1, 0), &far).unwrap();
    assert_eq!(stats.values[mesh_stats::STUCK], 1.0);
    assert!(stats.values[mesh_stats::NEAREST_NODE] >= 0.0 && stats.values[mesh_stats::WORST_CELL] >= 0.0);
    let fault = rig.mover.stuck().expect("says why").clone();
    assert!(fault.message.contains("cell ") && fault.message.contains("nearest canopy node"), "{fault}");
    assert_eq!(positions(&rig.output), before.grid, "the grid stays");
    assert!(rig.mover.accept(&window(1, 0)).is_err(), "nothing to accept where there is no answer");
    assert_eq!(*rig.mover.positions(), before);
    let stats = rig.advance(&window(1, 1), &good).unwrap();
    assert!(stats.values[mesh_stats::STUCK] == 0.0 && rig.mover.stuck().is_none());
}

#[test]
fn a_saved_state_goes_on_as_if_nothing_happened() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig();
    let path: Vec<Vec<f64>> = [0.2, 0.5, 0.4].iter().map(|&t| rig.displacement(t)).collect();
    for index in 0..2 {
        rig.advance(&window(index, 0), &path[index as usize]).unwrap();
        rig.mover.accept(&window(index, 0)).unwrap();
    }
    rig.mover.save(folder.path()).unwrap();
    rig.advance(&window(2, 0), &path[2]).unwrap();
    let state = State::load(&case::state_file(folder.path(), Role::Mesh), rig.grid.coords.len()).unwrap();
    assert!(state.reference.is_empty(), "the reference is the start grid");
    let mut again = Rig::new(&Comm::solo(), &MeshMotion::default(), Some(state));
    assert_eq!(rig.mover.positions(), again.mover.positions());
    again.advance(&window(2, 0), &path[2]).unwrap();
    for (i, (a, b)) in rig.output.iter().zip(&again.output).enumerate() {
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

/// Windows of other lengths than the one before: velocities are those of a parabola through the last three positions, also
/// after a window was repeated with another length and after the mover was started from its saved state.
#[test]
fn velocities_are_of_second_order_over_unequal_windows() {
    let folder = tempfile::tempdir().unwrap();
    let mut rig = rig();
    let nodes = rig.grid.coords.len();
    // Quadratic in time: the canopy's velocities are exact.
    let way = |t: f64| 0.4 * t - 0.3 * t * t;
    let pace = |t: f64| 0.4 - 0.6 * t;
    let lengths = [0.25, 0.125, 0.25, 0.2, 0.05, 0.1];
    let (mut times, mut history) = (vec![0.0], vec![rig.grid.coords.as_flattened().to_vec()]);
    for (index, &dt) in lengths.iter().enumerate() {
        let begin = times[index];
        let window = |iteration, dt| Window { dt, time: begin, ..window(index as u64, iteration) };
        if index == 3 {
            // Rejected, and begun again.
            let d = rig.displacement(way(begin + 0.4));
            rig.advance(&window(0, 0.4), &d).unwrap();
        }
        let d = rig.displacement(way(begin + dt));
        rig.advance(&window(1, dt), &d).unwrap();
        let now = positions(&rig.output);
        times.push(begin + dt);
        if index > 0 {
            let t = [times[index + 1], times[index], times[index - 1]];
            let scale = rig.displacement(1.0);
            for (k, &a) in rig.grid.canopy_nodes.iter().enumerate() {
                for i in 0..3 {
                    let v = rig.output[6 * a as usize + 3 + i];
                    let exact = pace(t[0]) * scale[3 * k + i];
                    assert!((v - exact).abs() < 1e-13, "window {index}, canopy node {k}: {v} {exact}");
                }
            }
            for (j, row) in rig.output.as_chunks::<6>().0.iter().enumerate() {
                for i in 0..3 {
                    let n = 3 * j + i;
                    let v = slope(t, [now[n], history[index][n], history[index - 1][n]]);
                    // Rounding of positions of order one over the shortest window.
                    assert!((row[3 + i] - v).abs() < 1e-13, "window {index}, node {j}: {} {v}", row[3 + i]);
                }
            }
        }
        history.push(now);
        rig.mover.accept(&window(1, dt)).unwrap();
        if index == 4 {
            rig.mover.save(folder.path()).unwrap();
            let state = State::load(&case::state_file(folder.path(), Role::Mesh), nodes).unwrap();
            rig = Rig::new(&Comm::solo(), &MeshMotion::default(), Some(state));
        }
    }
}
