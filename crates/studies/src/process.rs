//! One `ripstop run` as a child process.

use std::fs::File;
use std::path::Path;
use std::process::{Command, ExitStatus, Stdio};
use std::time::Duration;

use coupling::error::RunError;
use rustix::process::{Pid, Signal, kill_process};

/// Runs `program run scene --out out` with further `options`; writes its standard error to the file `log`. When `stop`
/// returns true, the run gets SIGTERM once and ends together with its programs.
///
/// # Errors
/// `log` cannot be written, or `program` cannot be started or waited for.
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
            // Fails if the process has ended since the check above.
            let _ = kill_process(Pid::from_child(&child), Signal::TERM);
            signalled = true;
        }
        std::thread::sleep(Duration::from_millis(20));
    }
}
