//! Ctrl-C and termination signals.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use coupling::error::RunError;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::{flag, low_level};

/// Exit code of a process that a signal has ended at once.
const EXIT_CODE: i32 = 130;

/// A flag that a signal to end sets. A second signal ends this process at once; its programs then end by
/// themselves.
///
/// # Errors
/// Signals that cannot be handled.
pub(crate) fn stop_flag() -> Result<Arc<AtomicBool>, RunError> {
    let stop = Arc::default();
    listen([&stop])?;
    Ok(stop)
}

/// Lets each signal to end set the next of `flags`; one more ends this process.
///
/// The first flag is set by the handler itself, so that a system call which the signal cuts short finds it set. The
/// others are set by a thread that counts the signals.
///
/// # Errors
/// Signals that cannot be handled.
pub(crate) fn listen<const N: usize>(flags: [&Arc<AtomicBool>; N]) -> Result<(), RunError> {
    let failed = |error| RunError::file("handle signals in", "this process")(error);
    let (mut counted, handler) = UnixStream::pair().map_err(failed)?;
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        flag::register(signal, Arc::clone(flags[0])).map_err(failed)?;
        low_level::pipe::register(signal, handler.try_clone().map_err(failed)?).map_err(failed)?;
    }
    let flags = flags.map(Arc::clone);
    std::thread::spawn(move || {
        let mut next = flags.iter();
        // One byte for each signal.
        while counted.read_exact(&mut [0]).is_ok() {
            match next.next() {
                Some(flag) => flag.store(true, Ordering::Relaxed),
                None => low_level::exit(EXIT_CODE),
            }
        }
    });
    Ok(())
}
