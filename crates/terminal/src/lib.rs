//! Where the lines of all programs meet the terminal.

mod count;
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

/// Prints lines without tearing the progress line apart.
#[derive(Clone, Default)]
pub struct Console {
    quiet: bool,
    verbose: bool,
    colour: bool,
    bar: Arc<Mutex<Option<ProgressBar>>>,
    warnings: Arc<Mutex<Vec<String>>>,
    log: Arc<Mutex<Option<File>>>,
}

/// Most warnings that are kept for the summary: a run that goes wrong gives one a window.
const KEPT: usize = 1000;

impl Console {
    /// On standard error; `quiet` drops everything but errors.
    pub fn new(quiet: bool) -> Self {
        let colour = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
        Self { quiet, colour, ..Self::default() }
    }

    /// With `verbose`, what programs print to standard output is shown too.
    pub fn verbose(self, verbose: bool) -> Self {
        Self { verbose, ..self }
    }

    /// Whether standard output of programs is shown.
    pub fn shows_all(&self) -> bool {
        self.verbose
    }

    /// Whether standard error is a terminal that shows colours.
    pub fn colour(&self) -> bool {
        self.colour
    }

    /// Whether only errors are printed.
    pub fn quiet(&self) -> bool {
        self.quiet
    }

    /// From now on lines are printed above this progress line (`None`: plainly).
    pub fn set_bar(&self, bar: Option<ProgressBar>) {
        if let Ok(mut place) = self.bar.lock() {
            *place = bar;
        }
    }

    /// From now on every line is kept in `path` too, with the time, also what `quiet` does not print; behind
    /// what is there if `resumed`.
    ///
    /// # Errors
    /// Trouble with the file.
    pub fn log_to(&self, path: &Path, resumed: bool) -> std::io::Result<()> {
        let file = File::options().create(true).write(true).append(resumed).truncate(!resumed).open(path)?;
        if let Ok(mut log) = self.log.lock() {
            *log = Some(file);
        }
        Ok(())
    }

    /// Keeps a line in the log only.
    pub fn note(&self, text: &str) {
        if let Ok(mut log) = self.log.lock()
            && let Some(file) = log.as_mut()
        {
            // A full disk ends the run where results are written.
            let _ = writeln!(file, "{} {text}", utc_now());
        }
    }

    /// A line for the user, unless quiet.
    pub fn line(&self, text: &str) {
        self.note(text);
        self.print(text);
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

    /// A line that a program printed.
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

    /// The one message of a run that failed: printed even when quiet.
    pub fn error(&self, text: &str) {
        self.note(&format!("error: {text}"));
        let head = if self.colour { "\x1b[1;31merror\x1b[0m" } else { "error" };
        drop(writeln!(std::io::stderr(), "{head}: {text}"));
    }

    /// The warnings so far, the first thousand of them.
    pub fn warnings(&self) -> Vec<String> {
        self.warnings.lock().map(|kept| kept.clone()).unwrap_or_default()
    }

    /// Warnings of the part of the run before this one, which were printed then.
    pub fn restore_warnings(&self, before: Vec<String>) {
        if let Ok(mut kept) = self.warnings.lock() {
            kept.splice(0..0, before);
            kept.truncate(KEPT);
        }
    }

    /// A warning of the coupler, kept for the summary.
    pub fn warning(&self, text: &str) {
        if let Ok(mut kept) = self.warnings.lock()
            && kept.len() < KEPT
        {
            kept.push(text.to_owned());
        }
        self.caution(text);
    }

    /// A warning that the summary has from elsewhere: the inspection before a run.
    pub fn caution(&self, text: &str) {
        self.note(&format!("warning: {text}"));
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
    fn the_log_holds_what_quiet_does_not_print() {
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
        assert_eq!(lines, ["stage `one`", "warning: it jumps", "     flow | a word", "continued"], "{text}");
        console.log_to(&path, false).expect("a new log");
        assert!(std::fs::read_to_string(&path).expect("a log").is_empty());
    }
}
