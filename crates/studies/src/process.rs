//! One `ripstop run` as a process of its own.

use std::fs::File;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

use coupling::error::RunError;
use rustix::process::{Pid, Signal, kill_process};

/// Runs `scene` into the folder `out` by `program` with further options; its messages of errors go to the file `log`. Once
/// `stop` is true the run is asked to end, which it does with all of its programs.
///
/// # Errors
/// A file that cannot be written; a program that cannot be started or waited for.
pub(crate) fn run_scene(
    program: &Path,
    [scene, out]: [&Path; 2],
    options: &[&str],
    log: &Path,
    stop: &mut dyn FnMut() -> bool,
) -> Result<ExitStatus, RunError> {
    let file = File::create(log).map_err(RunError::file("create", log))?;
    let mut child = Command::new(program)
        .arg("run")
        .arg(scene)
        .arg("--out")
        .arg(out)
        .arg("--quiet")
        .args(options)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(file)
        .spawn()
        .map_err(RunError::file("start", program))?;
    let mut signalled = false;
    loop {
        if let Some(status) = child.try_wait().map_err(RunError::file("wait for", program))? {
            return Ok(status);
        }
        if stop() && !signalled {
            // It may have ended since.
            let _ = kill_process(Pid::from_child(&child), Signal::TERM);
            signalled = true;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
