//! Hashes that are part of files and of the contract: their values never change.

const OFFSET: u64 = 0xcbf2_9ce4_8422_2325;
const PRIME: u64 = 0x0000_0100_0000_01b3;

/// 64-bit FNV-1a of bytes: names of sessions, faces of the interface, the canopy's shape (`docs/reference/contract.md`).
pub fn fnv1a(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(OFFSET, |h, b| (h ^ u64::from(b)).wrapping_mul(PRIME))
}

/// [`fnv1a`] of the little-endian bytes of numbers.
pub fn fnv1a_of_numbers<'a>(values: impl IntoIterator<Item = &'a f64>) -> u64 {
    fnv1a(values.into_iter().flat_map(|v| v.to_le_bytes()))
}

/// Checksum of an archive: FNV-1a over words of eight bytes, the last padded with zeros, and the length. It needs an
/// eighth of the operations of [`fnv1a`].
pub fn checksum(bytes: &[u8]) -> u64 {
    let mut sum = Checksum::default();
    sum.add(bytes);
    sum.value()
}

/// [`checksum`] of bytes that come in parts.
#[derive(Clone, Debug)]
pub struct Checksum {
    hash: u64,
    /// Bytes of the word that is not complete.
    rest: [u8; 8],
    length: usize,
}

impl Default for Checksum {
    fn default() -> Self {
        Self { hash: OFFSET, rest: [0; 8], length: 0 }
    }
}

impl Checksum {
    /// A product moves bits upwards only: the rotation moves the highest ones down.
    fn mix(hash: u64, word: u64) -> u64 {
        (hash ^ word).wrapping_mul(PRIME).rotate_left(29)
    }

    /// Adds the next bytes.
    pub fn add(&mut self, mut bytes: &[u8]) {
        let filled = self.length % 8;
        self.length += bytes.len();
        if filled > 0 {
            let (first, others) = bytes.split_at(bytes.len().min(8 - filled));
            self.rest[filled..filled + first.len()].copy_from_slice(first);
            if filled + first.len() < 8 {
                return;
            }
            self.hash = Self::mix(self.hash, u64::from_le_bytes(self.rest));
            bytes = others;
        }
        let (words, rest) = bytes.as_chunks::<8>();
        self.hash = words.iter().fold(self.hash, |hash, word| Self::mix(hash, u64::from_le_bytes(*word)));
        self.rest = [0; 8];
        self.rest[..rest.len()].copy_from_slice(rest);
    }

    /// Number of bytes so far.
    pub fn length(&self) -> usize {
        self.length
    }

    /// The checksum of the bytes so far.
    pub fn value(&self) -> u64 {
        Self::mix(Self::mix(self.hash, u64::from_le_bytes(self.rest)), self.length as u64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fnv1a_matches_published_values() {
        assert_eq!(fnv1a(*b""), 0xcbf2_9ce4_8422_2325);
        assert_eq!(fnv1a(*b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a(*b"foobar"), 0x8594_4171_f739_67e8);
        assert_eq!(
            fnv1a_of_numbers(&[1.0, -0.0]),
            fnv1a([0, 0, 0, 0, 0, 0, 0xf0, 0x3f, 0, 0, 0, 0, 0, 0, 0, 0x80])
        );
    }

    #[test]
    fn single_bit_changes_alter_the_checksum() {
        let bytes: Vec<u8> = (0..100u8).collect();
        let whole = checksum(&bytes);
        for bit in 0..800 {
            let mut bytes = bytes.clone();
            bytes[bit / 8] ^= 1 << (bit % 8);
            assert_ne!(checksum(&bytes), whole);
        }
        assert_ne!(checksum(&[0; 7]), checksum(&[0; 8]));
    }

    /// Files of earlier builds stay valid.
    #[test]
    fn checksum_is_that_of_words_and_length_however_the_bytes_come() {
        let bytes: Vec<u8> = (0..100u8).map(|b| b.wrapping_mul(37)).collect();
        let mix = |h: u64, w: u64| (h ^ w).wrapping_mul(PRIME).rotate_left(29);
        for length in [0, 1, 7, 8, 9, 16, 99, 100] {
            let bytes = &bytes[..length];
            let mut words: Vec<u64> =
                bytes.as_chunks::<8>().0.iter().map(|w| u64::from_le_bytes(*w)).collect();
            let mut last = [0; 8];
            last[..length % 8].copy_from_slice(bytes.as_chunks::<8>().1);
            words.push(u64::from_le_bytes(last));
            let expected = mix(words.into_iter().fold(OFFSET, mix), length as u64);
            assert_eq!(checksum(bytes), expected, "{length}");
            for part in [1, 3, 5, 8, 13] {
                let mut sum = Checksum::default();
                bytes.chunks(part).for_each(|bytes| sum.add(bytes));
                assert_eq!((sum.value(), sum.length()), (expected, length), "{length} in parts of {part}");
            }
        }
    }
}
