//! What is wrong with a scene: where, what is allowed, and what was probably meant.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Everything that is wrong with a scene file.
#[derive(Debug)]
pub struct SceneError {
    /// The file as the user named it.
    pub file: PathBuf,
    /// At least one problem, in file order.
    pub problems: Vec<Problem>,
    source: String,
}

/// One thing that is wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct Problem {
    /// Bytes of the file that it concerns, where there are any.
    pub at: Option<Range<usize>>,
    /// The value and why it is refused.
    pub what: String,
    /// What to do.
    pub help: String,
}

impl Problem {
    pub(crate) fn new(at: Option<Range<usize>>, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self { at, what: what.into(), help: help.into() }
    }
}

impl SceneError {
    pub(crate) fn new(file: &Path, source: &str, mut problems: Vec<Problem>) -> Self {
        problems.sort_by_key(|p| p.at.as_ref().map_or(usize::MAX, |r| r.start));
        Self { file: file.to_path_buf(), problems, source: source.to_owned() }
    }

    pub(crate) fn plain(file: &Path, what: impl Into<String>, help: impl Into<String>) -> Self {
        Self::new(file, "", vec![Problem::new(None, what, help)])
    }
}

/// Line and column of a byte of `source`, both from 1.
pub(crate) fn line_and_column(source: &str, byte: usize) -> (usize, usize) {
    let before = &source[..byte.min(source.len())];
    let line = before.matches('\n').count() + 1;
    let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) + 1;
    (line, column)
}

impl fmt::Display for SceneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = self.file.display();
        for (i, problem) in self.problems.iter().enumerate() {
            if i > 0 {
                writeln!(f)?;
            }
            match &problem.at {
                Some(at) => {
                    let (line, column) = line_and_column(&self.source, at.start);
                    writeln!(f, "{file}:{line}:{column}: {}", problem.what)?;
                    let text = self.source.lines().nth(line - 1).unwrap_or("");
                    let number = line.to_string();
                    let room = text.chars().count().saturating_sub(column - 1).max(1);
                    let marks = self.source[at.start..at.end.min(self.source.len())].chars().count();
                    writeln!(f, "  {number} | {text}")?;
                    writeln!(
                        f,
                        "  {:pad$} | {:lead$}{}",
                        "",
                        "",
                        "^".repeat(marks.clamp(1, room)),
                        pad = number.len(),
                        lead = column - 1
                    )?;
                }
                None => writeln!(f, "{file}: {}", problem.what)?,
            }
            write!(f, "  {}", problem.help)?;
        }
        Ok(())
    }
}

impl std::error::Error for SceneError {}

/// The nearest of `allowed` to what was written, if it is near enough to be a slip.
pub(crate) fn nearest<'a>(written: &str, allowed: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    allowed
        .into_iter()
        .map(|a| (strsim::damerau_levenshtein(written, a), a))
        .min_by_key(|&(d, _)| d)
        .filter(|&(d, a)| d <= 2.max(a.len() / 3))
        .map(|(_, a)| a)
}
