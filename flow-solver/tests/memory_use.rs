//! Steps of the flow take no arrays. One test, because it counts the allocations of the process.

use std::alloc::{GlobalAlloc, Layout, System as Allocator};
use std::f64::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use flow_solver::Step;
use flow_solver::geometry::vec3::Vec3;
use flow_solver::physics::Laminar;
use mesh::{BoxShape, Patch, box_grid_of};

mod common;

/// Cells along a side of the grid.
const SIDE: usize = 20;
/// Bytes of one number for each of the cells: what an array in a step would take at least.
const ARRAY: usize = 8 * SIDE * SIDE * SIDE / 2;

/// Counts the allocations of arrays.
struct Counted;

#[global_allocator]
static ALLOCATOR: Counted = Counted;
static ARRAYS: AtomicUsize = AtomicUsize::new(0);

fn count(size: usize) {
    ARRAYS.fetch_add(usize::from(size >= ARRAY), Relaxed);
}

// SAFETY: forwards all calls to the system's allocator.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promised.
        unsafe { Allocator.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promised.
        unsafe { Allocator.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        // SAFETY: as the caller promised.
        unsafe { Allocator.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as the caller promised.
        unsafe { Allocator.dealloc(block, layout) }
    }
}

/// Windows of two flow solves each on a grid that moves: after the first ones no array is taken. (Only solves of more than twelve iterations take some, for more
/// columns of their combination.)
#[test]
fn steps_take_no_arrays() {
    let mut patches = [Patch::FarField; 6];
    patches[5] = Patch::Slip;
    let grid = box_grid_of(BoxShape::Hexahedra, [SIDE; 3], [0.0; 3], [1.0; 3], patches);
    let air = Laminar { viscosity: 0.02 };
    let mut s = common::isothermal(&grid, air, common::settings([3.0, -2.0, 4.0], 1e-2));
    let start = s.nodes.clone();
    let (dt, mut iterations) = (4e-3, 0);
    for window in 0..8 {
        if window == 4 {
            ARRAYS.store(0, Relaxed);
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
    let arrays = ARRAYS.load(Relaxed);
    println!("{arrays} arrays in the last four windows, {iterations} iterations in eight");
    assert!(iterations > 32);
    assert_eq!(arrays, 0);
}
