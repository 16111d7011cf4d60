//! Who of several silent ranks holds the others up, as far as the kernel can tell.

use std::fs;
use std::time::Duration;

/// Looks at each process, and the pause between two looks.
const LOOKS: u32 = 5;
const PAUSE: Duration = Duration::from_millis(20);

/// State of a process and the processor time that it has used: fields 3, 14 and 15 of
/// `/proc/<pid>/stat`. `None` where it is gone, or in another container.
fn look(pid: u32) -> Option<(u8, u64)> {
    let text = fs::read_to_string(format!("/proc/{pid}/stat")).ok()?;
    // The name in parentheses may hold anything; fields count from behind it.
    let mut fields = text[text.rfind(')')? + 1..].split_ascii_whitespace();
    let state = *fields.next()?.as_bytes().first()?;
    let used = fields.nth(10)?.parse::<u64>().ok()? + fields.next()?.parse::<u64>().ok()?;
    Some((state, used))
}

/// Whether a process is stopped (SIGSTOP, Ctrl-Z, a debugger).
pub(crate) fn is_stopped(pid: u32) -> bool {
    look(pid).is_some_and(|(state, _)| matches!(state, b'T' | b't'))
}

/// Which of `pids`, all silent, the others wait for, and what it does. A stopped process
/// is always the one; one that sleeps is, where others compute or spin in MPI.
pub(crate) fn suspect(pids: &[u32]) -> Option<(usize, &'static str)> {
    if let Some(i) = pids.iter().position(|&pid| is_stopped(pid)) {
        return Some((i, "its process is stopped"));
    }
    let mut asleep = vec![true; pids.len()];
    for _ in 0..LOOKS {
        for (asleep, &pid) in asleep.iter_mut().zip(pids) {
            *asleep &= look(pid).is_some_and(|(state, _)| matches!(state, b'S' | b'D'));
        }
        std::thread::sleep(PAUSE);
    }
    let mut sleepers = (0..pids.len()).filter(|&i| asleep[i]);
    match (sleepers.next(), sleepers.next()) {
        (Some(i), None) if pids.len() > 1 => Some((i, "its process sleeps while the others work")),
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
    fn the_one_that_holds_the_others_up_is_found() {
        let (busy, idle) = (shell("while :; do :; done"), shell("exec sleep 100"));
        let (a, b) = (busy.0.id(), idle.0.id());
        std::thread::sleep(Duration::from_millis(200));
        assert_eq!(suspect(&[a, b, a]).map(|s| s.0), Some(1));
        assert_eq!(suspect(&[b]), None, "alone it may be waiting for anything");
        assert_eq!(suspect(&[b, b]), None, "all sleep");
        // SAFETY: sends a signal to a child of this test; no memory is involved.
        unsafe { libc::kill(a as i32, libc::SIGSTOP) };
        std::thread::sleep(Duration::from_millis(100));
        assert!(is_stopped(a) && !is_stopped(b));
        assert_eq!(suspect(&[b, a]).map(|s| s.0), Some(1), "stopped counts before asleep");
        assert_eq!(suspect(&[u32::MAX, b, b]), None, "who is gone is no suspect");
    }
}
