//! Files from which a run continues.
//!
//! An archive is 28 bytes, then a value:
//!
//! | bytes | content |
//! |---|---|
//! | 0..8 | kind of the file, eight letters |
//! | 8..12 | version of the kind, `u32` |
//! | 12..20 | length of the value, bytes, `u64` |
//! | 20..28 | [`hash::checksum`] of the value, `u64` |
//! | 28.. | the value, as [`codec::fixed`] encodes it |
//!
//! Numbers are little-endian. [`save`] writes a temporary file, syncs and renames it, so a reader finds a complete
//! file or none; [`load`] returns the value only if kind, version, length and checksum are correct.

pub mod codec;
mod file;
pub mod hash;
pub mod shape;

pub use file::{Error, HEAD, if_present, load, load_or_earlier, save, write_whole};
