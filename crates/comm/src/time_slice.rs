//! Short time slices for ranks that wait for each other.
//!
//! A rank that waits calls MPI, which yields the core and asks again. Where another program computes on that core each yield hands
//! over a whole time slice of some milliseconds. With slices of 0.1 ms the rank gets the core back sooner; on idle cores
//! nothing changes.

/// Time slice, ns: the shortest that Linux grants.
const SLICE_NS: u64 = 100_000;

const THIS_THREAD: libc::pid_t = 0;
const NO_FLAGS: libc::c_uint = 0;

/// Policy, niceness and time slice of this thread; `None` where the kernel does not report them.
fn attributes() -> Option<libc::sched_attr> {
    // SAFETY: all zeros are a valid value of this structure of integers.
    let mut of: libc::sched_attr = unsafe { std::mem::zeroed() };
    let bytes = size_of::<libc::sched_attr>() as libc::c_uint;
    // SAFETY: the kernel writes at most `bytes` into the structure, which outlives the call.
    let code = unsafe { libc::syscall(libc::SYS_sched_getattr, THIS_THREAD, &raw mut of, bytes, NO_FLAGS) };
    (code == 0).then_some(of)
}

/// Asks the kernel for short time slices of this thread, whose policy and niceness stay. Linux before 6.12 keeps its own
/// slices, as does a thread of another policy than the usual one.
pub(crate) fn shorten() {
    if let Some(present) = attributes().filter(|a| a.sched_policy == libc::SCHED_OTHER as u32) {
        let wanted = libc::sched_attr { sched_runtime: SLICE_NS, ..present };
        // SAFETY: the kernel reads the structure, of the size in it, during the call. A refusal leaves all as it is.
        unsafe { libc::syscall(libc::SYS_sched_setattr, THIS_THREAD, &raw const wanted, NO_FLAGS) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether this kernel has time slices of threads.
    fn has_slices() -> bool {
        let text = std::fs::read_to_string("/proc/sys/kernel/osrelease").expect("Linux");
        let mut numbers = text.split(|c: char| !c.is_ascii_digit()).map_while(|n| n.parse::<u32>().ok());
        (numbers.next(), numbers.next()) >= (Some(6), Some(12))
    }

    #[test]
    fn slices_are_short_and_niceness_stays() {
        // A thread of its own: the attributes are those of a thread.
        let of_thread = || {
            let before = attributes().expect("attributes");
            shorten();
            (before, attributes().expect("attributes"))
        };
        let (before, after) = std::thread::spawn(of_thread).join().expect("no panic");
        let kept = |a: &libc::sched_attr| (a.sched_policy, a.sched_nice, a.sched_flags, a.sched_priority);
        assert_eq!(kept(&before), kept(&after));
        if has_slices() && before.sched_policy == libc::SCHED_OTHER as u32 {
            assert_eq!(after.sched_runtime, SLICE_NS);
            assert_ne!(before.sched_runtime, SLICE_NS, "the usual slice is longer");
        }
    }
}
