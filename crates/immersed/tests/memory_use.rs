//! Memory of a flow over windows of several steps. One test, because it measures the memory of the process.

use std::sync::atomic::Ordering::Relaxed;

use immersed::axis::Axis;
use immersed::constraints::FluxConstraints;
use immersed::cut_faces::CutFaces;
use immersed::flow::{Flow, PressureJumps, Settings};
use immersed::free_edges::EdgeFluxes;
use immersed::friction::Friction;
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes;
use nalgebra::Vector3;

#[path = "../../../tests/src/counted.rs"]
mod counted;

use counted::{COUNT, LEAST, MOST, USED};

/// Bytes of ten planes of the grid of the test.
const LARGE: usize = 10 * 8 * 40 * 40;

/// A window of `steps` steps, solved three times.
fn window(flow: &mut Flow, cut: &CutFaces, friction: &mut Friction, steps: usize) {
    let mut rows = FluxConstraints::new(&flow.grid);
    let (mut fluxes, mut jumps) = (Vec::new(), PressureJumps::default());
    for step in 0..steps {
        flow.predict_around(0.01, Vector3::zeros(), &EdgeFluxes::default(), Some(friction));
        fluxes.push(flow.predicted_fluxes(&cut.rows));
        rows.append(&cut.rows);
        if step + 1 < steps {
            jumps = flow.solve_constraints_from(&cut.rows, &fluxes[step], None);
            match step {
                0 => flow.accept_and_keep(&cut.rows, &jumps),
                _ => flow.accept(&cut.rows, &jumps),
            }
        }
    }
    let changes = vec![0.1; rows.len()];
    for _ in 0..3 {
        for fluxes in &fluxes {
            let earlier = flow.flux_changes(&rows, &changes);
            jumps = flow.solve_constraints_from(&cut.rows, &fluxes.clone().changed_by(&earlier), None);
        }
    }
    flow.accept_after(&cut.rows, &jumps, (steps > 1).then_some((&rows, &changes[..])));
    flow.release_kept();
}

/// Velocities and rates, three arrays each: at the start and of the step before, of the step that is kept, and of later steps. Pressure and pivots have
/// no ghosts, and neither has the pressure of the last of several steps. After the first windows steps allocate small arrays only.
#[test]
fn windows_of_several_steps_need_eighteen_arrays() {
    LEAST.store(LARGE, Relaxed);
    for (steps, arrays) in [(1, 12), (2, 15), (3, 18), (5, 18)] {
        let axis = |n: usize| Axis::even(-1.0, 1.0, n);
        let open = Ends::Open([End::Inflow, End::Outflow]);
        let grid = Grid::new([axis(40), axis(40), axis(44)], [open, open, open]);
        let momentum = Momentum { upwind_share: 0.5, viscosity: 0.01 };
        let far = Vector3::new(0.1, 0.0, 1.0);
        let settings = Settings { density: 1.2, far, momentum, tolerance: 1e-4 };
        let (nodes, faces) = shapes::plate(6);
        let cut = CutFaces::new(&grid, &nodes, &faces, 0.0).expect("inside");
        let mut friction = Friction::new(&grid, &nodes, &faces).expect("inside");
        // Products of matrices keep an array of the size of a cache.
        window(&mut Flow::new(grid.clone(), settings), &cut, &mut friction, 1);
        let before = USED.load(Relaxed);
        MOST.store(before, Relaxed);
        let mut flow = Flow::new(grid, settings);
        for _ in 0..2 {
            window(&mut flow, &cut, &mut friction, steps);
        }
        let allocated = COUNT.load(Relaxed);
        for _ in 0..3 {
            window(&mut flow, &cut, &mut friction, steps);
        }
        let large = COUNT.load(Relaxed) - allocated;
        let most = MOST.load(Relaxed) - before;
        let without_ghosts = if steps > 1 { 3 } else { 2 };
        // Rates of the values next to the plate, two for each segment at most: of the last step, and of the start of the window.
        let at_walls = 40 * 2 * friction.len();
        let needed = 8 * (arrays * flow.grid.array_len() + without_ghosts * flow.grid.count()) + at_walls;
        println!("{steps} steps: {most} bytes, arrays {needed}, {large} large allocations");
        assert!(most < needed + needed / 20, "{steps} steps: {most} bytes, arrays {needed}");
        assert_eq!(large, 0, "{steps} steps");
    }
}
