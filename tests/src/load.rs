//! Limits of time that do not depend on what else the machine does.
//!
//! A thread of the test computes without pause for as long as somebody measures. The scheduler shares the cores among
//! all that want them, so the processor time of that thread is the time that was available to any one thread:
//! the time by the clock on a free core, a part of it on a loaded machine. Limits count available time.
//!
//! The file has no dependency within the project: the tests of `channel` and `coupler` include it by its path.
#![allow(dead_code, reason = "each test uses a part of it")]

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

/// The thread that computes; it ends with the last of its users.
struct Spinner {
    /// Its processor time, ns.
    used: AtomicU64,
}

impl Spinner {
    /// The spinner of this process: one for all that measure.
    fn shared() -> Arc<Self> {
        static SHARED: Mutex<Weak<Spinner>> = Mutex::new(Weak::new());
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(running) = shared.upgrade() {
            return running;
        }
        let new = Arc::new(Self { used: AtomicU64::new(0) });
        *shared = Arc::downgrade(&new);
        let seen = Arc::downgrade(&new);
        std::thread::spawn(move || {
            while let Some(spinner) = seen.upgrade() {
                spinner.used.store(thread_time().as_nanos() as u64, Ordering::Relaxed);
                drop(spinner);
                // Some 0.1 ms between two looks at the clock.
                for i in 0..100_000u32 {
                    std::hint::black_box(i);
                }
            }
        });
        new
    }

    fn used(&self) -> Duration {
        Duration::from_nanos(self.used.load(Ordering::Relaxed))
    }
}

/// Processor time of the calling thread.
pub fn thread_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// Measures available time from its creation on.
pub struct Available {
    spinner: Arc<Spinner>,
    begin: Duration,
}

impl Available {
    /// Begins to measure.
    #[allow(clippy::new_without_default, reason = "it starts a thread")]
    pub fn new() -> Self {
        let spinner = Spinner::shared();
        let begin = spinner.used();
        Self { spinner, begin }
    }

    /// Time that one thread could have computed since the creation; never more than the time by the clock.
    pub fn elapsed(&self) -> Duration {
        self.spinner.used().saturating_sub(self.begin)
    }
}

/// A limit of available time.
pub struct Limit {
    begin: Instant,
    available: Available,
    limit: Duration,
}

impl Limit {
    /// `limit` of available time from now on.
    pub fn new(limit: Duration) -> Self {
        Self { begin: Instant::now(), available: Available::new(), limit }
    }

    /// Whether it has passed.
    pub fn passed(&self) -> bool {
        self.available.elapsed() > self.limit
    }

    /// Fails the test if it has passed.
    #[track_caller]
    pub fn demand(&self, what: impl std::fmt::Display) {
        assert!(!self.passed(), "{what}: {}", self.told());
    }

    /// Times, for messages.
    pub fn told(&self) -> String {
        format!(
            "{:.1?} of processor time were available to a thread, at most {:.1?} were allowed; {:.1?} by the clock",
            self.available.elapsed(),
            self.limit,
            self.begin.elapsed()
        )
    }

    /// Polls every `pause` until `done`; the time by the clock since the limit began.
    ///
    /// # Errors
    /// The limit has passed.
    pub fn until(&self, pause: Duration, mut done: impl FnMut() -> bool) -> Result<Duration, String> {
        while !done() {
            if self.passed() {
                return Err(self.told());
            }
            std::thread::sleep(pause);
        }
        Ok(self.begin.elapsed())
    }
}

/// How many times slower than on a free core a thread computes now: 1 or more.
pub fn slowdown() -> f64 {
    const ENOUGH: Duration = Duration::from_millis(200);
    let (begin, available) = (Instant::now(), Available::new());
    while available.elapsed() < ENOUGH {
        std::thread::sleep(Duration::from_millis(5));
    }
    (begin.elapsed().as_secs_f64() / available.elapsed().as_secs_f64()).max(1.0)
}

/// A deadline by the clock within which a program on this machine, as it is loaded now, can do
/// what takes it `free` on a free core.
pub fn deadline(free: Duration) -> Duration {
    free.mul_f64(slowdown())
}

/// As [`deadline`], in whole seconds.
pub fn deadline_s(free: u64) -> u64 {
    deadline(Duration::from_secs(free)).as_secs_f64().ceil() as u64
}

/// Processor seconds that a process has used.
fn used_s(process: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).expect("the process lives");
    let fields: Vec<&str> = text.rsplit(')').next().expect("fields").split_whitespace().collect();
    let ticks: f64 = fields[11].parse::<f64>().expect("utime") + fields[12].parse::<f64>().expect("stime");
    ticks / 100.0
}

/// Demands that all `processes` come to wait within `patience`, and then sleep: while two seconds are available to
/// each, none uses more than the share `most` of the time by the clock.
pub fn asleep(processes: &[u32], most: f64, patience: Duration) {
    let limit = Limit::new(patience);
    loop {
        let before: Vec<f64> = processes.iter().map(|&p| used_s(p)).collect();
        let begin = Instant::now();
        let _ = Limit::new(Duration::from_secs(2)).until(Duration::from_millis(50), || false);
        let clock = begin.elapsed().as_secs_f64();
        let used: Vec<f64> = processes.iter().zip(before).map(|(&p, b)| used_s(p) - b).collect();
        if used.iter().all(|u| *u <= most * clock) {
            return;
        }
        limit.demand(format_args!("processes {processes:?} used {used:.2?} s of {clock:.1} s while waiting"));
    }
}
