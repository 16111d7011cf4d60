//! Detection of the rank that stalls the others, as far as the kernel reports it.

use std::fs;
use std::time::Duration;

/// Samples of the state of each process, and the time between two of them.
const SAMPLES: u32 = 5;
const SAMPLE_INTERVAL: Duration = Duration::from_millis(20);

/// State of a process and its processor time: fields 3, 14 and 15 of `/proc/<pid>/stat`. `None` where it has ended,
/// or is in another container.
fn sample_process(pid: u32) -> Option<(u8, u64)> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses may contain anything; fields are counted after it.
    let mut fields = text[text.rfind(')')? + 1..].split_ascii_whitespace();
    let state = *fields.next()?.as_bytes().first()?;
    let used = fields.nth(10)?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?;
    Some((state, used))
}

/// Whether a process is stopped (SIGSTOP, Ctrl-Z, a debugger).
pub(crate) fn is_stopped(pid: u32) -> bool {
    sample_process(pid).is_some_and(|(state, _)| matches!(state, b'T' | b't'))
}

/// Index in `pids`, all without a response, of the rank that the others wait for, and its state: a stopped process,
/// or the only one that sleeps while the others compute or spin in MPI.
pub(crate) fn find_stalled(pids: &[u32]) -> Option<(usize, &'static str)> {
    if let Some(i) = pids.iter().position(|&pid| is_stopped(pid)) {
        return Some((i, "its process is stopped"));
    }
    let mut asleep = vec![true; pids.len()];
    for _ in 0..SAMPLES {
        for (asleep, &pid) in asleep.iter_mut().zip(pids) {
            *asleep &= sample_process(pid).is_some_and(|(state, _)| matches!(state, b'S' | b'D'));
        }
        std::thread::sleep(SAMPLE_INTERVAL);
    }
    let mut sleeping = (0..pids.len()).filter(|&i| asleep[i]);
    match (sleeping.next(), sleeping.next()) {
        (Some(i), None) if pids.len() > 1 => Some((i, "its process sleeps while the other ranks compute")),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::{Child, Command};

    struct Killed(Child);

    impl Drop for Killed {
        fn drop(&mut self) {
            let _ = self.0.kill();
            let _ = self.0.wait();
        }
    }

    fn shell(line: &str) -> Killed {
        Killed(Command::new("sh").args(["-c", line]).spawn().expect("a shell"))
    }

    #[test]
    fn stalled_rank_is_found() {
        let (busy, idle) = (shell("while :; do :; done"), shell("exec sleep 100"));
        let (a, b) = (busy.0.id(), idle.0.id());
        std::thread::sleep(Duration::from_millis(200));
        assert_eq!(find_stalled(&[a, b, a]).map(|s| s.0), Some(1));
        assert_eq!(find_stalled(&[b]), None, "a single sleeping rank may wait for anything");
        assert_eq!(find_stalled(&[b, b]), None, "all sleep");
        // SAFETY: sends a signal to a child of this test; no memory is involved.
        unsafe { libc::kill(a as i32, libc::SIGSTOP) };
        std::thread::sleep(Duration::from_millis(100));
        assert!(is_stopped(a) && !is_stopped(b));
        assert_eq!(find_stalled(&[b, a]).map(|s| s.0), Some(1), "stopped counts before asleep");
        assert_eq!(find_stalled(&[u32::MAX, b, b]), None, "an ended process is not reported");
    }
}
