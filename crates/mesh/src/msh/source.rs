//! Reader of words and bytes of a Gmsh file, with their location for messages.

use std::path::Path;
use std::str::FromStr;

use crate::MeshError;

/// Order of the bytes of a binary file, or text.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Text,
    Little,
    Big,
}

pub(super) struct Source<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
    /// Where the last word or number began.
    last: usize,
    kind: Kind,
}

impl<'a> Source<'a> {
    pub fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Source { path, bytes, at: 0, last: 0, kind: Kind::Text }
    }

    pub fn error(&self, reason: impl std::fmt::Display) -> MeshError {
        let place = if self.kind == Kind::Text {
            // The end of the file belongs to its last line.
            let before = &self.bytes[..self.last.min(self.bytes.trim_ascii_end().len())];
            format!("line {}", 1 + before.iter().filter(|b| **b == b'\n').count())
        } else {
            format!("byte {}", self.last)
        };
        MeshError::File { path: self.path.into(), reason: format!("{place}: {reason}") }
    }

    fn space(&mut self) {
        while self.bytes.get(self.at).is_some_and(u8::is_ascii_whitespace) {
            self.at += 1;
        }
    }

    /// Whether only white space is left.
    pub fn at_end(&mut self) -> bool {
        self.space();
        self.at >= self.bytes.len()
    }

    /// The next word of text; a quoted one without its quotes.
    pub fn word(&mut self, what: &str) -> Result<&'a str, MeshError> {
        self.space();
        self.last = self.at;
        let rest = &self.bytes[self.at..];
        if rest.is_empty() {
            return Err(self.error(format!("the file ends where {what} should be")));
        }
        let (from, length) = match rest.strip_prefix(b"\"") {
            Some(name) => (1, name.iter().position(|b| *b == b'"').unwrap_or(name.len())),
            None => (0, rest.iter().position(u8::is_ascii_whitespace).unwrap_or(rest.len())),
        };
        self.at = (self.at + length + 2 * from).min(self.bytes.len());
        std::str::from_utf8(&rest[from..from + length])
            .map_err(|_| self.error(format!("no text where {what} should be")))
    }

    /// The next word as a number.
    pub fn number<T: FromStr>(&mut self, what: &str) -> Result<T, MeshError> {
        let word = self.word(what)?;
        word.parse().map_err(|_| self.error(format!("\"{word}\" is not {what}")))
    }

    /// From here on data is binary: reads the integer 1 that marks the byte order.
    pub fn turn_binary(&mut self) -> Result<(), MeshError> {
        self.kind = Kind::Little;
        self.start_data();
        let one: [u8; 4] = self.take("the byte-order mark")?;
        self.kind = match (i32::from_le_bytes(one), i32::from_be_bytes(one)) {
            (1, _) => Kind::Little,
            (_, 1) => Kind::Big,
            _ => return Err(self.error("the byte-order mark of the binary file is not 1")),
        };
        Ok(())
    }

    /// Passes the end of the line that begins a section of data.
    pub fn start_data(&mut self) {
        if self.kind != Kind::Text {
            while self.bytes.get(self.at).is_some_and(|b| b" \r".contains(b)) {
                self.at += 1;
            }
            if self.bytes.get(self.at) == Some(&b'\n') {
                self.at += 1;
            }
        }
    }

    fn take<const W: usize>(&mut self, what: &str) -> Result<[u8; W], MeshError> {
        self.last = self.at;
        match self.bytes[self.at..].first_chunk::<W>() {
            Some(bytes) => {
                self.at += W;
                Ok(*bytes)
            }
            None => Err(self.error(format!("the file ends where {what} should be"))),
        }
    }

    /// An `int`: tags of entities, dimensions, types.
    pub fn int(&mut self, what: &str) -> Result<i64, MeshError> {
        Ok(match self.kind {
            Kind::Text => self.number(what)?,
            Kind::Little => i32::from_le_bytes(self.take(what)?).into(),
            Kind::Big => i32::from_be_bytes(self.take(what)?).into(),
        })
    }

    /// A `size_t`: counts, tags of nodes and elements.
    pub fn size(&mut self, what: &str) -> Result<u64, MeshError> {
        match self.kind {
            Kind::Text => self.number(what),
            Kind::Little => Ok(u64::from_le_bytes(self.take(what)?)),
            Kind::Big => Ok(u64::from_be_bytes(self.take(what)?)),
        }
    }

    /// A `double`.
    pub fn real(&mut self, what: &str) -> Result<f64, MeshError> {
        match self.kind {
            Kind::Text => self.number(what),
            Kind::Little => Ok(f64::from_le_bytes(self.take(what)?)),
            Kind::Big => Ok(f64::from_be_bytes(self.take(what)?)),
        }
    }

    /// Passes the end of a section.
    pub fn end(&mut self, section: &str) -> Result<(), MeshError> {
        let word = self.word("the end of a section")?;
        if word.strip_prefix("$End") == section.strip_prefix('$') {
            return Ok(());
        }
        Err(self.error(format!("\"{word}\" where the section {section} should end")))
    }

    /// Passes a whole section.
    pub fn skip(&mut self, section: &str) -> Result<(), MeshError> {
        let end = format!("$End{}", section.trim_start_matches('$'));
        let found = self.bytes[self.at..].windows(end.len()).position(|w| w == end.as_bytes());
        match found {
            Some(offset) => {
                self.at += offset + end.len();
                Ok(())
            }
            None => Err(self.error(format!("the section {section} does not end"))),
        }
    }
}
