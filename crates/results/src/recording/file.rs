//! The file format of recordings.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use archive::codec::compact;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::pack::{PackError, Packed, pack, unpack};
use super::{Channel, Event, Header};

/// First bytes of a file.
pub const MAGIC: [u8; 8] = *b"ripsrec3";
/// Maximum length of a frame, bytes.
const MAX_FRAME: u32 = 1 << 30;
/// Maximum number of nodes, faces and grid nodes in a header.
const MAX_NODES: u64 = 1 << 27;

/// A recording that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be accessed.
    #[error("cannot {action} {}: {source}", .path.display())]
    File {
        /// read, write, create
        action: &'static str,
        /// The file.
        path: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// Not a recording.
    #[error("{} is not a recording of this version. Record again with `ripstop run --record`", .0.display())]
    Foreign(PathBuf),
    /// Damaged.
    #[error("{} is damaged at byte {at}: {why}. The windows before it can be used", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Offset of the frame, bytes.
        at: u64,
        /// Reason.
        why: String,
    },
}

/// Last array of each channel, as bits.
type Last = [Vec<u64>; 5];

/// Writes the exchanges of a stage.
pub struct Writer {
    file: BufWriter<File>,
    path: PathBuf,
    last: Last,
    /// Size so far, bytes.
    pub bytes: u64,
}

impl Writer {
    /// Creates the file and the folder it is in.
    ///
    /// # Errors
    /// [`RecordingError::File`].
    pub fn create(path: &Path, header: &Header) -> Result<Self, RecordingError> {
        let bad = |source| RecordingError::File { action: "create", path: path.into(), source };
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).map_err(bad)?;
        }
        let file = BufWriter::with_capacity(1 << 20, File::create(path).map_err(bad)?);
        let mut writer = Self { file, path: path.into(), last: Last::default(), bytes: 0 };
        writer.write(&MAGIC)?;
        writer.frame(header)?;
        Ok(writer)
    }

    /// Truncates a file to its first `windows` windows and appends to it.
    ///
    /// # Errors
    /// [`RecordingError`]: the file contains fewer windows.
    pub fn resume(path: &Path, windows: u64) -> Result<Self, RecordingError> {
        let mut reader = Reader::open(path)?;
        reader.skip_windows(windows)?;
        let bad = |source| RecordingError::File { action: "write", path: path.into(), source };
        let file = File::options().append(true).open(path).map_err(bad)?;
        file.set_len(reader.at).map_err(bad)?;
        let file = BufWriter::with_capacity(1 << 20, file);
        Ok(Self { file, path: path.into(), last: reader.last, bytes: reader.at })
    }

    /// Adds an exchange.
    ///
    /// # Errors
    /// [`RecordingError::File`].
    pub fn push(&mut self, event: Event<&[f64]>) -> Result<(), RecordingError> {
        let last = &mut self.last;
        let packed = event.map(|c, values| Ok::<_, RecordingError>(pack(values, &mut last[c as usize])))?;
        self.frame(&packed)
    }

    /// Flushes the buffer.
    ///
    /// # Errors
    /// [`RecordingError::File`].
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.file.flush().map_err(|source| self.bad(source))
    }

    fn frame(&mut self, content: &impl Serialize) -> Result<(), RecordingError> {
        let bytes = compact::encode(content);
        let length = u32::try_from(bytes.len()).ok().filter(|n| *n <= MAX_FRAME);
        let length = length.ok_or_else(|| self.bad(std::io::Error::other("a frame of over 1 GiB")))?;
        self.write(&length.to_le_bytes())?;
        self.write(&crc32fast::hash(&bytes).to_le_bytes())?;
        self.write(&bytes)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), RecordingError> {
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes).map_err(|source| self.bad(source))
    }

    fn bad(&self, source: std::io::Error) -> RecordingError {
        RecordingError::File { action: "write", path: self.path.clone(), source }
    }
}

/// Reads the exchanges of a stage.
///
/// # Examples
///
/// ```
/// use channel::{STATS, Window};
/// use results::recording::{Event, Header, Reader, Writer};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("exchange.rec");
/// let header = Header {
///     contract: channel::CONTRACT_VERSION,
///     version: "1.0.0".into(),
///     scene: "example".into(),
///     stage: ("descent".into(), 0),
///     canopy: (4, 1),
///     surface_hash: channel::surface_hash(&[[0, 1, 2, 3]]),
///     grid_nodes: 0,
///     ranks: [1; 3],
/// };
/// let at = (&Window::default()).into();
/// let mut writer = Writer::create(&path, &header)?;
/// writer.push(Event::Flow { at, load: &[12.0, 0.0, 0.0, 0.0][..], stats: [0.0; STATS] })?;
/// writer.push(Event::Accept { at })?;
/// writer.flush()?;
///
/// let mut reader = Reader::open(&path)?;
/// assert_eq!(reader.header().scene, "example");
/// let Some(Event::Flow { load, .. }) = reader.next_event()? else { panic!("a flow solve is first") };
/// assert_eq!(load, [12.0, 0.0, 0.0, 0.0]);
/// assert!(matches!(reader.next_event()?, Some(Event::Accept { .. })));
/// assert!(reader.next_event()?.is_none());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Reader {
    file: BufReader<File>,
    path: PathBuf,
    left: u64,
    at: u64,
    last: Last,
    header: Header,
}

impl Reader {
    /// Opens a file and reads its header.
    ///
    /// # Errors
    /// [`RecordingError`].
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        let bad = |source| RecordingError::File { action: "read", path: path.into(), source };
        let file = File::open(path).map_err(bad)?;
        let left = file.metadata().map_err(bad)?.len();
        let empty = Header {
            contract: 0,
            version: String::new(),
            scene: String::new(),
            stage: (String::new(), 0),
            canopy: (0, 0),
            surface_hash: 0,
            grid_nodes: 0,
            ranks: [0; 3],
        };
        let mut reader = Self {
            file: BufReader::with_capacity(1 << 20, file),
            path: path.into(),
            left,
            at: 0,
            last: Last::default(),
            header: empty,
        };
        let mut magic = [0; 8];
        if left < 8 || reader.take(&mut magic).is_err() || magic != MAGIC {
            return Err(RecordingError::Foreign(path.into()));
        }
        let header: Header =
            reader.frame()?.ok_or_else(|| reader.damaged(8, "it ends before its header".into()))?;
        if [header.canopy.0, header.canopy.1, header.grid_nodes].iter().any(|n| *n > MAX_NODES) {
            return Err(reader.damaged(
                8,
                format!("its header has implausible numbers of canopy nodes and faces: {:?}", header.canopy),
            ));
        }
        reader.header = header;
        Ok(reader)
    }

    /// The header.
    pub fn header(&self) -> &Header {
        &self.header
    }

    /// The next exchange; `None` at the end.
    ///
    /// # Errors
    /// [`RecordingError::Damaged`], also for a file that ends within a frame.
    pub fn next_event(&mut self) -> Result<Option<Event<Vec<f64>>>, RecordingError> {
        let at = self.at;
        let Some(packed) = self.frame::<Event<Packed>>()? else { return Ok(None) };
        let sizes = Channel::ALL.map(|c| self.len(c));
        let last = &mut self.last;
        let event = packed.map(|c, a| unpack(&a, sizes[c as usize], &mut last[c as usize]));
        event.map(Some).map_err(|e: PackError| self.damaged(at, e.to_string()))
    }

    /// Skips `windows` windows.
    ///
    /// # Errors
    /// [`RecordingError::Damaged`], also for a file with fewer windows.
    pub fn skip_windows(&mut self, windows: u64) -> Result<(), RecordingError> {
        let mut done = 0;
        while done < windows {
            match self.next_event()? {
                Some(event) => done += u64::from(matches!(event, Event::Accept { .. })),
                None => return Err(self.damaged(self.at, format!("it contains {done} of {windows} windows"))),
            }
        }
        Ok(())
    }

    /// Length of the arrays of a channel.
    pub fn len(&self, c: Channel) -> usize {
        let (nodes, faces) = self.header.canopy;
        let rows = match c {
            Channel::StructureLoad | Channel::FlowLoad => faces,
            Channel::StructureDisplacement | Channel::MeshDisplacement => nodes,
            Channel::Grid => self.header.grid_nodes,
        };
        rows as usize * c.width()
    }

    fn frame<T: DeserializeOwned>(&mut self) -> Result<Option<T>, RecordingError> {
        let at = self.at;
        if self.left == 0 {
            return Ok(None);
        }
        let mut head = [0; 8];
        if self.left < 8 {
            return Err(
                self.damaged(at, "it ends within a frame, probably because the run was killed".into())
            );
        }
        self.take(&mut head)?;
        let [a, b, c, d, ..] = head;
        let length = u32::from_le_bytes([a, b, c, d]);
        if length > MAX_FRAME || u64::from(length) > self.left {
            return Err(
                self.damaged(at, "it ends within a frame, probably because the run was killed".into())
            );
        }
        let mut bytes = vec![0; length as usize];
        self.take(&mut bytes)?;
        let [.., a, b, c, d] = head;
        if crc32fast::hash(&bytes) != u32::from_le_bytes([a, b, c, d]) {
            return Err(self.damaged(at, "its checksum does not match".into()));
        }
        compact::decode(&bytes).map(Some).map_err(|e| self.damaged(at, format!("a frame: {e}")))
    }

    fn take(&mut self, bytes: &mut [u8]) -> Result<(), RecordingError> {
        self.file.read_exact(bytes).map_err(|source| RecordingError::File {
            action: "read",
            path: self.path.clone(),
            source,
        })?;
        self.left -= bytes.len() as u64;
        self.at += bytes.len() as u64;
        Ok(())
    }

    fn damaged(&self, at: u64, why: String) -> RecordingError {
        RecordingError::Damaged { path: self.path.clone(), at, why }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reference recordings of the regression test are of earlier versions.
    #[test]
    fn recordings_of_earlier_versions_are_readable() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/regression/implicit/reference");
        for stage in ["pre-inflation", "developed-flow", "descent"] {
            let mut reader = Reader::open(&folder.join(stage).join("exchange.rec")).expect("a recording");
            assert_eq!(reader.header().stage.0, stage);
            let mut windows = 0;
            while let Some(event) = reader.next_event().expect("whole frames") {
                windows += u64::from(matches!(event, Event::Accept { .. }));
            }
            assert!(windows > 0, "{stage}");
        }
    }
}
