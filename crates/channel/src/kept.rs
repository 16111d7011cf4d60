//! Files that keep what a run goes on from: written aside, synced and renamed, so that a
//! reader finds a whole file or none; read back only whole, by magic, version and checksum.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use case::Role;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// The effect that a program announces that can go on in the middle of a stage: it takes
/// `--resume FOLDER` and starts from what it wrote there on `Save`.
pub const RESUME: &str = "resume";

/// Effect of a structure that reports `SUPPORT_FORCE` and `VERTICAL_MOMENTUM`.
pub const SUPPORT_FORCE: &str = "descent.equation";

/// The effect that a program announces that takes the wind of a stage as `case::Scene::wind` gives it: winds
/// and gusts of single stages, and gusts whose clock runs through several.
pub const STAGE_WIND: &str = "stage.wind";

/// Bytes before the body: magic, version, length, checksum.
const HEAD: usize = 8 + 4 + 8 + 8;

/// A file that could not be written or used.
#[derive(Debug, thiserror::Error)]
pub enum KeptError {
    /// The system refused: no such file, a full disk.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file holds something else, or a part of it.
    #[error("{} {reason}", path.display())]
    Unfit {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

impl KeptError {
    /// The file at `path` holds what does not fit, because of `reason`.
    pub fn unfit(path: &Path, reason: &str) -> Self {
        Self::Unfit { path: path.into(), reason: format!("cannot be gone on from: {reason}") }
    }
}

/// Checksum of bytes: FNV-1a over words of eight of them, the last padded with zeros, and the length.
pub fn checksum(bytes: &[u8]) -> u64 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let (words, rest) = bytes.as_chunks::<8>();
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    // A product moves bits upwards only: the turn brings the highest back.
    let mix = |h: u64, w: u64| (h ^ w).wrapping_mul(PRIME).rotate_left(29);
    let words = words.iter().chain(std::iter::once(&last)).map(|w| u64::from_le_bytes(*w));
    mix(words.fold(0xcbf2_9ce4_8422_2325, mix), bytes.len() as u64)
}

/// Writes `value` as a file of the kind `magic`. Returns its bytes.
///
/// # Errors
/// [`KeptError`]; the file is then the old one, or there is none.
pub fn keep(path: &Path, magic: [u8; 8], version: u32, value: &impl Serialize) -> Result<u64, KeptError> {
    let io = |source| KeptError::Io { path: path.into(), source };
    let body = bincode::serde::encode_to_vec(value, config()).map_err(|e| io(std::io::Error::other(e)))?;
    let mut head = Vec::with_capacity(HEAD);
    head.extend(magic);
    head.extend(version.to_le_bytes());
    head.extend((body.len() as u64).to_le_bytes());
    head.extend(checksum(&body).to_le_bytes());
    let aside = path.with_extension("part");
    let write = || {
        let mut file = fs::File::create(&aside)?;
        file.write_all(&head)?;
        file.write_all(&body)?;
        file.sync_all()?;
        fs::rename(&aside, path)
    };
    write().map_err(|e| {
        // Half a file would only fill the disk further.
        let _ = fs::remove_file(&aside);
        io(e)
    })?;
    Ok((HEAD + body.len()) as u64)
}

/// Reads what [`keep`] wrote.
///
/// # Errors
/// [`KeptError`]: no such file, another kind or version, damage.
pub fn kept<T: DeserializeOwned>(path: &Path, magic: [u8; 8], version: u32) -> Result<T, KeptError> {
    let bytes = fs::read(path).map_err(|source| KeptError::Io { path: path.into(), source })?;
    let unfit = |reason: String| KeptError::Unfit { path: path.into(), reason };
    let word = |at: usize| bytes[at..at + 8].try_into().map(u64::from_le_bytes).unwrap_or(0);
    if bytes.len() < HEAD {
        return Err(unfit("is damaged (it ends within its head)".into()));
    }
    if bytes[..8] != magic {
        return Err(unfit("is of another kind".into()));
    }
    let found = bytes[8..12].try_into().map(u32::from_le_bytes).unwrap_or(0);
    if found != version {
        return Err(unfit(format!("has version {found}, this program reads {version}")));
    }
    let body = &bytes[HEAD..];
    if word(12) != body.len() as u64 || word(20) != checksum(body) {
        return Err(unfit("is damaged (its checksum does not match)".into()));
    }
    match bincode::serde::decode_from_slice(body, config()) {
        Ok((value, used)) if used == body.len() => Ok(value),
        Ok(_) => Err(unfit("is longer than its content".into())),
        Err(e) => Err(unfit(format!("cannot be decoded: {e}"))),
    }
}

fn config() -> impl bincode::config::Config {
    // Numbers of one width are written and read fastest. A length that makes no sense (of another
    // layout under the same version) must not reserve memory without end.
    bincode::config::standard().with_fixed_int_encoding().with_limit::<{ 1 << 36 }>()
}

/// File of what a rank remembers beside its share of the program's state: warm starts,
/// factors, all that changes the last digits and that another number of ranks has no use for.
pub fn memory_file(folder: &Path, role: Role, rank: usize, ranks: usize) -> PathBuf {
    folder.join(format!("{}-memory-{rank}-of-{ranks}.bin", role.name()))
}

/// What [`keep`] wrote as the [`memory_file`] of a rank, where `check` finds nothing wrong with it;
/// `None` where there is no such file: another number of ranks has written the state.
///
/// # Errors
/// [`KeptError`]: damage, another version, content that does not fit.
pub fn remembered<T: DeserializeOwned>(
    path: &Path,
    magic: [u8; 8],
    version: u32,
    check: impl FnOnce(&T) -> Result<(), String>,
) -> Result<Option<T>, KeptError> {
    if !path.exists() {
        return Ok(None);
    }
    let memory = kept(path, magic, version)?;
    check(&memory).map_err(|reason| KeptError::unfit(path, &reason))?;
    Ok(Some(memory))
}

/// From now on a file that grows beyond the limit of this process (`RLIMIT_FSIZE`) is an error
/// that can be told, and not its end.
pub fn bear_size_limit() {
    // SAFETY: sets a disposition of this process; no memory is involved.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
}

#[cfg(test)]
mod tests {
    use super::*;

    const KIND: [u8; 8] = *b"riptest\0";

    #[test]
    fn what_was_kept_comes_back_whole_or_not_at_all() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.bin");
        let value = (vec![1.5, -0.0, f64::MIN_POSITIVE], Some(7u32), "text".to_owned());
        let bytes = keep(&path, KIND, 3, &value).expect("written");
        assert_eq!(bytes, fs::metadata(&path).expect("a file").len());
        assert_eq!(kept::<(Vec<f64>, Option<u32>, String)>(&path, KIND, 3).expect("read"), value);
        let wrong = |kind, version| kept::<(Vec<f64>, Option<u32>, String)>(&path, kind, version);
        assert!(wrong(*b"another\0", 3).expect_err("kind").to_string().contains("another kind"));
        assert!(wrong(KIND, 4).expect_err("version").to_string().contains("version 3"));
        let whole = fs::read(&path).expect("bytes");
        for at in [HEAD + 1, HEAD + 9, whole.len() - 1, 13, 21] {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x80;
            fs::write(&path, &bytes).expect("written");
            assert!(wrong(KIND, 3).expect_err("damage").to_string().contains("damaged"), "byte {at}");
        }
        for length in [0, 5, HEAD, whole.len() - 1] {
            fs::write(&path, &whole[..length]).expect("written");
            assert!(wrong(KIND, 3).expect_err("a part").to_string().contains("damaged"), "{length} bytes");
        }
        assert!(matches!(wrong(KIND, 3), Err(KeptError::Unfit { .. })));
        fs::remove_file(&path).expect("removed");
        assert!(matches!(wrong(KIND, 3), Err(KeptError::Io { .. })));
    }

    #[test]
    fn single_bits_change_the_checksum() {
        let bytes: Vec<u8> = (0..100u8).collect();
        let whole = checksum(&bytes);
        for bit in 0..800 {
            let mut bytes = bytes.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert_ne!(checksum(&bytes), whole);
        }
        assert_ne!(checksum(&[0; 7]), checksum(&[0; 8]));
    }

    #[test]
    fn a_head_without_a_body_is_whole_and_a_longer_body_is_not() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("x.bin");
        assert_eq!(keep(&path, KIND, 3, &()).expect("written"), HEAD as u64);
        assert!(kept::<()>(&path, KIND, 3).is_ok());
        assert_eq!(keep(&path, KIND, 3, &(1u64, 2u64)).expect("written"), HEAD as u64 + 16);
        let error = kept::<u64>(&path, KIND, 3).expect_err("half of it");
        assert!(error.to_string().contains("longer than its content"), "{error}");
        assert_eq!(kept::<(u64, u64)>(&path, KIND, 3).expect("read"), (1, 2));
    }
}
