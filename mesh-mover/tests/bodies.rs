//! Rigid bodies that move as prescribed, on one rank.

use case::{BodyMotion, BodyRotation, MeshMotion};
use channel::{Input, Participant, Window, mesh_stats};
use comm::Comm;
use mesh::{FlowGrid, Patch, StructureMesh, block_grid};
use mesh_mover::bodies::Bodies;
use mesh_mover::motion::Limits;
use mesh_mover::participant::{MeshMover, Setup, owners};

const DT: f64 = 0.05;

fn grid() -> FlowGrid {
    block_grid([8; 3], [-4.0; 3], [4.0; 3], [Patch::FarField; 6], [3..5, 3..5, 3..5])
}

fn motion() -> BodyMotion {
    let rotation =
        BodyRotation { axis: [0.0, 0.0, 1.0], point_m: [1.0, 0.0, 0.0], angle_rad: "0.8*t".into() };
    BodyMotion {
        patches: vec!["body".into()],
        displacement_m: Some(["t^2", "0", "-t"].map(String::from)),
        rotation: Some(rotation),
    }
}

fn mover(motion: &BodyMotion) -> MeshMover {
    let (settings, comm) = (MeshMotion::default(), Comm::solo());
    let grid = grid();
    let owner = owners(&grid, 1).unwrap();
    let bodies = Bodies::at_rest(std::slice::from_ref(motion), &grid).unwrap();
    let grid = bodies.add_to(grid);
    let setup = Setup {
        grid: &grid,
        structure: &StructureMesh::default(),
        owner: &owner,
        mover: mesh_mover::movers::mover(&settings),
        limits: Limits::from(&settings),
        state: None,
        outer: settings.outer_boundary,
        regridder: None,
        bodies,
    };
    MeshMover::on_grid(setup, &comm).unwrap()
}

fn window(index: u64, iteration: u64, time: f64, dt: f64) -> Window {
    Window { index, iteration, substeps: 1, time, dt, ..Window::default() }
}

fn advance(mover: &mut MeshMover, w: &Window) -> Vec<f64> {
    let mut output = vec![f64::NAN; 6 * mover.output_rows().len()];
    let stats = mover.advance(w, &Input { canopy: &[], grid: Default::default() }, &mut output).unwrap();
    assert_eq!(stats.values[mesh_stats::STUCK], 0.0);
    output
}

#[test]
fn body_is_where_its_motion_ends_and_the_outer_boundary_at_rest() {
    let (grid, motion) = (grid(), motion());
    let rigid = motion.compiled().unwrap();
    let mut mover = mover(&motion);
    let mut before: Vec<[f64; 3]> = grid.coords.clone();
    for index in 0..4 {
        let w = window(index, 0, index as f64 * DT, DT);
        let rows = advance(&mut mover, &w);
        let rows = rows.as_chunks::<6>().0;
        // The end of the window, not its start.
        let pose = rigid.at(w.time + DT);
        for n in grid.faces_of(&motion.patches).flat_map(|f| grid.boundary[f].1) {
            assert_eq!(rows[n as usize][..3], pose.apply(grid.coords[n as usize]));
        }
        for (_, face) in grid.boundary.iter().filter(|(patch, _)| *patch == Patch::FarField) {
            assert!(face.iter().all(|&n| rows[n as usize][..3] == grid.coords[n as usize]));
        }
        if index == 0 {
            let first = |n: usize, i: usize| (rows[n][i] - before[n][i]) / DT;
            assert!((0..rows.len()).all(|n| (0..3).all(|i| (rows[n][3 + i] - first(n, i)).abs() < 1e-12)));
        }
        before = rows.iter().map(|r| [r[0], r[1], r[2]]).collect();
        mover.accept(&w).unwrap();
    }
    let free = before.iter().zip(&grid.coords).filter(|(a, b)| a != b).count();
    assert!(free > 8 * 8, "the grid between follows: {free}");
}

/// A repeated window with half the length: body nodes to the bit. Within a window the nodes near the body follow it without a
/// new solve, so that others differ by some per cent of a cell of 1 m.
#[test]
fn rejected_window_leaves_no_trace() {
    let (motion, grid) = (motion(), grid());
    let (mut once, mut twice) = (mover(&motion), mover(&motion));
    let body: Vec<u32> = grid.faces_of(&motion.patches).flat_map(|f| grid.boundary[f].1).collect();
    for (index, time) in [(0, 0.0), (1, 0.5 * DT)] {
        let half = window(index, 1, time, 0.5 * DT);
        advance(&mut twice, &window(index, 0, time, DT));
        let [a, b] = [&mut once, &mut twice].map(|mover| {
            let rows = advance(mover, &half);
            mover.accept(&half).unwrap();
            rows
        });
        let (a, b) = (a.as_chunks::<6>().0, b.as_chunks::<6>().0);
        assert!(body.iter().all(|&n| a[n as usize] == b[n as usize]));
        let off = a.iter().zip(b).flat_map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).abs())).fold(0.0, f64::max);
        assert!(off < 0.05, "{off}");
    }
}

#[test]
fn motion_that_ends_to_be_finite_is_a_fault_with_its_time() {
    let mut motion = motion();
    motion.displacement_m = Some(["log(1 - 4*t) + 4*t", "0", "0"].map(String::from));
    let mut mover = mover(&motion);
    let mut output = vec![f64::NAN; 6 * mover.output_rows().len()];
    let input = Input { canopy: &[], grid: Default::default() };
    let error = mover.advance(&window(0, 0, 0.2, DT), &input, &mut output).unwrap_err().message;
    assert!(
        error.contains("the body \"body\" at t = 0.25 s") && error.contains("[[stage.body_motion]]"),
        "{error}"
    );
}
