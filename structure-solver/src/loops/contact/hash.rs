//! Hash maps whose keys are a few integers: cells, nodes, pairs of edges.

use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// A map with a multiplicative hash: keys come from the mesh, so that nothing has to resist chosen collisions. The order of entries has no
/// influence on results.
pub(super) type Map<K, V> = HashMap<K, V, BuildHasherDefault<Multiplicative>>;

/// Rotation, exclusive or and multiplication for each word (the hash of the Rust compiler).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Multiplicative(u64);

impl Multiplicative {
    #[inline(always)]
    fn add(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x517c_c1b7_2722_0a95);
    }
}

impl Hasher for Multiplicative {
    #[inline]
    fn write(&mut self, bytes: &[u8]) {
        for part in bytes.chunks(4) {
            let mut word = [0; 4];
            word[..part.len()].copy_from_slice(part);
            self.add(u64::from(u32::from_le_bytes(word)));
        }
    }

    #[inline]
    fn write_u32(&mut self, word: u32) {
        self.add(u64::from(word));
    }

    #[inline]
    fn write_usize(&mut self, word: usize) {
        self.add(word as u64);
    }

    #[inline]
    fn finish(&self) -> u64 {
        // A map chooses by the low bits, which the multiplication mixes least.
        self.0.rotate_left(26)
    }
}
