//! An allocator that counts, for tests of the memory that a process takes.
//!
//! The file has no dependencies, because tests of several crates include it by path. Such a test is alone in its program.
#![allow(dead_code, reason = "each test uses a part of it")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// The system's allocator, which counts.
pub struct Counted;

#[global_allocator]
static ALLOCATOR: Counted = Counted;
/// Bytes that are allocated.
pub static USED: AtomicUsize = AtomicUsize::new(0);
/// Their maximum since it was last set.
pub static MOST: AtomicUsize = AtomicUsize::new(0);
/// Least bytes of an allocation that is counted.
pub static LEAST: AtomicUsize = AtomicUsize::new(0);
/// Allocations of at least [`LEAST`] bytes.
pub static COUNT: AtomicUsize = AtomicUsize::new(0);

fn count(size: usize) {
    MOST.fetch_max(USED.fetch_add(size, Relaxed) + size, Relaxed);
    COUNT.fetch_add(usize::from(size >= LEAST.load(Relaxed)), Relaxed);
}

// SAFETY: forwards all calls to the system's allocator.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: as the caller promised.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        USED.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as the caller promised.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        USED.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(block, layout) }
    }
}
