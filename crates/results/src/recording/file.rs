//! Frames on disk.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

use serde::Serialize;
use serde::de::DeserializeOwned;

use super::pack::{PackError, Packed, pack, unpack};
use super::{Channel, Event, Header};

/// First bytes of a file.
pub const MAGIC: [u8; 8] = *b"ripsrec2";
/// No frame is longer.
const LONGEST: u32 = 1 << 30;
/// Nodes, faces and grid nodes that a header may claim.
const MOST: u64 = 1 << 27;

/// A recording that cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file.
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
    #[error("{} is no recording of this version: record again with `ripstop run --record`", .0.display())]
    Foreign(PathBuf),
    /// Damaged.
    #[error("{} is damaged at byte {at}: {why}; what comes before it can be used", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Where the frame begins.
        at: u64,
        /// What was seen.
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
    /// Bytes so far.
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

    /// Goes on with a file after its first `windows` windows; what follows them is cut off.
    ///
    /// # Errors
    /// [`RecordingError`]: a file that does not hold them.
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

    /// Writes what is still in memory.
    ///
    /// # Errors
    /// [`RecordingError::File`].
    pub fn flush(&mut self) -> Result<(), RecordingError> {
        self.file.flush().map_err(|source| self.bad(source))
    }

    fn frame(&mut self, content: &impl Serialize) -> Result<(), RecordingError> {
        let bytes = bincode::serde::encode_to_vec(content, bincode::config::standard())
            .map_err(|e| self.bad(std::io::Error::other(e)))?;
        let length = u32::try_from(bytes.len()).ok().filter(|n| *n <= LONGEST);
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
        if [header.canopy.0, header.canopy.1, header.grid_nodes].iter().any(|n| *n > MOST) {
            return Err(
                reader.damaged(8, format!("its header claims {:?} canopy nodes and faces", header.canopy))
            );
        }
        reader.header = header;
        Ok(reader)
    }

    /// What it is of.
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

    /// Passes over so many windows.
    ///
    /// # Errors
    /// [`RecordingError::Damaged`], also for a file that holds fewer.
    pub fn skip_windows(&mut self, windows: u64) -> Result<(), RecordingError> {
        let mut done = 0;
        while done < windows {
            match self.next_event()? {
                Some(event) => done += u64::from(matches!(event, Event::Accept { .. })),
                None => return Err(self.damaged(self.at, format!("it holds {done} windows of {windows}"))),
            }
        }
        Ok(())
    }

    /// Numbers of a channel's arrays.
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
            return Err(self.damaged(at, "it ends within a frame: the run was killed".into()));
        }
        self.take(&mut head)?;
        let [a, b, c, d, ..] = head;
        let length = u32::from_le_bytes([a, b, c, d]);
        if length > LONGEST || u64::from(length) > self.left {
            return Err(self.damaged(at, "it ends within a frame: the run was killed".into()));
        }
        let mut bytes = vec![0; length as usize];
        self.take(&mut bytes)?;
        let [.., a, b, c, d] = head;
        if crc32fast::hash(&bytes) != u32::from_le_bytes([a, b, c, d]) {
            return Err(self.damaged(at, "its checksum is wrong".into()));
        }
        match decoded(&bytes) {
            Ok((content, used)) if used == bytes.len() => Ok(Some(content)),
            Ok(_) => Err(self.damaged(at, "a frame is longer than its content".into())),
            Err(e) => Err(self.damaged(at, e.to_string())),
        }
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

/// Decodes a frame. A length within it is only a claim, for which a string takes memory at once: no more than eight times the
/// frame, by steps because the limit is a constant.
fn decoded<T: DeserializeOwned>(bytes: &[u8]) -> Result<(T, usize), bincode::error::DecodeError> {
    fn within<T: DeserializeOwned, const LIMIT: usize>(
        bytes: &[u8],
    ) -> Result<(T, usize), bincode::error::DecodeError> {
        bincode::serde::decode_from_slice(bytes, bincode::config::standard().with_limit::<LIMIT>())
    }
    match bytes.len().next_power_of_two().trailing_zeros() {
        0..=18 => within::<T, { 1 << 22 }>(bytes),
        19..=21 => within::<T, { 1 << 24 }>(bytes),
        22..=24 => within::<T, { 1 << 27 }>(bytes),
        25..=27 => within::<T, { 1 << 30 }>(bytes),
        _ => within::<T, { 1 << 31 }>(bytes),
    }
}

#[cfg(test)]
mod tests {
    use bincode::error::DecodeError;

    use super::decoded;

    /// A million damaged recordings had one whose string claimed 125 MB within 3 kB.
    #[test]
    fn a_length_beyond_the_frame_takes_no_memory() {
        let config = bincode::config::standard();
        let mut claim = bincode::serde::encode_to_vec(1u64 << 27, config).expect("a number");
        claim.resize(3000, b'x');
        let refused = decoded::<String>(&claim).expect_err("a claim");
        assert!(matches!(refused, DecodeError::LimitExceeded), "{refused}");
        // What is small when encoded is still read: a byte for each of these numbers of eight.
        for count in [10usize, 200_000, 300_000, 3_000_000] {
            let zeros = bincode::serde::encode_to_vec(vec![0u64; count], config).expect("numbers");
            let (read, used) = decoded::<Vec<u64>>(&zeros).expect("within the limit");
            assert!(read.len() == count && used == zeros.len(), "{count}");
        }
    }
}
