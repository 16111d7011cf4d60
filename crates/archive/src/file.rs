//! Archives on disk.

use std::fs;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::codec::{DecodeError, fixed};
use crate::hash::{Checksum, checksum};

/// Length of the head, bytes.
pub const HEAD: usize = 8 + 4 + 8 + 8;

/// A file that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An error of the system: no such file, a full disk.
    #[error("cannot {action} {}: {source}", path.display())]
    Io {
        /// read or write
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: io::Error,
    },
    /// The file is of another kind.
    #[error("{} is not of the kind `{}`, it begins with `{}`; rerun the stage that writes it",
        path.display(), expected.escape_ascii(), found.escape_ascii())]
    Kind {
        /// The file.
        path: PathBuf,
        /// Expected kind.
        expected: [u8; 8],
        /// First bytes of the file, at most eight.
        found: Vec<u8>,
    },
    /// The file is of another version of this kind.
    #[error("{} has version {found}, this program reads version {expected}; rerun the stage that writes it",
        path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Expected version.
        expected: u32,
        /// Version of the file.
        found: u32,
    },
    /// Bytes are missing or changed.
    #[error("{} is damaged ({reason}); rerun the stage that writes it", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was expected and what was found.
        reason: String,
    },
    /// The file is complete, but its value does not match the scene or program.
    #[error("{} cannot be used: {reason}; rerun the stage that writes it", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What does not match.
        reason: String,
    },
}

impl Error {
    /// The error that the value of the file at `path` cannot be used, because of `reason`.
    pub fn content(path: &Path, reason: impl ToString) -> Self {
        Self::Content { path: path.into(), reason: reason.to_string() }
    }

    /// Whether there is no such file.
    pub fn is_missing(&self) -> bool {
        matches!(self, Self::Io { source, .. } if source.kind() == io::ErrorKind::NotFound)
    }
}

/// Writes `parts` in sequence as the file `path`; creates missing folders. The write is atomic: the file is the old
/// one or the new one in any case, because a temporary file is written, synced and renamed.
///
/// # Errors
/// The system's error; no part of the new file remains.
pub fn write_whole(path: &Path, parts: &[&[u8]]) -> io::Result<()> {
    write_aside(path, |file| parts.iter().try_for_each(|part| file.write_all(part)))
}

/// [`write_whole`] with what `write` writes.
fn write_aside(path: &Path, write: impl FnOnce(&mut fs::File) -> io::Result<()>) -> io::Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder)?;
    }
    let aside = path.with_extension("part");
    let whole = || {
        let mut file = fs::File::create(&aside)?;
        write(&mut file)?;
        file.sync_all()?;
        fs::rename(&aside, path)
    };
    whole().inspect_err(|_| {
        // A partial file would only fill the disk further.
        let _ = fs::remove_file(&aside);
    })
}

/// Writes `value` as an archive of `kind`. Returns the size of the file, bytes.
///
/// # Errors
/// [`Error::Io`]; the file is then unchanged or absent.
///
/// # Examples
///
/// ```
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("motion.bin");
/// archive::save(&path, *b"examplev", 1, &vec![0.0, 1.5])?;
/// assert_eq!(archive::load::<Vec<f64>>(&path, *b"examplev", 1)?, [0.0, 1.5]);
///
/// // A file of another version is refused with a remedy.
/// let error = archive::load::<Vec<f64>>(&path, *b"examplev", 2).unwrap_err();
/// assert!(error.to_string().contains("has version 1, this program reads version 2"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn save(path: &Path, kind: [u8; 8], version: u32, value: &impl Serialize) -> Result<u64, Error> {
    let mut length = 0;
    let written = write_aside(path, |file| {
        // The head follows when its checksum is known.
        let sum = {
            let mut content =
                Body { file: BufWriter::with_capacity(1 << 18, &mut *file), sum: Checksum::default() };
            content.file.write_all(&[0; HEAD])?;
            fixed::write(value, &mut content)?;
            content.flush()?;
            content.sum.clone()
        };
        length = sum.length();
        let mut head = Vec::with_capacity(HEAD);
        head.extend(kind);
        head.extend(version.to_le_bytes());
        head.extend((length as u64).to_le_bytes());
        head.extend(sum.value().to_le_bytes());
        file.rewind()?;
        file.write_all(&head)
    });
    written.map_err(|source| Error::Io { action: "write", path: path.into(), source })?;
    Ok((HEAD + length) as u64)
}

/// The content of an archive while it is written: no array has all of it.
struct Body<W: Write> {
    file: BufWriter<W>,
    sum: Checksum,
}

impl<W: Write> Write for Body<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.sum.add(&bytes[..written]);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Reads a file written by [`save`]. Allocates memory in proportion to the file, whatever length it claims.
///
/// # Errors
/// [`Error`]: no such file, another kind or version, damage.
pub fn load<T: DeserializeOwned>(path: &Path, kind: [u8; 8], version: u32) -> Result<T, Error> {
    load_or_earlier(path, kind, version, |_| None)
}

/// As [`load`], for a kind with an older layout without the head of an archive: `earlier` reads the bytes of such a
/// file, and returns `None` for all others.
///
/// # Errors
/// As of [`load`].
pub fn load_or_earlier<T: DeserializeOwned>(
    path: &Path,
    kind: [u8; 8],
    version: u32,
    earlier: impl FnOnce(&[u8]) -> Option<T>,
) -> Result<T, Error> {
    let bytes = fs::read(path).map_err(|source| Error::Io { action: "read", path: path.into(), source })?;
    value_of(path, &bytes, kind, version).or_else(|error| earlier(&bytes).ok_or(error))
}

/// The loaded value; `None` where there is no such file.
///
/// # Errors
/// All other errors of `loaded`.
pub fn if_present<T>(loaded: Result<T, Error>) -> Result<Option<T>, Error> {
    match loaded {
        Err(e) if e.is_missing() => Ok(None),
        other => other.map(Some),
    }
}

/// The value of the archive `bytes`.
fn value_of<T: DeserializeOwned>(path: &Path, bytes: &[u8], kind: [u8; 8], version: u32) -> Result<T, Error> {
    let damaged = |reason: String| Error::Damaged { path: path.into(), reason };
    let found = &bytes[..bytes.len().min(8)];
    // A file truncated within its kind counts as damaged.
    if !kind.starts_with(found) {
        return Err(Error::Kind { path: path.into(), expected: kind, found: found.into() });
    }
    let Some((head, value)) = bytes.split_at_checked(HEAD) else {
        return Err(damaged(format!("it ends within its head, {} bytes of {HEAD}", bytes.len())));
    };
    let number = |at: usize| u64::from_le_bytes(head[at..at + 8].try_into().expect("eight bytes"));
    let found = number(8) as u32;
    if found != version {
        return Err(Error::Version { path: path.into(), expected: version, found });
    }
    let (length, sum) = (number(12), number(20));
    if length != value.len() as u64 {
        return Err(damaged(format!("it holds {} bytes of {length}", value.len())));
    }
    if sum != checksum(value) {
        return Err(damaged("its checksum does not match".into()));
    }
    fixed::decode(value).map_err(|e: DecodeError| Error::content(path, e))
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: [u8; 8] = *b"riptest\0";

    type Value = (Vec<f64>, Option<u32>, String);

    #[test]
    fn value_is_restored_completely_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("deep/x.bin");
        let value = (vec![1.5, -0.0, f64::MIN_POSITIVE], Some(7u32), "text".to_owned());
        let bytes = save(&path, KIND, 3, &value).expect("written");
        assert_eq!(bytes, fs::metadata(&path).expect("a file").len());
        assert!(!path.with_extension("part").exists());
        assert_eq!(load::<Value>(&path, KIND, 3).expect("read"), value);
        let refused = |kind, version| load::<Value>(&path, kind, version).expect_err("refused");
        let kind = refused(*b"another\0", 3);
        assert!(
            kind.to_string().contains(r"not of the kind `another\x00`, it begins with `riptest\x00`"),
            "{kind}"
        );
        let version = refused(KIND, 4);
        assert!(version.to_string().contains("version 3, this program reads version 4"), "{version}");
        let whole = fs::read(&path).expect("bytes");
        for at in [13, 21, HEAD + 1, HEAD + 9, whole.len() - 1] {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x80;
            fs::write(&path, &bytes).expect("written");
            assert!(refused(KIND, 3).to_string().contains("damaged"), "byte {at}");
        }
        for length in [0, 5, HEAD, whole.len() - 1] {
            fs::write(&path, &whole[..length]).expect("written");
            assert!(refused(KIND, 3).to_string().contains("damaged"), "{length} bytes");
        }
        assert!(matches!(refused(KIND, 3), Error::Damaged { .. }));
        fs::remove_file(&path).expect("removed");
        assert!(refused(KIND, 3).is_missing());
        assert!(matches!(if_present(load::<Value>(&path, KIND, 3)), Ok(None)));
    }

    #[test]
    fn empty_value_is_valid_and_remaining_bytes_are_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.bin");
        assert_eq!(save(&path, KIND, 3, &()).expect("written"), HEAD as u64);
        assert!(load::<()>(&path, KIND, 3).is_ok());
        assert_eq!(save(&path, KIND, 3, &(1u64, 2u64)).expect("written"), HEAD as u64 + 16);
        let error = load::<u64>(&path, KIND, 3).expect_err("half of it");
        assert!(error.to_string().contains("longer than its content"), "{error}");
        assert_eq!(load::<(u64, u64)>(&path, KIND, 3).expect("read"), (1, 2));
    }

    #[test]
    fn older_layout_is_read_by_its_reader() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.bin");
        let earlier = |bytes: &[u8]| bytes.strip_prefix(b"old")?.first().map(|b| u64::from(*b));
        fs::write(&path, b"old\x07").expect("written");
        assert_eq!(load_or_earlier(&path, KIND, 3, earlier).expect("read"), 7);
        assert!(matches!(load::<u64>(&path, KIND, 3), Err(Error::Kind { .. })));
        save(&path, KIND, 3, &9u64).expect("written");
        assert_eq!(load_or_earlier(&path, KIND, 3, earlier).expect("read"), 9);
    }

    #[test]
    fn failed_write_leaves_no_file() {
        let folder = tempfile::tempdir().expect("a folder");
        // A folder cannot be replaced by a file.
        let path = folder.path().join("x");
        fs::create_dir_all(path.join("inside")).expect("a folder");
        assert!(matches!(save(&path, KIND, 3, &1u64), Err(Error::Io { action: "write", .. })));
        assert!(!folder.path().join("x.part").exists());
    }
}
