//! System calls for child processes.

use std::fs;
use std::os::unix::process::CommandExt;
use std::process::Command;

use rustix::process::{self, Pid, Signal, WaitOptions};

/// Starts `command` in its own process group (Ctrl-C reaches only the coupler,
/// which then ends the programs), and ends it when this process ends.
pub(super) fn bind_to_parent(command: &mut Command) {
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
    // SAFETY: between fork and exec the closure only makes async-signal-safe system calls (prctl, getppid, getpid,
    // kill), and accesses no memory except the captured process number.
    unsafe { command.pre_exec(end_with_parent) };
}

/// Makes orphaned ranks children of this process instead of process 1 when their `mpirun`
/// ends, so that they can be found and ended.
pub(super) fn adopt_orphans() {
    // A plain flag of this process; failure only loses the convenience.
    let _ = process::set_child_subreaper(Some(process::getpid()));
}

/// Sends a signal to a process; ignores a process that has ended.
pub(super) fn signal(process: u32, signal: Signal) {
    if let Some(process) = pid(process) {
        let _ = process::kill_process(process, signal);
    }
}

/// Sends a signal to a process group; ignores a group that has ended.
pub(super) fn signal_group(leader: u32, signal: Signal) {
    if let Some(leader) = pid(leader) {
        let _ = process::kill_process_group(leader, signal);
    }
}

/// Collects the exit status of an adopted process, which otherwise remains as a zombie.
pub(super) fn reap(process: u32) {
    if let Some(process) = pid(process) {
        let _ = process::waitpid(Some(process), WaitOptions::NOHANG);
    }
}

fn pid(process: u32) -> Option<Pid> {
    Pid::from_raw(process as i32)
}

/// A process with its parent and start time. Number and start time
/// identify it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ProcessEntry {
    pub process: u32,
    pub parent: u32,
    pub start: u64,
}

/// Reads `/proc/<process>/stat`. `None`: a zombie, or a process that has ended.
pub(super) fn read_stat(process: u32) -> Option<ProcessEntry> {
    let text = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // The name in parentheses may contain any character: count fields from its end.
    let fields: Vec<&str> = text[text.rfind(')')? + 2..].split(' ').collect();
    if fields.first() == Some(&"Z") {
        return None;
    }
    Some(ProcessEntry { process, parent: fields.get(1)?.parse().ok()?, start: fields.get(19)?.parse().ok()? })
}

/// All descendants of `roots`, and processes adopted by this process with the word `session`
/// on their command line.
pub(super) fn descendants(roots: &[u32], session: &str) -> Vec<ProcessEntry> {
    let Ok(folder) = fs::read_dir("/proc") else { return Vec::new() };
    let all: Vec<ProcessEntry> =
        folder.flatten().filter_map(|e| e.file_name().to_str()?.parse().ok()).filter_map(read_stat).collect();
    let me = std::process::id();
    let adopted = |seen: &&ProcessEntry| {
        seen.parent == me
            && !roots.contains(&seen.process)
            && fs::read(format!("/proc/{}/cmdline", seen.process))
                .is_ok_and(|c| c.split(|b| *b == 0).any(|word| word == session.as_bytes()))
    };
    let mut found: Vec<ProcessEntry> = all
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
