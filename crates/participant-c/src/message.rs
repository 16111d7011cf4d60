//! The message of the last error: functions of C return a number.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Mutex, MutexGuard, PoisonError};

use ripstop_participant::Fault;

/// What a function returns after an error: `RIPSTOP_FAULT` of the header.
pub const FAULT: i32 = 1;

/// One for the process: a program may call from several threads.
static LAST: Mutex<Option<String>> = Mutex::new(None);

fn last() -> MutexGuard<'static, Option<String>> {
    LAST.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps the message; returns [`FAULT`].
pub fn keep(message: &str) -> i32 {
    *last() = Some(message.to_owned());
    FAULT
}

/// The message of the last error, empty if there was none.
pub fn kept() -> String {
    last().clone().unwrap_or_default()
}

/// Drops the message of an earlier error, which the program ignored.
pub fn clear() {
    *last() = None;
}

/// Error of the function `name` of a program that returned `code`.
pub fn of_program(name: &str, code: i32) -> Result<(), Fault> {
    if code == 0 {
        return Ok(());
    }
    Err(last().take().map_or_else(
        || {
            Fault::new(format!(
                "`{name}` of the program returned {code} without a message: return ripstop_fault(\"...\")"
            ))
        },
        Fault::new,
    ))
}

/// Runs a function; an error or panic becomes [`FAULT`] and a message.
pub fn guard(call: impl FnOnce() -> Result<(), Fault>) -> i32 {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(Ok(())) => 0,
        Ok(Err(fault)) => keep(&fault.message),
        Err(panic) => {
            let text = panic.downcast_ref::<String>().map(String::as_str);
            let text = text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("no text");
            keep(&format!("internal error of ripstop_participant_c: {text}"))
        }
    }
}
