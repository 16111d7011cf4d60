//! Outer nodes that slide in their plane.

use std::collections::BTreeMap;

use case::OuterBoundary::{Fixed, Sliding};
use comm::Comm;
use mesh::{FlowGrid, HEX_FACES, Patch};
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::example_grid::plate_in_box;
use mesh_mover::local::LocalGrid;
use mesh_mover::mover::Mover;
use mesh_mover::quality::volume;

/// Uniform elasticity, so that half a solid is equivalent to the whole by symmetry.
fn plain(tolerance: f64) -> Solid {
    Solid {
        chi: 0.0,
        shape_exponent: 0.0,
        distance_exponent: 0.0,
        poisson: 0.3,
        tolerance,
        max_iterations: 2000,
    }
}

/// Node positions when the plate moves by `motion`; and the worst scaled Jacobian.
fn moved(
    grid: &FlowGrid,
    outer: case::OuterBoundary,
    solid: Solid,
    motion: impl Fn([f64; 3]) -> [f64; 3],
) -> (Vec<[f64; 3]>, f64, f64) {
    let local = LocalGrid::with_outer(grid, &vec![0; grid.coords.len()], outer, &Comm::solo());
    let mut x = local.gather(&grid.coords);
    let mut mover = Elastic::new(solid);
    mover.rebase(&local, &x).unwrap();
    let canopy: Vec<f64> = grid.canopy_nodes.iter().flat_map(|&a| motion(grid.coords[a as usize])).collect();
    let mut u = vec![0.0; 3 * local.free_node.len()];
    mover.displace(&local, &canopy, &mut u).unwrap();
    for (&a, u) in local.free_node.iter().zip(u.as_chunks::<3>().0) {
        (0..3).for_each(|i| x[3 * a as usize + i] += u[i]);
    }
    for (&a, d) in grid.canopy_nodes.iter().zip(canopy.as_chunks::<3>().0) {
        (0..3).for_each(|i| x[3 * a as usize + i] += d[i]);
    }
    let solve_from_reference = (0..local.cells.len()).map(|c| volume(&local.corners(c, &x))).sum();
    let worst = local.worst(&x).expect("there are cells").1;
    (x.as_chunks::<3>().0.to_vec(), worst, solve_from_reference)
}

#[test]
fn walls_stay_planes_and_the_volume_of_the_box_is_conserved() {
    let grid = plate_in_box(12, 0.1, 0.8, true);
    let motion = |p: [f64; 3]| [0.1, 0.05 * p[0], 0.08];
    let solid = Solid::from(&case::MeshMotion::default());
    let (x, sliding, solve_from_reference) = moved(&grid, Sliding, solid, motion);
    let (_, fixed, _) = moved(&grid, Fixed, solid, motion);
    let mut largest_slide = 0.0f64;
    for &a in grid.boundary.iter().flat_map(|(_, f)| f) {
        let (now, start) = (x[a as usize], grid.coords[a as usize]);
        for i in 0..3 {
            if start[i].abs() == 1.0 {
                assert_eq!(now[i], start[i], "bitwise in the plane");
            }
            largest_slide = largest_slide.max((now[i] - start[i]).abs());
        }
    }
    assert!(largest_slide > 1e-3, "nodes slide: {largest_slide}");
    assert!((solve_from_reference - 8.0).abs() < 1e-12, "{solve_from_reference}");
    assert!(sliding > fixed, "cells have more room: {sliding} for {fixed}");
}

/// The half at x > 0, cut at x = 0: the plane of symmetry becomes an outer boundary.
fn half(grid: &FlowGrid) -> FlowGrid {
    let at = |a: &u32| grid.coords[*a as usize];
    let cells: Vec<[u32; 8]> =
        grid.cells.iter().filter(|c| c.iter().map(|a| at(a)[0]).sum::<f64>() > 0.0).copied().collect();
    let side = |f: &[u32; 4]| f.iter().map(|a| at(a)[0]).sum::<f64>() > 1e-9;
    let mut half = FlowGrid { coords: grid.coords.clone(), cells, ..FlowGrid::default() };
    half.canopy_nodes = grid.canopy_nodes.iter().filter(|a| at(a)[0] > -1e-9).copied().collect();
    half.canopy_faces = grid.canopy_faces.iter().filter(|f| side(f)).copied().collect();
    half.boundary = grid.boundary.iter().filter(|(_, f)| side(f)).copied().collect();
    for cell in &half.cells {
        for face in HEX_FACES.map(|f| f.map(|i| cell[i])) {
            if face.iter().all(|a| at(a)[0].abs() < 1e-9) {
                half.boundary.push((Patch::Symmetry, face));
            }
        }
    }
    half
}

#[test]
fn symmetry_plane_is_equivalent_to_a_sliding_wall() {
    let whole = plate_in_box(8, 0.0, 0.8, false);
    let mut half = half(&whole);
    assert_eq!(2 * half.cells.len(), whole.cells.len());
    // The other walls are fixed, as in the whole box: a curved face fixes its nodes.
    let mut kept: BTreeMap<u32, u32> = BTreeMap::new();
    let walls: Vec<[u32; 4]> =
        half.boundary.iter().filter(|(p, _)| *p == Patch::FarField).map(|(_, f)| *f).collect();
    walls.iter().flatten().for_each(|&a| *kept.entry(a).or_default() += 1);
    // Symmetric about x = 0.
    let motion = |p: [f64; 3]| [0.2 * p[0], 0.05, 0.1 * (1.0 - p[0] * p[0])];
    let tolerance = 1e-8;
    let (x, ..) = moved(&whole, Fixed, plain(tolerance), motion);
    // The walls of the half are perturbed slightly, so that their nodes are fixed.
    for (k, &a) in kept.keys().enumerate() {
        let p = &mut half.coords[a as usize];
        for x in p.iter_mut().filter(|x| x.abs() == 1.0) {
            *x *= 1.0 + 1e-6 * (12.9 * k as f64).sin();
        }
    }
    let (y, ..) = moved(&half, Sliding, plain(tolerance), motion);
    let (mut seen, mut in_plane) = (0, 0.0f64);
    for &a in half.cells.iter().flatten() {
        let (p, q) = (x[a as usize], y[a as usize]);
        let max_difference = (0..3).map(|i| (p[i] - q[i]).abs()).fold(0.0, f64::max);
        // The perturbation, and the matrix in single precision.
        assert!(max_difference < 1e-5, "{p:?} {q:?}");
        if whole.coords[a as usize][0].abs() < 1e-9 && !kept.contains_key(&a) {
            in_plane = in_plane.max((q[2] - whole.coords[a as usize][2]).abs());
            seen += 1;
        }
    }
    assert!(seen > 0 && in_plane > 0.05, "{seen} {in_plane}");
}
