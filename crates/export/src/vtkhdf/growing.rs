//! A dataset that grows by rows, compressed chunk by chunk.

use rust_hdf5::{H5Dataset, H5Group, H5Type};

/// Compression level of deflate: higher ones save little of such data and take far longer.
const LEVEL: u32 = 4;
/// Most rows in a chunk.
const MOST_ROWS: usize = 32_768;
/// Fewest rows in a chunk.
const FEWEST_ROWS: usize = 64;

/// A number that HDF5 stores, little-endian.
pub(super) trait Number: H5Type + Copy {
    /// Appends its bytes.
    fn put(self, bytes: &mut Vec<u8>);
}

macro_rules! number {
    ($($t:ty),*) => {
        $(impl Number for $t {
            fn put(self, bytes: &mut Vec<u8>) {
                bytes.extend_from_slice(&self.to_le_bytes());
            }
        })*
    };
}
number!(f64, f32, u32, i64, u8);

/// A dataset of rows, of which full chunks are in the file and the rest waits.
pub(super) struct Growing {
    dataset: H5Dataset,
    /// Numbers in a row.
    width: usize,
    /// Bytes of a row, rows of a chunk.
    row: usize,
    chunk: usize,
    /// Bytes that wait, and chunks in the file.
    waiting: Vec<u8>,
    chunks: usize,
    /// Rows so far.
    rows: usize,
}

impl Growing {
    /// An empty dataset `name` of rows of `width` numbers. A width of 1 gives a dataset of one dimension. A chunk holds
    /// `rows` rows, within limits: where each step has as many, a step is a chunk.
    pub(super) fn new<T: Number>(
        group: &H5Group,
        name: &str,
        width: usize,
        rows: usize,
    ) -> rust_hdf5::Result<Self> {
        let chunk = rows.clamp(FEWEST_ROWS, MOST_ROWS);
        let builder = group.new_dataset::<T>().shuffle_deflate(LEVEL);
        let dataset = if width == 1 {
            builder.shape([0]).chunk(&[chunk]).max_shape(&[None]).create(name)?
        } else {
            builder.shape([0, width]).chunk(&[chunk, width]).max_shape(&[None, Some(width)]).create(name)?
        };
        let row = width * size_of::<T>();
        Ok(Self { dataset, width, row, chunk, waiting: Vec::new(), chunks: 0, rows: 0 })
    }

    /// Rows so far.
    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Appends rows.
    pub(super) fn append<T: Number>(&mut self, values: &[T]) -> rust_hdf5::Result<()> {
        for value in values {
            value.put(&mut self.waiting);
        }
        self.rows += values.len() / self.width;
        let bytes = self.chunk * self.row;
        let full = self.waiting.len() / bytes;
        for chunk in self.waiting.chunks_exact(bytes).take(full) {
            self.dataset.write_chunk(self.chunks, chunk)?;
            self.chunks += 1;
        }
        self.waiting.drain(..full * bytes);
        Ok(())
    }

    /// Writes what waits.
    pub(super) fn finish(mut self) -> rust_hdf5::Result<()> {
        if !self.waiting.is_empty() {
            self.waiting.resize(self.chunk * self.row, 0);
            self.dataset.write_chunk(self.chunks, &self.waiting)?;
        }
        let all = [self.rows, self.width];
        self.dataset.set_extent(if self.width == 1 { &all[..1] } else { &all })
    }
}
