//! Limits of available time, the clock of other tests.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use ripstop_tests::load::{Available, Limit, thread_time};

/// Busy loops, ended when dropped.
struct Load(Arc<AtomicBool>);

impl Load {
    fn new(threads: usize) -> Self {
        let end = Arc::new(AtomicBool::new(false));
        for _ in 0..threads {
            let end = end.clone();
            std::thread::spawn(move || while !end.load(Ordering::Relaxed) {});
        }
        Self(end)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// A computation of a fixed length, by the clock and by the available time of `Available`.
fn work(length: Duration) -> (f64, f64) {
    let (clock, available, begin) = (Instant::now(), Available::new(), thread_time());
    while thread_time() - begin < length {}
    (clock.elapsed().as_secs_f64(), available.elapsed().as_secs_f64())
}

#[test]
fn available_time_of_a_computation_is_independent_of_load() {
    let cores = std::thread::available_parallelism().map_or(2, usize::from);
    let load = Load::new(4 * cores);
    let mut works: Vec<(f64, f64)> = (0..5).map(|_| work(Duration::from_millis(200))).collect();
    drop(load);
    // The scheduler gives equal shares on average only: threads wait for tens of milliseconds, and threads on a busier core
    // get less until they are migrated. The median of five removes this scatter.
    works.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (clock, available) = works[2];
    // Four loops per core plus the work and the measurement: four times the wall time on average.
    assert!(works.iter().map(|w| w.0).sum::<f64>() > 2.0, "the load is none: {works:?}");
    assert!((0.1..0.4).contains(&available), "{available} s available, {clock} s by the clock, of {works:?}");
}

#[test]
fn limit_passes_after_its_available_time() {
    let begin = Instant::now();
    let end = Limit::new(Duration::from_millis(100)).until(Duration::from_millis(1), || false);
    // No more time is available than passes by the clock.
    assert!(end.is_err() && begin.elapsed() >= Duration::from_millis(100), "{end:?}");
    let later = || begin.elapsed() > Duration::from_millis(120);
    assert!(Limit::new(Duration::from_secs(60)).until(Duration::from_millis(1), later).is_ok());
}
