//! A text on standard output that is written again in place.

use std::io::Write;

use console::Term;

/// Width without a terminal, columns.
const WIDTH: usize = 80;

/// Standard output.
pub struct Screen {
    term: Term,
    /// Lines of the text that is shown.
    shown: usize,
}

impl Default for Screen {
    fn default() -> Self {
        Self { term: Term::stdout(), shown: 0 }
    }
}

impl Screen {
    /// Whether it is a terminal, on which a text can be replaced.
    pub fn is_terminal(&self) -> bool {
        self.term.is_term()
    }

    /// Columns and lines of the terminal; without one 80 columns and any number of lines.
    pub fn size(&self) -> (usize, Option<usize>) {
        match self.term.size_checked().filter(|_| self.is_terminal()) {
            Some((lines, columns)) => (usize::from(columns), Some(usize::from(lines))),
            None => (WIDTH, None),
        }
    }

    /// Shows `text`; on a terminal instead of the text before.
    ///
    /// # Errors
    /// Standard output is closed.
    pub fn show(&mut self, text: &str) -> std::io::Result<()> {
        if self.is_terminal() && self.shown > 0 {
            self.term.clear_last_lines(self.shown)?;
        }
        self.shown = text.lines().count();
        let mut out = std::io::stdout();
        writeln!(out, "{text}")?;
        out.flush()
    }
}
