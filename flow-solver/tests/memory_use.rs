//! Steps of the flow take no arrays. One test, because it counts the allocations of the process.

use std::f64::consts::PI;
use std::sync::atomic::Ordering::Relaxed;

use flow_solver::Step;
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::Laminar;
use mesh::{BoxShape, Patch, box_grid_of};

mod common;
#[path = "../../tests/src/counted.rs"]
mod counted;

use counted::{COUNT, LEAST};

/// Cells along a side of the grid.
const SIDE: usize = 20;
/// Bytes of one number for each of the cells: what an array in a step would take at least.
const ARRAY: usize = 8 * SIDE * SIDE * SIDE / 2;

/// Windows of two flow solves each on a grid that moves: after the first ones no array is taken. (Only solves of more than twelve iterations take some, for more
/// columns of their combination.)
#[test]
fn steps_take_no_arrays() {
    LEAST.store(ARRAY, Relaxed);
    let mut patches = [Patch::FarField; 6];
    patches[5] = Patch::Slip;
    let grid = box_grid_of(BoxShape::Hexahedra, [SIDE; 3], [0.0; 3], [1.0; 3], patches);
    let air = Laminar { viscosity: 0.02 };
    let mut s = common::isothermal(&grid, air, common::settings([3.0, -2.0, 4.0], 1e-2));
    let start = s.nodes.clone();
    let (dt, mut iterations) = (4e-3, 0);
    for window in 0..8 {
        if window == 4 {
            COUNT.store(0, Relaxed);
        }
        for (k, repeat) in [false, true].into_iter().enumerate() {
            let by = 1e-3 * (window as f64 + 0.1 * k as f64);
            for (x, x0) in s.nodes.iter_mut().zip(&start) {
                x.z = x0.z + by * (PI * x0.x).sin() * (PI * x0.y).sin();
            }
            let step = Step { dt, frame: Vec3::zeros(), repeat, moved: true };
            iterations += s.advance(&step).expect("a flow").iterations;
        }
        s.accept(dt, true);
    }
    let arrays = COUNT.load(Relaxed);
    println!("{arrays} arrays in the last four windows, {iterations} iterations in eight");
    assert!(iterations > 32);
    assert_eq!(arrays, 0);
}
