//! What is wrong is named, and nothing that is not a number leaves the solver.

use crate::common::{isothermal, settings};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::Inviscid;
use flow_solver::{FlowError, Step, state};
use mesh::{Patch, box_grid};

fn small() -> flow_solver::Solver<flow_solver::physics::Isothermal, 4> {
    let grid = box_grid([3, 3, 3], [0.0; 3], [1.0; 3], [Patch::FarField; 6]);
    isothermal(&grid, Inviscid, settings([1.0, 0.0, 0.0], 1e-3))
}

const MOVED: Step = Step { dt: 0.01, frame: Vec3::new(0.0, 0.0, 0.0), repeat: false, moved: true };

#[test]
fn nonfinite_node_position_is_reported() {
    let mut s = small();
    let n = s.topology.node_global.iter().position(|&g| g == 21).unwrap();
    s.nodes[n][1] = f64::NAN;
    assert_eq!(s.advance(&MOVED).unwrap_err(), FlowError::BadNode { node: 21, rank: 0 });
    let mut s = small();
    s.node_velocity[n][0] = f64::INFINITY;
    assert!(matches!(s.advance(&MOVED), Err(FlowError::BadNode { node: 21, .. })));
}

#[test]
fn inverted_cell_is_reported() {
    let mut s = small();
    for (x, g) in s.nodes.iter_mut().zip(&s.topology.node_global) {
        // The middle cell (13) has its lower z-face above its upper one.
        if [21, 22, 25, 26].contains(g) {
            x[2] += 0.5;
        }
    }
    match s.advance(&MOVED).unwrap_err() {
        FlowError::InvertedCell { cell, volume, .. } => {
            assert_eq!(cell, 13);
            assert!(volume < 0.0);
        }
        other => panic!("{other}"),
    }
}

#[test]
fn damaged_or_mismatched_state_is_rejected() {
    let s = small();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("flow.bin");
    let totals = (27, 64);
    s.save(&file, totals).unwrap();
    let back = state::load::<4>(&file, &s.topology, totals).unwrap();
    assert_eq!(back.previous[0].q, s.previous[0].q);
    assert_eq!(back.previous[1].nodes, s.previous[1].nodes);
    let refused = |text: &str, r: Result<state::Restored<4>, channel::Fault>| {
        let message = r.err().expect("refused").message;
        assert!(message.contains(text), "{message}");
    };
    refused("28 and 64", state::load::<4>(&file, &s.topology, (28, 64)));
    // A stage with energy equation starts from the undisturbed temperature.
    let five = state::load::<5>(&file, &s.topology, totals).unwrap();
    for (five, four) in five.previous[0].q.iter().zip(&s.previous[0].q) {
        assert_eq!((&five[..4], five[4]), (&four[..], 0.0));
    }
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&file, &bytes).unwrap();
    refused("checksum", state::load::<4>(&file, &s.topology, totals));
    std::fs::remove_file(&file).unwrap();
    refused("flow.bin", state::load::<4>(&file, &s.topology, totals));
}
