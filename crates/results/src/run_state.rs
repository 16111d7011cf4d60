//! State of a run, from the files in its folder: it may be running, and its process may have been killed.

use std::path::Path;

use coupling::error::RunError;
use serde_json::Value;

use crate::lock::is_locked;
use crate::progress::StageProgress;
use crate::summary::{COMPLETE, RUNNING};

/// Attempts to read a summary that is being written.
const ATTEMPTS: u32 = 5;

/// State of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RunState {
    /// A process writes to the folder.
    Running,
    /// All stages were completed; the exit code is 3 where the run deviates from its baseline.
    Complete,
    /// Ended by Ctrl-C or a termination signal.
    Interrupted(String),
    /// Ended by an error.
    Failed(String),
    /// The process ended without a word.
    Killed,
}

/// A run at one moment.
#[derive(Clone, Debug)]
pub struct RunStatus {
    /// Its state.
    pub state: RunState,
    /// Exit code of the run where its summary has one.
    pub exit_code: Option<u8>,
    /// `summary.json`; `None` before the run has written one.
    pub summary: Option<Value>,
    /// The stage that is running, or was the last one to run; `None` before the first stage starts.
    pub progress: Option<StageProgress>,
}

impl RunStatus {
    /// Reads the state of the run in `out`.
    ///
    /// # Errors
    /// [`RunError::Input`]: a folder without a run, or a damaged summary.
    pub fn read(out: &Path) -> Result<Self, RunError> {
        let present = |name: &str| out.join(name).is_file();
        if !present("summary.json") && !present("scene.toml") {
            return Err(RunError::Input(format!(
                "there is no run in {}: neither summary.json nor scene.toml. Name the results folder of `ripstop run`",
                out.display()
            )));
        }
        // In this order: a run that ends in between has written its summary before it unlocks the folder.
        let locked = is_locked(out);
        let summary = summary(out)?;
        let text = |key: &str| summary.as_ref().and_then(|s| s.get(key)).and_then(Value::as_str);
        let code = summary.as_ref().and_then(|s| s.get("exit_code")).and_then(Value::as_u64);
        let exit_code = code.and_then(|code| u8::try_from(code).ok());
        let state = match (text("ended").unwrap_or(RUNNING), locked) {
            (_, true) => RunState::Running,
            (RUNNING, false) => RunState::Killed,
            (COMPLETE, false) => RunState::Complete,
            // Summaries of earlier versions have no exit code.
            (how, false) if exit_code == Some(130) || how.starts_with("interrupted") => {
                RunState::Interrupted(how.into())
            }
            (how, false) => RunState::Failed(how.into()),
        };
        Ok(Self { state, exit_code, progress: StageProgress::read(out), summary })
    }

    /// Whether the run has ended.
    pub fn ended(&self) -> bool {
        self.state != RunState::Running
    }

    /// Exit code of a command that follows the run: that of the run, 1 where it was killed.
    ///
    /// # Errors
    /// How a run ended that is not complete.
    pub fn verdict(&self) -> Result<(), RunError> {
        let (how, code) = match &self.state {
            RunState::Running => return Ok(()),
            RunState::Complete => match self.exit_code {
                None | Some(0) => return Ok(()),
                Some(code) => ("it deviates from its baseline".to_owned(), code),
            },
            RunState::Interrupted(how) => (how.clone(), 130),
            RunState::Failed(how) => (how.clone(), self.exit_code.unwrap_or(1)),
            RunState::Killed => {
                ("its process ended without writing a summary (killed, or the machine stopped)".into(), 1)
            }
        };
        Err(RunError::Followed { how, code })
    }
}

/// `summary.json` of the run in `out`. It may be in the middle of being written by an earlier version.
fn summary(out: &Path) -> Result<Option<Value>, RunError> {
    let path = out.join("summary.json");
    for attempt in 1.. {
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(RunError::file("read", &path)(e)),
        };
        match serde_json::from_str(&text) {
            Ok(value) => return Ok(Some(value)),
            Err(_) if attempt < ATTEMPTS => std::thread::sleep(std::time::Duration::from_millis(20)),
            Err(e) => {
                return Err(RunError::Input(format!(
                    "{} is damaged ({e}). Remove it to read the run",
                    path.display()
                )));
            }
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn folder(summary: &Value) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("scene.toml"), "").expect("written");
        if !summary.is_null() {
            std::fs::write(folder.path().join("summary.json"), summary.to_string()).expect("written");
        }
        folder
    }

    fn code(status: &RunStatus) -> u8 {
        status.verdict().map_or_else(|e| e.exit_code(), |()| 0)
    }

    #[test]
    fn state_follows_summary_and_lock() {
        let interrupted = "interrupted in stage `descent`, window 7, coupling iteration 0";
        for (summary, state, expected) in [
            (json!({"ended": "complete", "exit_code": 0}), RunState::Complete, 0),
            (json!({"ended": "complete", "exit_code": 3}), RunState::Complete, 3),
            (json!({"ended": "complete"}), RunState::Complete, 0),
            (json!({"ended": interrupted, "exit_code": 130}), RunState::Interrupted(interrupted.into()), 130),
            (json!({"ended": interrupted}), RunState::Interrupted(interrupted.into()), 130),
            (json!({"ended": "the grid", "exit_code": 1}), RunState::Failed("the grid".into()), 1),
            (json!({"ended": "no file", "exit_code": 2}), RunState::Failed("no file".into()), 2),
            (json!({"ended": "running"}), RunState::Killed, 1),
            (Value::Null, RunState::Killed, 1),
        ] {
            let folder = folder(&summary);
            let status = RunStatus::read(folder.path()).expect("a run");
            assert_eq!((&status.state, status.ended(), code(&status)), (&state, true, expected), "{summary}");
            // A process that holds the lock is a run, whatever an earlier one has written.
            let _lock = crate::lock::lock(folder.path()).expect("the lock");
            let status = RunStatus::read(folder.path()).expect("a run");
            assert_eq!(
                (&status.state, status.ended(), code(&status)),
                (&RunState::Running, false, 0),
                "{summary}"
            );
        }
    }

    #[test]
    fn folder_without_a_run_and_damaged_summary_are_refused() {
        let empty = tempfile::tempdir().expect("a folder");
        let error = RunStatus::read(empty.path()).expect_err("no run").to_string();
        assert!(error.contains("there is no run in"), "{error}");
        let damaged = folder(&Value::Null);
        std::fs::write(damaged.path().join("summary.json"), "{\"ended\"").expect("written");
        let error = RunStatus::read(damaged.path()).expect_err("damaged").to_string();
        assert!(error.contains("summary.json is damaged"), "{error}");
    }
}
