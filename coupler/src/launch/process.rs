//! The few system calls around child processes.

use std::fs;
use std::os::unix::process::CommandExt;
use std::process::Command;

use rustix::process::{self, Pid, Signal, WaitOptions};

/// Lets `command` start in a process group of its own (Ctrl-C reaches the coupler
/// alone, which then ends all in order) and end when this process ends.
pub(super) fn tie_to_parent(command: &mut Command) {
    command.process_group(0);
    let parent = process::getpid();
    let end_with_parent = move || {
        process::set_parent_process_death_signal(Some(Signal::TERM))?;
        // The parent may have died before the call above.
        if process::getppid() != Some(parent) {
            process::kill_process(process::getpid(), Signal::TERM)?;
        }
        Ok(())
    };
    // SAFETY: between fork and exec the closure makes plain system calls only (prctl, getppid, getpid, kill),
    // and touches no memory but its own number.
    unsafe { command.pre_exec(end_with_parent) };
}

/// Ranks whose `mpirun` dies become children of this process instead of process 1,
/// so that they can be found and ended.
pub(super) fn adopt_orphans() {
    // A plain flag of this process; failure only loses the convenience.
    let _ = process::set_child_subreaper(Some(process::getpid()));
}

/// Sends a signal to a process. One that is gone is fine.
pub(super) fn signal(process: u32, signal: Signal) {
    if let Some(process) = pid(process) {
        let _ = process::kill_process(process, signal);
    }
}

/// Sends a signal to a process group. One that is gone is fine.
pub(super) fn signal_group(leader: u32, signal: Signal) {
    if let Some(leader) = pid(leader) {
        let _ = process::kill_process_group(leader, signal);
    }
}

/// Collects the exit of an adopted process so that it does not stay as a zombie.
pub(super) fn reap(process: u32) {
    if let Some(process) = pid(process) {
        let _ = process::waitpid(Some(process), WaitOptions::NOHANG);
    }
}

fn pid(process: u32) -> Option<Pid> {
    Pid::from_raw(process as i32)
}

/// A process with its parent and start time (which together with its number
/// identify it).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Seen {
    pub process: u32,
    pub parent: u32,
    pub start: u64,
}

/// One line of `/proc/<process>/stat`; `None` for zombies and processes that are gone.
pub(super) fn look(process: u32) -> Option<Seen> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name in parentheses may hold anything; fields count from behind it.
    let fields: Vec<&str> = text[text.rfind(')')? + 2..].split(' ').collect();
    if fields.first() == Some(&"Z") {
        return None;
    }
    Some(Seen { process, parent: fields.get(1)?.parse().ok()?, start: fields.get(19)?.parse().ok()? })
}

/// All processes below `roots`, and those adopted by this process whose command
/// line holds `mark` (the session's name).
pub(super) fn descendants(roots: &[u32], mark: &str) -> Vec<Seen> {
    let Ok(folder) = fs::read_dir("/proc") else { return Vec::new() };
    let all: Vec<Seen> =
        folder.flatten().filter_map(|e| e.file_name().to_str()?.parse().ok()).filter_map(look).collect();
    let me = std::process::id();
    let adopted = |seen: &&Seen| {
        seen.parent == me
            && !roots.contains(&seen.process)
            && fs::read(format!("/proc/{}/cmdline", seen.process))
                .is_ok_and(|c| c.split(|b| *b == 0).any(|word| word == mark.as_bytes()))
    };
    let mut found: Vec<Seen> = all
        .iter()
        .filter(|s| roots.contains(&s.process))
        .chain(all.iter().filter(adopted))
        .copied()
        .collect();
    let mut at = 0;
    while at < found.len() {
        let parent = found[at].process;
        for seen in all.iter().filter(|s| s.parent == parent) {
            if !found.contains(seen) {
                found.push(*seen);
            }
        }
        at += 1;
    }
    found
}
