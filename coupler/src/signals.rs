//! Ctrl-C and termination signals.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use coupling::error::RunError;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::{flag, low_level};

/// Exit code of a process that a signal ended immediately.
const EXIT_CODE: i32 = 130;

/// A flag that the first termination signal sets. A second signal ends this process immediately; its programs end
/// when they detect that.
///
/// # Errors
/// Signals that cannot be handled.
pub(crate) fn stop_flag() -> Result<Arc<AtomicBool>, RunError> {
    let stop = Arc::default();
    listen([&stop])?;
    Ok(stop)
}

/// The n-th termination signal sets the n-th of `flags`; one more signal ends this process.
///
/// The signal handler sets the first flag itself, so that it is set when an interrupted system call returns. A thread
/// that counts the signals sets the others.
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
