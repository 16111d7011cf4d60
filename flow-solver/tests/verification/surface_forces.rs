//! Forces on patches of the outer boundary: they balance the momentum that passes the grid, and are those of a canopy of
//! the same shape.

use std::collections::BTreeMap;

use crate::common::{isothermal, settings};
use case::{Condition, ForceCoefficients};
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::{self, Isothermal, Laminar};
use flow_solver::steady::March;
use flow_solver::topology::OpenSides;
use flow_solver::{ForceSum, Loads, Solver, Surfaces};
use mesh::{FlowGrid, Patch, block_grid, plate_grid};

type Flow = Solver<Isothermal, 4>;

fn entry(patches: &[&str]) -> ForceCoefficients {
    ForceCoefficients {
        name: "force".into(),
        patches: patches.iter().map(|p| (*p).to_owned()).collect(),
        drag_direction: None,
        lift_direction: None,
        moment_point_m: None,
        reference_area_m2: 1.0,
        reference_length_m: 1.0,
        reference_speed_m_s: None,
    }
}

/// A flow whose grid comes from a file with the patches of `grid`, of which only the names matter here.
fn flow_of(grid: &FlowGrid) -> case::Flow {
    let text = "name = \"f\"\n[canopy]\nkind = \"square\"\nwidth_m = 2.0\ncells_across = 6\n[fabric]\nyoungs_modulus_pa = 2e8\n\
                poisson_ratio = 0.3\nthickness_m = 3e-5\ndensity_kg_m3 = 1200.0\n[flow]\n[[stage]]\nname = \"a\"\n\
                kind = \"flow-only\"\nduration_s = 0.1\nwindow_s = 0.1\n";
    let scene = case::parse(std::path::Path::new("scene.toml"), text).expect("a scene");
    let mut flow = scene.flow.expect("a flow");
    let patches = grid.patch_names.iter().map(|n| (n.clone(), Condition::Wall)).collect::<BTreeMap<_, _>>();
    flow.grid_file = Some(case::GridFile {
        path: "grid.msh".into(),
        membrane: "canopy".into(),
        one_sided: None,
        patches,
        periodic: Vec::new(),
    });
    flow
}

fn force(s: &Flow, grid: &FlowGrid, patches: &[&str], point: Vec3) -> ForceSum {
    let mut loads = Loads::new(s);
    loads.compute(s);
    Surfaces::new(&entry(patches), &flow_of(grid), &grid.patch_names).force(s, &loads, point)
}

/// A steady flow of 3 m/s along x.
fn steady(grid: &FlowGrid) -> Flow {
    let mut settings = settings([3.0, 0.0, 0.0], 1e-2);
    settings.moving = false;
    let mut s = isothermal(grid, Laminar { viscosity: 0.05 }, settings);
    let march = March { residual_drop: 1e-9, force_change: 0.0, max_steps: 200, max_courant: 1e5 };
    let marched = march.run(&mut s, Vec3::zeros(), |_| Vec3::zeros()).expect("a steady flow");
    println!("{marched:?}");
    s
}

/// Momentum that leaves through the open sides per unit time, with the pressure on them, N.
fn leaving(s: &Flow) -> Vec3 {
    let (on, mut sum) = (s.domain(), Vec3::zeros());
    for OpenSides { patch, sides } in &s.topology.open {
        let condition = physics::open_boundary::<Isothermal, 4>(*patch).expect("air passes");
        for side in sides {
            let c = side.cell as usize;
            let d = s.metrics.border(side.face) - s.metrics.centre(c);
            let inside = flow_solver::gradient::extrapolated(&s.q[c], &s.gradient[c], &d);
            let previous = s.face_flux()[side.face as usize].previous;
            let at = on.boundary_face(&s.scheme, side);
            let f = condition.flux(&s.spatial.gas, &at, &inside, &s.q[c], previous).flux;
            sum += Vec3::new(f[1], f[2], f[3]) * side.sign;
        }
    }
    sum
}

const BOX: ([usize; 3], [f64; 3], [f64; 3]) = ([16, 10, 10], [-2.0, -1.5, -1.5], [4.0, 1.5, 1.5]);

/// A block off the middle of a wind tunnel with slip walls and a floor with friction.
fn tunnel() -> FlowGrid {
    let sides = [Patch::Inlet, Patch::Outlet, Patch::Slip, Patch::Slip, Patch::Wall, Patch::Slip];
    block_grid(BOX.0, BOX.1, BOX.2, sides, [5..7, 4..7, 2..5])
}

#[test]
fn forces_on_all_patches_balance_the_momentum_flux() {
    let grid = tunnel();
    let s = steady(&grid);
    let names = ["front", "back", "bottom", "top", "body"];
    let each = names.map(|n| force(&s, &grid, &[n], Vec3::zeros()));
    for (name, f) in names.iter().zip(&each) {
        println!("{name}: pressure {:.6?} N, shear {:.6?} N", f[0].as_slice(), f[1].as_slice());
    }
    let all = force(&s, &grid, &names, Vec3::zeros());
    let (walls, flux) = (all[0] + all[1], leaving(&s));
    println!("walls {:.9?} N, momentum flux {:.9?} N", walls.as_slice(), flux.as_slice());
    let body = (each[4][0] + each[4][1]).norm();
    // To the residual of the march, which is relative to its largest value.
    assert!((walls + flux).norm() < 1e-6 * body, "{walls:?} {flux:?}");
    // The parts add up, only no-slip walls have shear along them, and the drag is most of the force.
    let sum = each.iter().fold(Vec3::zeros(), |s, f| s + f[0] + f[1]);
    assert!((sum - walls).norm() < 1e-12 * walls.norm());
    assert!([0, 1, 3].iter().all(|&k| each[k][1][0] == 0.0) && each[2][1][0] > 0.0);
    assert!((each[4][0] + each[4][1])[0] > 0.9 * body);
}

#[test]
fn moment_about_a_shifted_point_differs_by_the_moment_of_the_force() {
    let grid = tunnel();
    let s = steady(&grid);
    let shift = Vec3::new(0.7, -1.3, 2.1);
    for names in [&["body"][..], &["bottom", "body"]] {
        let (here, there) = (force(&s, &grid, names, Vec3::zeros()), force(&s, &grid, names, shift));
        let expected = here[2] - shift.cross(&(here[0] + here[1]));
        assert!((there[2] - expected).norm() < 1e-13 * expected.norm(), "{there:?} {expected:?}");
        assert!((there[2] - here[2]).norm() > 0.1 * here[2].norm());
    }
}

/// The same plate of zero thickness as a canopy, and as two walls back to back with nodes of their own.
#[test]
fn force_on_wall_patches_is_that_on_a_canopy() {
    let sides = [Patch::Inlet, Patch::Outlet, Patch::Slip, Patch::Slip, Patch::Slip, Patch::Slip];
    let canopy = plate_grid(BOX.0, BOX.1, BOX.2, sides, 4, [5..9, 3..8]);
    let mut walls = canopy.clone();
    let rim = |x: &[f64; 3]| {
        let near = |x: f64, edge: f64| (x - edge).abs() < 1e-9;
        [5.0, 9.0].iter().any(|i| near(x[0], -2.0 + 0.375 * i))
            || [3.0, 8.0].iter().any(|j| near(x[1], -1.5 + 0.3 * j))
    };
    let mut copy: BTreeMap<u32, u32> = BTreeMap::new();
    for node in std::mem::take(&mut walls.canopy_nodes) {
        let x = walls.coords[node as usize];
        if !rim(&x) {
            copy.insert(node, walls.coords.len() as u32);
            walls.coords.push(x);
        }
    }
    let above = |v: u32| copy.get(&v).copied().unwrap_or(v);
    let height = -1.5 + 0.3 * 4.0;
    for cell in &mut walls.cells {
        let middle = cell.iter().map(|&v| walls.coords[v as usize][2]).sum::<f64>() / 8.0;
        if middle > height {
            *cell = cell.map(above);
        }
    }
    walls.boundary_patch = vec![flow_solver::topology::NO_PATCH; walls.boundary.len()];
    walls.patch_names = vec!["below".into(), "above".into()];
    for face in std::mem::take(&mut walls.canopy_faces) {
        let [a, b, c, d] = face.map(above);
        walls.boundary.extend([(Patch::Wall, face), (Patch::Wall, [d, c, b, a])]);
        walls.boundary_patch.extend([0, 1]);
    }
    let (as_canopy, as_walls) = (steady(&canopy), steady(&walls));
    let total = Loads::new(&as_canopy).compute(&as_canopy);
    let on_walls = force(&as_walls, &walls, &["below", "above"], Vec3::zeros());
    let on_canopy = force(&as_canopy, &canopy, &["canopy"], Vec3::zeros());
    println!("canopy {:?}, walls {on_walls:?}", total);
    assert!((on_canopy[0] + on_canopy[1] - total.force).norm() < 1e-13 * total.force.norm());
    assert!((on_canopy[2] - total.moment).norm() < 1e-13 * total.moment.norm());
    for k in 0..3 {
        assert!(
            (on_walls[k] - on_canopy[k]).norm() < 1e-6 * on_canopy[k].norm().max(1e-3),
            "{k}: {on_walls:?} {on_canopy:?}"
        );
    }
    assert!(total.force[0] > 0.01, "friction: {total:?}");
}
