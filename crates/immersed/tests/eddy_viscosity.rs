//! Eddy viscosity of algebraic models: closed forms, and what holds next to a surface.

use immersed::axis::Axis;
use immersed::cut_faces::CutFaces;
use immersed::eddy_viscosity::SubgridModel;
use immersed::flow::{Flow, Settings};
use immersed::free_edges::EdgeFluxes;
use immersed::friction::Friction;
use immersed::grid::{End, Ends, Grid};
use immersed::momentum::Momentum;
use immersed::shapes;
use nalgebra::{Matrix3, Rotation3, Vector3};

const SLIP: Ends = Ends::Open([End::Slip, End::Slip]);
const BOTH: [SubgridModel; 2] = [SubgridModel::Smagorinsky, SubgridModel::Wale];

fn flow(grid: Grid, far: Vector3<f64>, viscosity: f64, model: SubgridModel) -> Flow {
    let momentum = Momentum { upwind_share: 0.0, viscosity };
    let mut flow = Flow::new(grid, Settings { density: 1.2, far, momentum, tolerance: 1e-10 });
    flow.set_subgrid_model(Some(model));
    flow
}

/// The law of Nicoud and Ducros (1999), equations 10 and 13, by strain and rotation instead of the squared gradient.
fn wale(g: &Matrix3<f64>) -> f64 {
    let (s, o) = ((g + g.transpose()) * 0.5, (g - g.transpose()) * 0.5);
    let (ss, oo) = (s.norm_squared(), o.norm_squared());
    let both = (s * s * o * o).trace();
    let d = (ss * ss + oo * oo) / 6.0 + 2.0 / 3.0 * ss * oo + 2.0 * both;
    0.55 * 0.55 * d.powf(1.5) / (ss.powf(2.5) + d.powf(1.25))
}

fn smagorinsky(g: &Matrix3<f64>) -> f64 {
    0.17 * 0.17 * (g + g.transpose()).norm() / f64::sqrt(2.0)
}

/// Eddy viscosity of a flow with the gradient `g` (derivative of component c along d at (c, d)) in the inner cells of a stretched grid, over the closed form's
/// rate `expected` times the square of the filter width: smallest and largest ratio; or the values where that is zero.
fn ratios(g: Matrix3<f64>, model: SubgridModel, expected: f64) -> [f64; 2] {
    let axis = |h: f64| Axis::stretched([-0.3, 0.3], h, [0.5, 0.7], 1.25, 2);
    let grid = Grid::new([axis(0.1), axis(0.12), axis(0.09)], [SLIP; 3]);
    let mut flow = flow(grid, Vector3::zeros(), 0.0, model);
    flow.set_velocity(|x| g * x + Vector3::new(3.0, -2.0, 1.0));
    flow.largest_eddy_rate(None);
    let [nx, ny, nz] = flow.grid.cells();
    let mut ends = [f64::MAX, f64::MIN];
    for (n, value) in flow.eddy_viscosities().into_iter().enumerate() {
        let cell = [n % nx, n / nx % ny, n / (nx * ny)];
        if cell.iter().zip([nx, ny, nz]).any(|(i, n)| *i == 0 || i + 1 == n) {
            continue;
        }
        let volume: f64 = (0..3).map(|d| flow.grid.axes[d].widths[cell[d]]).product();
        let scale = if expected > 0.0 { volume.powf(2.0 / 3.0) * expected } else { 1.0 };
        ends = [ends[0].min(value / scale), ends[1].max(value / scale)];
    }
    ends
}

/// Gradients without divergence: stretch and turning about all axes; three plane shears; a rigid rotation.
#[test]
fn eddy_viscosity_is_the_closed_form_of_the_gradient() {
    let full = Matrix3::new(2.0, -1.0, 0.5, 3.0, -0.7, 1.5, -0.4, 0.9, -1.3);
    let turn = Vector3::new(1.0, -2.0, 0.5).cross_matrix();
    let stretch = Matrix3::from_diagonal(&Vector3::new(1.0, 1.5, -2.5));
    for g in [full, full.transpose(), stretch, turn + stretch * 0.1] {
        for (model, rate) in [(SubgridModel::Wale, wale(&g)), (SubgridModel::Smagorinsky, smagorinsky(&g))] {
            let found = ratios(g, model, rate);
            assert!(found.iter().all(|r| (r - 1.0).abs() < 1e-12), "{model:?} {g}: {found:?}");
            let by_cell = model.rate(&[0, 1, 2].map(|c| [0, 1, 2].map(|d| g[(c, d)])));
            assert!((by_cell / rate - 1.0).abs() < 1e-13, "{model:?}: {by_cell} {rate}");
        }
    }
    for (c, d) in [(0, 1), (1, 0), (1, 2), (2, 1), (0, 2), (2, 0)] {
        let mut shear = Matrix3::zeros();
        shear[(c, d)] = 4.0;
        assert!(ratios(shear, SubgridModel::Wale, 0.0)[1] < 1e-12, "shear {c} {d}");
        let found = ratios(shear, SubgridModel::Smagorinsky, 0.17 * 0.17 * 4.0);
        assert!(found.iter().all(|r| (r - 1.0).abs() < 1e-12), "shear {c} {d}: {found:?}");
    }
    // No strain: nothing of Smagorinsky, but S^d of WALE is that of the squared rotation, S^d:S^d = 2/3 omega^4.
    assert!(ratios(turn, SubgridModel::Smagorinsky, 0.0)[1] < 1e-12);
    let omega = Vector3::<f64>::new(1.0, -2.0, 0.5).norm();
    let found = ratios(turn, SubgridModel::Wale, 0.55 * 0.55 * (2.0f64 / 3.0).powf(0.25) * omega);
    assert!(found.iter().all(|r| (r - 1.0).abs() < 1e-12), "rotation: {found:?}");
}

/// The limit of the step has the largest eddy viscosity over the squared widths of its cell.
#[test]
fn largest_rate_is_that_of_the_cell() {
    let axes = [20, 10, 8].map(|n| Axis::even(-1.0, 1.0, n));
    let grid = Grid::new(axes, [Ends::Periodic, SLIP, SLIP]);
    let mut flow = flow(grid, Vector3::zeros(), 0.0, SubgridModel::Smagorinsky);
    assert_eq!(flow.largest_eddy_rate(None), 0.0);
    flow.set_velocity(|x| Vector3::new(x.y, 0.0, 0.0) * 3.0);
    let filter = (0.1f64 * 0.2 * 0.25).powf(2.0 / 3.0);
    let exact = 4.0 * 0.17 * 0.17 * filter * 3.0 * (100.0 + 25.0 + 16.0);
    let found = flow.largest_eddy_rate(None);
    assert!((found / exact - 1.0).abs() < 1e-12, "{found} {exact}");
    flow.set_subgrid_model(None);
    assert_eq!((flow.largest_eddy_rate(None), flow.subgrid_model()), (0.0, None));
}

/// A cube with edges of `size` m.
fn cube(size: f64, turn: Rotation3<f64>) -> (Vec<Vector3<f64>>, Vec<[u32; 3]>) {
    let corner = |i: usize| Vector3::from_fn(|d, _| if i >> d & 1 == 1 { 0.5 } else { -0.5 }) * size;
    let sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let faces = sides.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    ((0..8).map(|i| turn * corner(i)).collect(), faces)
}

/// The velocity jumps across a closed surface and is uniform on both sides, so that neither side has any strain: no eddy viscosity, and no stress of it, at any angle to
/// the grid. Without the surface the jump would be strain.
#[test]
fn jump_across_a_surface_is_no_strain() {
    let size = 0.97;
    for angles in [[0.0; 3], [0.3, 0.5, 0.2], [0.78, 0.6, -0.4]] {
        let turn = Rotation3::from_euler_angles(angles[0], angles[1], angles[2]);
        let (nodes, faces) = cube(size, turn);
        let axis = || Axis::even(-1.5, 1.5, 30);
        for model in BOTH {
            let grid = Grid::new([axis(), axis(), axis()], [SLIP; 3]);
            let mut flow = flow(grid, Vector3::zeros(), 0.01, model);
            let (inside, outside) = (Vector3::new(1.0, -0.5, 0.7), Vector3::zeros());
            flow.set_velocity(|x| if (turn.inverse() * x).amax() < 0.5 * size { inside } else { outside });
            let friction = Friction::new(&flow.grid, &nodes, &faces).expect("inside");
            let across = flow.largest_eddy_rate(None);
            let found = flow.largest_eddy_rate(Some(&friction));
            assert!(found == 0.0 && across > 1.0, "{model:?} {angles:?}: {found:e}, {across}");
        }
    }
}

/// A stream in which a surface drifts along keeps its velocity to round-off, on a grid that moves at another one.
#[test]
fn free_stream_is_kept() {
    let stream = Vector3::new(3.0, -2.0, 5.0);
    let axis = || Axis::stretched([-1.0, 1.0], 0.125, [3.0, 4.0], 1.2, 2);
    let open = Ends::Open([End::Inflow, End::Outflow]);
    let frame = Vector3::new(2.5, -2.0, 4.5);
    let (start, faces) = shapes::sphere(0.4, 2);
    for model in BOTH {
        let grid = Grid::new([axis(), axis(), axis()], [open, SLIP, open]);
        let mut flow = flow(grid, stream, 0.01, model);
        for k in 1..=5 {
            let nodes: Vec<_> = start.iter().map(|x| x + (stream - frame) * (0.02 * f64::from(k))).collect();
            let mut cut = CutFaces::new(&flow.grid, &nodes, &faces, 0.0).expect("inside");
            cut.set_velocities(&faces, &vec![stream; nodes.len()]);
            let mut friction = Friction::new(&flow.grid, &nodes, &faces).expect("inside");
            friction.set_velocities(&faces, &vec![stream; nodes.len()]);
            flow.predict_around(0.02, frame, &EdgeFluxes::default(), Some(&mut friction));
            let jumps = flow.solve_constraints(&cut.rows);
            flow.accept(&cut.rows, &jumps);
            let error = (0..3)
                .flat_map(|c| flow.velocity[c].iter().map(move |u| (u - stream[c]).abs()))
                .fold(0.0, f64::max);
            assert!(error < 1e-12, "{model:?} {k}: {error:e}");
        }
    }
}

/// What the air loses a turning plate gets, to round-off, in a box that is periodic along x and y.
#[test]
fn momentum_is_conserved_around_a_plate() {
    let n = 24;
    let side = || Axis::even(-1.0, 1.0, n);
    let (plate, faces) = shapes::plate(10);
    for model in BOTH {
        let grid = Grid::new([side(), side(), side()], [Ends::Periodic, Ends::Periodic, SLIP]);
        let mut flow = flow(grid, Vector3::zeros(), 0.01, model);
        let momentum = |flow: &Flow, c: usize| -> f64 {
            let cells = (0..n).flat_map(|k| (0..n).flat_map(move |j| (0..n).map(move |i| [i, j, k])));
            let sum: f64 = cells.map(|cell| flow.velocity[c][flow.grid.at(cell.map(|i| i as isize))]).sum();
            sum * 1.2 * (2.0f64 / n as f64).powi(3)
        };
        let dt = 0.02;
        for k in 0..8 {
            let turn = Rotation3::from_euler_angles(0.3, 0.5 + 0.05 * f64::from(k), 0.2);
            let nodes: Vec<_> = plate.iter().map(|x| turn * x).collect();
            let velocity =
                |x: &Vector3<f64>| Vector3::new(0.3, 0.1, 0.8) + Vector3::new(0.0, 2.5, 0.0).cross(x);
            let velocities: Vec<_> = nodes.iter().map(velocity).collect();
            let mut cut = CutFaces::new(&flow.grid, &nodes, &faces, 0.0).expect("inside");
            cut.set_velocities(&faces, &velocities);
            let mut friction = Friction::new(&flow.grid, &nodes, &faces).expect("inside");
            friction.set_velocities(&faces, &velocities);
            let before = [0, 1].map(|c| momentum(&flow, c));
            flow.predict_around(dt, Vector3::zeros(), &EdgeFluxes::default(), Some(&mut friction));
            let jumps = flow.solve_constraints(&cut.rows);
            flow.accept(&cut.rows, &jumps);
            let mut forces = vec![Vector3::zeros(); nodes.len()];
            friction.add_node_forces(&faces, &mut forces);
            cut.add_forces(&faces, &jumps.jump, &mut forces);
            let total: Vector3<f64> = forces.iter().sum();
            for c in 0..2 {
                let error = momentum(&flow, c) - before[c] + dt * total[c];
                assert!(error.abs() < 1e-12 && total[c].abs() > 1e-3, "{model:?} {k} {c}: {error:e}");
            }
        }
        assert!(flow.largest_eddy_rate(None) > 0.01);
    }
}

/// Of a velocity that differs from face to face the strain has the squares of all twelve edges of a cell, each once: waves of few cells are seen in full.
#[test]
fn strain_has_every_edge_of_a_cell_once() {
    let axis = |n: usize| Axis::stretched([-0.3, 0.3], 0.6 / n as f64, [0.3, 0.4], 1.2, 2);
    let grid = Grid::new([axis(4), axis(5), axis(6)], [SLIP; 3]);
    let mut flow = flow(grid, Vector3::zeros(), 0.0, SubgridModel::Smagorinsky);
    flow.set_velocity(|x| {
        Vector3::new(9.0 * x.y - 71.0 * x.z, 83.0 * x.x + 57.0 * x.z, 91.0 * x.y * x.x).map(f64::sin)
    });
    flow.largest_eddy_rate(None);
    let [nx, ny, _] = flow.grid.cells();
    let found = flow.eddy_viscosities();
    for cell in [[3usize, 3, 3], [4, 2, 5], [2, 5, 4]] {
        let at = flow.grid.at(cell.map(|i| i as isize));
        let s = flow.grid.strides;
        let slope = |c: usize, d: usize, upper: usize, face: usize| {
            (flow.velocity[c][upper] - flow.velocity[c][upper - s[d]]) / flow.grid.centre_distance(d, face)
        };
        let mut squares = 0.0;
        for c in 0..3 {
            let w = flow.grid.axes[c].widths[cell[c]];
            squares += ((flow.velocity[c][at + s[c]] - flow.velocity[c][at]) / w).powi(2);
            let d = (c + 1) % 3;
            for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let upper = at + i * s[c] + j * s[d];
                let shear = slope(c, d, upper, cell[d] + j) + slope(d, c, upper, cell[c] + i);
                squares += 0.5 * 0.25 * shear * shear;
            }
        }
        let volume: f64 = (0..3).map(|d| flow.grid.axes[d].widths[cell[d]]).product();
        let exact = 0.17 * 0.17 * volume.powf(2.0 / 3.0) * (2.0 * squares).sqrt();
        let value = found[(cell[2] * ny + cell[1]) * nx + cell[0]];
        assert!((value / exact - 1.0).abs() < 1e-12, "{cell:?}: {value} {exact}");
    }
}
