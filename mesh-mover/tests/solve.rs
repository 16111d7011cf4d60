//! The pseudo-solid on small grids of mixed cells.

use comm::Comm;
use mesh::{BoxShape, FlowGrid, Patch};
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::example_grid::plate_in_box;
use mesh_mover::local::{Kind, LocalGrid};
use mesh_mover::mover::Mover;

fn solid(chi: f64, tolerance: f64) -> Solid {
    Solid {
        chi,
        shape_exponent: 3.0 * chi.min(1.0),
        distance_exponent: 2.0 * chi.min(1.0),
        poisson: 0.3,
        tolerance,
        max_iterations: 2000,
    }
}

/// All outer nodes become canopy nodes, so that any motion of the whole boundary can be prescribed.
fn driven_at_the_boundary(mut grid: FlowGrid) -> FlowGrid {
    let mut nodes: Vec<u32> = grid.boundary.iter().flat_map(|(_, f)| *f).chain(grid.canopy_nodes).collect();
    nodes.sort_unstable();
    nodes.dedup();
    grid.canopy_nodes = nodes;
    grid
}

/// Displaces the boundary by the affine map and returns the largest error inside.
fn affine_miss(grid: FlowGrid, solid: Solid, map: [[f64; 3]; 3], shift: [f64; 3]) -> f64 {
    let grid = driven_at_the_boundary(grid);
    let owner = vec![0; grid.coords.len()];
    let local = LocalGrid::new(&grid, &owner, &Comm::solo());
    let x = local.gather(&grid.coords);
    let mut mover = Elastic::new(solid);
    mover.rebase(&local, &x).unwrap();
    let move_of = |p: &[f64]| -> Vec<f64> {
        (0..3).map(|i| shift[i] + (0..3).map(|j| map[i][j] * p[j]).sum::<f64>()).collect()
    };
    let canopy: Vec<f64> =
        grid.canopy_nodes.iter().flat_map(|&a| move_of(&grid.coords[a as usize])).collect();
    let mut u = vec![0.0; 3 * local.free_node.len()];
    mover.displace(&local, &canopy, &mut u).unwrap();
    assert!(local.n_free > 20);
    let mut max_error = 0.0f64;
    for (&a, u) in local.free_node.iter().zip(u.chunks(3)) {
        let want = move_of(&x[3 * a as usize..][..3]);
        for i in 0..3 {
            max_error = max_error.max((u[i] - want[i]).abs());
        }
    }
    max_error
}

const SHEAR: [[f64; 3]; 3] = [[0.1, 0.3, -0.2], [0.05, -0.2, 0.4], [0.0, 0.1, 0.3]];

/// The matrix is assembled in single precision: five to six digits of the displacement are exact.
const SINGLE: f64 = 4e-6;

#[test]
fn patch_test_on_distorted_mixed_cells() {
    let max_error = affine_miss(plate_in_box(6, 0.2, 0.8, true), solid(0.0, 1e-9), SHEAR, [0.1, 0.2, 0.3]);
    assert!(max_error < SINGLE, "{max_error}");
    let box_of = |shape| mesh::box_grid_of(shape, [5; 3], [-1.0; 3], [1.0; 3], [Patch::Wall; 6]);
    for shape in [BoxShape::Prisms, BoxShape::Pyramids, BoxShape::Tetrahedra] {
        let max_error = affine_miss(box_of(shape), solid(0.0, 1e-9), SHEAR, [0.1, 0.2, 0.3]);
        assert!(max_error < SINGLE, "{shape:?}: {max_error}");
    }
}

#[test]
fn rigid_motion_of_the_boundary_is_rigid_inside() {
    let grid = || plate_in_box(6, 0.2, 0.7, true);
    // With stiffening: translation and infinitesimal rotation.
    let spin = [[0.0, -0.3, 0.2], [0.3, 0.0, -0.5], [-0.2, 0.5, 0.0]];
    for chi in [0.5, 1.0, 2.0] {
        let max_error = affine_miss(grid(), solid(chi, 1e-9), [[0.0; 3]; 3], [1.0, -2.0, 3.0]);
        // Stiffnesses differ by up to seven digits here, and the motion is 3.7 long.
        assert!(max_error < 10.0 * SINGLE, "translation, chi {chi}: {max_error}");
        let max_error = affine_miss(grid(), solid(chi, 1e-9), spin, [0.0; 3]);
        assert!(max_error < SINGLE, "rotation, chi {chi}: {max_error}");
    }
    // Without stiffening: any rotation, since every affine motion is in equilibrium.
    let (s, c) = 1.2f64.sin_cos();
    let rotate = [[c - 1.0, -s, 0.0], [s, c - 1.0, 0.0], [0.0, 0.0, 0.0]];
    let max_error = affine_miss(grid(), solid(0.0, 1e-9), rotate, [0.0; 3]);
    assert!(max_error < SINGLE, "{max_error}");
}

#[test]
fn zero_motion_is_exact_also_after_other_motions() {
    let grid = plate_in_box(8, 0.2, 0.7, true);
    let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &Comm::solo());
    let x = local.gather(&grid.coords);
    let mut mover = Elastic::new(solid(1.0, 1e-3));
    mover.rebase(&local, &x).unwrap();
    let mut u = vec![1.0; 3 * local.free_node.len()];
    for step in 0..200 {
        let s = 0.1 * (step as f64 * 0.7).sin();
        let canopy: Vec<f64> = grid
            .canopy_nodes
            .iter()
            .flat_map(|&a| {
                let p = grid.coords[a as usize];
                [s * p[1], 0.3 * s, s * (1.0 - 2.0 * p[0] * p[0])]
            })
            .collect();
        mover.displace(&local, &canopy, &mut u).unwrap();
    }
    mover.displace(&local, &vec![0.0; 3 * local.n_canopy], &mut u).unwrap();
    assert!(u.iter().all(|&v| v == 0.0), "bitwise the start grid");
}

#[test]
fn one_linear_solve_handles_motions_of_several_cell_layers() {
    let grid = plate_in_box(12, 0.1, 0.7, false);
    let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &Comm::solo());
    let x0 = local.gather(&grid.coords);
    let mut mover = Elastic::new(solid(1.0, 1e-3));
    mover.rebase(&local, &x0).unwrap();
    let mut u = vec![0.0; 3 * local.free_node.len()];
    let (s, c) = 0.35f64.sin_cos();
    type Move = fn([f64; 3], f64, f64) -> [f64; 3];
    let cases: [(&str, Move, f64); 4] = [
        // The cells at the plate are 0.17 wide and 0.06 thick.
        ("lifted by 0.2", |_, _, _| [0.0, 0.0, 0.2], 0.2),
        ("shifted by 0.2", |_, _, _| [0.2, 0.0, 0.0], 0.2),
        ("rotated by 0.35 rad", |p, s, c| [c * p[0] - p[0], 0.0, s * p[0]], 0.15),
        ("compressed by 0.4", |p, _, _| [-0.4 * p[0], -0.4 * p[1], 0.0], 0.15),
    ];
    for (name, motion, least) in cases {
        let canopy: Vec<f64> =
            grid.canopy_nodes.iter().flat_map(|&a| motion(grid.coords[a as usize], s, c)).collect();
        let effort = mover.displace(&local, &canopy, &mut u).unwrap();
        let mut x = x0.clone();
        for (&a, u) in local.free_node.iter().zip(u.chunks(3)) {
            (0..3).for_each(|i| x[3 * a as usize + i] += u[i]);
        }
        for (a, kind) in local.kind.iter().enumerate() {
            if let Kind::Canopy(k) = kind {
                (0..3).for_each(|i| x[3 * a + i] += canopy[3 * *k as usize + i]);
            }
        }
        let (cell, q) = local.worst(&x).unwrap();
        println!("{name}: worst cell {cell} {q:.3} ({} iterations)", effort.iterations);
        assert!(q > least, "{name}: cell {cell} has quality {q}");
    }
}

#[test]
fn inverted_start_grid_is_named() {
    let mut grid = plate_in_box(4, 0.0, 1.0, false);
    let inside = grid.coords.iter().position(|p| p[0] == 0.0 && p[1] == 0.0 && p[2] == 0.5).unwrap();
    grid.coords[inside][0] += 1.0;
    let local = LocalGrid::new(&grid, &vec![0; grid.coords.len()], &Comm::solo());
    let error = Elastic::new(solid(1.0, 1e-3)).rebase(&local, &local.gather(&grid.coords)).unwrap_err();
    assert!(error.to_string().contains("is inverted"), "{error}");
}
