//! Memory that a mesh-mover holds over many changes of its reference grid. One test: it reads the memory of the process.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use case::MeshMotion;
use mesh_mover::elastic::{Elastic, Solid};
use mesh_mover::motion::Limits;
use mesh_mover::torture::{MOTIONS, Trial, plate};

/// Counts the bytes in use.
struct Counted;

#[global_allocator]
static ALLOCATOR: Counted = Counted;
static USED: AtomicUsize = AtomicUsize::new(0);

// SAFETY: passes everything on to the system's allocator.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        USED.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        USED.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promised.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        USED.fetch_add(size, Ordering::Relaxed);
        USED.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promised.
        unsafe { System.realloc(block, layout, size) }
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        USED.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(block, layout) }
    }
}

/// Memory of the process that no file backs, bytes.
fn resident() -> usize {
    let text = std::fs::read_to_string("/proc/self/status").expect("Linux");
    let line = text.lines().find_map(|l| l.strip_prefix("RssAnon:")).expect("a line");
    1024 * line.trim().trim_end_matches(" kB").parse::<usize>().expect("a number")
}

/// The plate turns by 60 degrees and back, six times, with four new references each time.
#[test]
fn new_references_leave_no_memory_behind() {
    const ROUNDS: usize = 6;
    let limits = Limits { min_quality: 1e-3, max_increments: 8, repair: true };
    let mover = Box::new(Elastic::new(Solid::from(&MeshMotion::default())));
    let mut trial = Trial::new(&plate(16), mover, limits).unwrap();
    let turn = MOTIONS[2].1;
    let path: Vec<f64> = (1..=10).chain((0..10).rev()).map(|step| f64::from(step) / 10.0).collect();
    let mut seen = Vec::with_capacity(ROUNDS * path.len());
    for _ in 0..ROUNDS {
        for s in &path {
            trial.window(|p| turn(p, *s)).unwrap();
            seen.push((trial.motion.rebased(), USED.load(Ordering::Relaxed), resident()));
        }
    }
    assert!(trial.motion.rebased() >= 4 * ROUNDS as u32, "{}", trial.motion.rebased());
    // After the first round a leak of a single byte shows: between windows on one reference whose solver has been
    // used, and at equal points.
    let later = &seen[path.len()..];
    let quiet: Vec<_> = later.windows(3).filter(|w| w[0].0 == w[2].0).collect();
    assert!(quiet.len() > 3 * ROUNDS && quiet.iter().all(|w| w[1].1 == w[2].1), "{quiet:?}");
    let ends: Vec<usize> = seen.chunks(path.len()).map(|round| round[path.len() - 1].1).collect();
    assert!(ends.iter().all(|used| *used == ends[0]), "{ends:?}");
    // What is free is the system's: 0.4 MiB beyond the blocks in use, 3.5 MiB where the C library keeps it.
    let kept = later.iter().map(|(_, used, resident)| resident.saturating_sub(*used)).max();
    println!("{} bytes in use, at most {kept:?} beyond", ends[0]);
    assert!(kept < Some(3 << 19), "{kept:?} bytes kept");
}
