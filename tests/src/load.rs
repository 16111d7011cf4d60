//! Time limits that do not depend on the load of the machine.
//!
//! During a measurement a thread of the test computes a tenth of the time, in bursts. The scheduler shares the cores between all
//! threads, so the processor time of a burst over its length by the clock is the share of a core that is available to one
//! thread: 1 on an idle core, less on a loaded machine. Limits count available time, the integral of that share. Without pauses
//! the thread would take a fifth of two cores from what the tests measure.
//!
//! The file has no dependencies within the project, because the tests of `channel` and `coupler` include it by path.
#![allow(dead_code, reason = "each test uses a part of it")]

use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Processor time of a burst: several time slices of the scheduler, of which a thread that has slept gets the first at once.
const BURST: Duration = Duration::from_millis(15);
/// Pause after a burst, in units of its length by the clock on an idle core.
const PAUSE: u32 = 9;

/// The thread that samples the load; it ends with its last user.
struct Sampler(Mutex<Sampled>);

/// Available time up to an instant, and the share of a core that is available since.
#[derive(Clone, Copy)]
struct Sampled {
    at: Instant,
    available: Duration,
    share: f64,
}

impl Sampled {
    fn available_at(&self, now: Instant) -> Duration {
        self.available + now.saturating_duration_since(self.at).mul_f64(self.share)
    }
}

impl Sampler {
    /// The common sampler of this process.
    fn shared() -> Arc<Self> {
        static SHARED: Mutex<Weak<Sampler>> = Mutex::new(Weak::new());
        let mut shared = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(running) = shared.upgrade() {
            return running;
        }
        let start = Sampled { at: Instant::now(), available: Duration::ZERO, share: 1.0 };
        let new = Arc::new(Self(Mutex::new(start)));
        *shared = Arc::downgrade(&new);
        let seen = Arc::downgrade(&new);
        std::thread::spawn(move || {
            while let Some(sampler) = seen.upgrade() {
                sampler.set(share_of_a_core(BURST));
                drop(sampler);
                std::thread::sleep(BURST * PAUSE);
            }
        });
        new
    }

    fn set(&self, share: f64) {
        let mut sampled = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let now = Instant::now();
        *sampled = Sampled { at: now, available: sampled.available_at(now), share };
    }

    /// Available time since the sampler started.
    fn available(&self) -> Duration {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).available_at(Instant::now())
    }
}

/// Computes for `length` of processor time: its share of the time by the clock.
fn share_of_a_core(length: Duration) -> f64 {
    let (clock, begin) = (Instant::now(), thread_time());
    loop {
        for i in 0..100_000u32 {
            std::hint::black_box(i);
        }
        let used = thread_time() - begin;
        if used >= length {
            return (used.as_secs_f64() / clock.elapsed().as_secs_f64()).min(1.0);
        }
    }
}

/// Processor time of the calling thread.
pub fn thread_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(time.tv_sec as u64, time.tv_nsec as u32)
}

/// A clock of available time.
pub struct Available {
    sampler: Arc<Sampler>,
    begin: Duration,
}

impl Available {
    /// Starts the clock.
    #[allow(clippy::new_without_default, reason = "it starts a thread")]
    pub fn new() -> Self {
        let sampler = Sampler::shared();
        let begin = sampler.available();
        Self { sampler, begin }
    }

    /// Time available to one thread since the start, at most the wall time.
    pub fn elapsed(&self) -> Duration {
        self.sampler.available().saturating_sub(self.begin)
    }
}

/// A limit of available time.
pub struct Limit {
    begin: Instant,
    available: Available,
    limit: Duration,
}

impl Limit {
    /// A limit of available time from now.
    pub fn new(limit: Duration) -> Self {
        Self { begin: Instant::now(), available: Available::new(), limit }
    }

    /// Whether the limit has passed.
    pub fn passed(&self) -> bool {
        self.available.elapsed() > self.limit
    }

    /// Fails the test if the limit has passed.
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

    /// Polls every `pause` until `done`; returns the wall time since the start of the limit.
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

/// Factor by which a thread is slower than on an idle core, at least 1.
pub fn slowdown() -> f64 {
    1.0 / share_of_a_core(Duration::from_millis(200))
}

/// Wall time for work that needs `free` on an idle core, at the present load.
pub fn deadline(free: Duration) -> Duration {
    free.mul_f64(slowdown())
}

/// As [`deadline`], in whole seconds.
pub fn deadline_s(free: u64) -> u64 {
    deadline(Duration::from_secs(free)).as_secs_f64().ceil() as u64
}

/// Processor time of a process, s.
fn used_s(process: u32) -> f64 {
    let text = std::fs::read_to_string(format!("/proc/{process}/stat")).expect("the process lives");
    let fields: Vec<&str> = text.rsplit(')').next().expect("fields").split_whitespace().collect();
    let ticks: f64 = fields[11].parse::<f64>().expect("utime") + fields[12].parse::<f64>().expect("stime");
    ticks / 100.0
}

/// Asserts that all `processes` start waiting within `patience` and then sleep: during two seconds of available time, none
/// uses more than the fraction `most` of the wall time.
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
