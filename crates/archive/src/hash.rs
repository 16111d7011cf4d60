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
    let (words, rest) = bytes.as_chunks::<8>();
    let mut last = [0; 8];
    last[..rest.len()].copy_from_slice(rest);
    // A product moves bits upwards only: the rotation moves the highest ones down.
    let mix = |h: u64, w: u64| (h ^ w).wrapping_mul(PRIME).rotate_left(29);
    let words = words.iter().chain(std::iter::once(&last)).map(|w| u64::from_le_bytes(*w));
    mix(words.fold(OFFSET, mix), bytes.len() as u64)
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
}
