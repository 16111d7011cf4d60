//! Console output of a run: lines of all programs, warnings, log.

mod count;
pub mod plot;
pub mod screen;
pub mod shell;
mod time;

use std::fs::File;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::sync::{Arc, Mutex};

use case::Role;
use indicatif::ProgressBar;

pub use count::counted;
pub use time::{clock, utc_now};

/// Prints lines above the progress line. Clones share their output.
///
/// # Examples
///
/// A quiet console prints nothing, but its log has each line with the time:
///
/// ```
/// use terminal::Console;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("run.log");
/// let console = Console::new(true);
/// console.log_to(&path, false)?;
/// console.line("stage 1 of 3: pre-inflation");
/// assert!(std::fs::read_to_string(&path)?.ends_with(" info    stage 1 of 3: pre-inflation\n"));
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Clone, Default)]
pub struct Console {
    quiet: bool,
    verbose: bool,
    colour: bool,
    bar: Arc<Mutex<Option<ProgressBar>>>,
    warnings: Arc<Mutex<Vec<String>>>,
    log: Arc<Mutex<Option<File>>>,
}

/// Maximum number of warnings in the summary: a failing run may give one in each window.
const MAX_WARNINGS: usize = 1000;

impl Console {
    /// A console on standard error; `quiet` prints errors only.
    pub fn new(quiet: bool) -> Self {
        let colour = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
        Self { quiet, colour, ..Self::default() }
    }

    /// With `verbose`, standard output of the programs is printed too.
    pub fn verbose(self, verbose: bool) -> Self {
        Self { verbose, ..self }
    }

    /// Whether standard output of the programs is printed.
    pub fn shows_all(&self) -> bool {
        self.verbose
    }

    /// Whether standard error is a terminal with colours.
    pub fn colour(&self) -> bool {
        self.colour
    }

    /// Whether only errors are printed.
    pub fn quiet(&self) -> bool {
        self.quiet
    }

    /// Sets the progress bar above which lines are printed. `None`: no bar.
    pub fn set_bar(&self, bar: Option<ProgressBar>) {
        if let Ok(mut place) = self.bar.lock() {
            *place = bar;
        }
    }

    /// Writes every line to `path` too, with time and level (`info`, `warning`, `error`), including lines that `quiet` suppresses. `resumed`: appends
    /// to the file.
    ///
    /// # Errors
    /// The file cannot be opened.
    pub fn log_to(&self, path: &Path, resumed: bool) -> std::io::Result<()> {
        let file = File::options().create(true).write(true).append(resumed).truncate(!resumed).open(path)?;
        if let Ok(mut log) = self.log.lock() {
            *log = Some(file);
        }
        Ok(())
    }

    /// Writes a line to the log only, at level `info`.
    pub fn note(&self, text: &str) {
        self.log("info", text);
    }

    fn log(&self, level: &str, text: &str) {
        if let Ok(mut log) = self.log.lock()
            && let Some(file) = log.as_mut()
        {
            // An error is ignored: a full disk ends the run when results are written.
            let _ = writeln!(file, "{} {level:<7} {text}", utc_now());
        }
    }

    /// Prints a line unless quiet, and writes it to the log.
    pub fn line(&self, text: &str) {
        self.note(text);
        self.print(text);
    }

    /// Prints a result on standard output unless quiet, and writes it to the log. The progress line must have ended.
    pub fn result(&self, text: &str) {
        self.note(text);
        if !self.quiet {
            // A closed pipe must not end the run.
            drop(writeln!(std::io::stdout(), "{text}"));
        }
    }

    fn print(&self, text: &str) {
        if self.quiet {
            return;
        }
        let bar = self.bar.lock().ok().and_then(|b| b.clone());
        match bar {
            Some(bar) if !bar.is_hidden() => bar.println(text),
            // A closed pipe must not end the run.
            _ => drop(writeln!(std::io::stderr(), "{text}")),
        }
    }

    /// Prints a line of a program with its role.
    pub fn program_line(&self, role: Role, text: &str) {
        let name = role.name();
        self.note(&format!("{name:>9} | {text}"));
        if self.colour {
            let colour = match role {
                Role::Structure => 36,
                Role::Flow => 34,
                Role::Mesh => 35,
            };
            self.print(&format!("\x1b[{colour}m{name:>9}\x1b[0m | {text}"));
        } else {
            self.print(&format!("{name:>9} | {text}"));
        }
    }

    /// Prints the error of a failed run, also when quiet.
    pub fn error(&self, text: &str) {
        self.log("error", text);
        let head = if self.colour { "\x1b[1;31merror\x1b[0m" } else { "error" };
        drop(writeln!(std::io::stderr(), "{head}: {text}"));
    }

    /// The warnings so far, at most 1000.
    pub fn warnings(&self) -> Vec<String> {
        self.warnings.lock().map(|kept| kept.clone()).unwrap_or_default()
    }

    /// Adds the warnings of the run that is resumed, which were printed then.
    pub fn restore_warnings(&self, before: Vec<String>) {
        if let Ok(mut kept) = self.warnings.lock() {
            kept.splice(0..0, before);
            kept.truncate(MAX_WARNINGS);
        }
    }

    /// Prints a warning and stores it for the summary.
    pub fn warning(&self, text: &str) {
        if let Ok(mut kept) = self.warnings.lock()
            && kept.len() < MAX_WARNINGS
        {
            kept.push(text.to_owned());
        }
        self.caution(text);
    }

    /// Prints a warning without storing it: the summary contains the findings of the inspection separately.
    pub fn caution(&self, text: &str) {
        self.log("warning", text);
        if self.colour {
            self.print(&format!("\x1b[33mwarning\x1b[0m: {text}"));
        } else {
            self.print(&format!("warning: {text}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn log_contains_lines_that_quiet_suppresses() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("ripstop.log");
        let console = Console::new(true);
        console.line("before");
        console.log_to(&path, false).expect("a log");
        console.line("stage `one`");
        console.warning("it jumps");
        console.program_line(Role::Flow, "a word");
        console.log_to(&path, true).expect("the same log");
        console.line("continued");
        let text = std::fs::read_to_string(&path).expect("a log");
        // A date and a time of 19 letters come first.
        let lines: Vec<&str> = text.lines().map(|l| &l[20..]).collect();
        assert_eq!(
            lines,
            ["info    stage `one`", "warning it jumps", "info         flow | a word", "info    continued"],
            "{text}"
        );
        console.log_to(&path, false).expect("a new log");
        assert!(std::fs::read_to_string(&path).expect("a log").is_empty());
    }
}
