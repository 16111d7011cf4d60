//! Lossless compression of arrays of doubles.

use serde::{Deserialize, Serialize};

/// A packed array.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Packed {
    /// Number of values.
    len: u64,
    /// LZ4 block of the sorted bytes.
    bytes: Vec<u8>,
}

/// An array that cannot be unpacked.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PackError {
    /// The length differs from that of the channel.
    #[error("an array has {found} values, but its channel has {wanted}")]
    Length {
        /// Stated number of values.
        found: u64,
        /// Number of values of the channel.
        wanted: u64,
    },
    /// The bytes are not a valid block.
    #[error("an array cannot be decompressed: {0}")]
    Bytes(String),
}

/// Packs the change of `values` from `before`, and stores `values` in `before`.
pub fn pack(values: &[f64], before: &mut Vec<u64>) -> Packed {
    let n = values.len();
    before.resize(n, 0);
    // Bytes sorted by significance: signs, exponents and high bytes of small changes compress well.
    let mut sorted = vec![0u8; 8 * n];
    for (i, (value, old)) in values.iter().zip(before).enumerate() {
        let bits = value.to_bits();
        let change = (bits ^ *old).to_be_bytes();
        *old = bits;
        for (k, byte) in change.into_iter().enumerate() {
            sorted[k * n + i] = byte;
        }
    }
    Packed { len: n as u64, bytes: lz4_flex::block::compress(&sorted) }
}

/// Unpacks `wanted` values from their change relative to `before`, and stores them in `before`.
///
/// # Errors
/// [`PackError`]; `before` is then unchanged.
pub fn unpack(packed: &Packed, wanted: usize, before: &mut Vec<u64>) -> Result<Vec<f64>, PackError> {
    if packed.len != wanted as u64 {
        return Err(PackError::Length { found: packed.len, wanted: wanted as u64 });
    }
    // A byte of a block expands to at most 255 bytes: refuses larger claims before memory is allocated.
    if 8 * wanted > 255 * packed.bytes.len() + 64 {
        return Err(PackError::Bytes(format!("{} bytes for {wanted} values", packed.bytes.len())));
    }
    let sorted = lz4_flex::block::decompress(&packed.bytes, 8 * wanted)
        .map_err(|e| PackError::Bytes(e.to_string()))?;
    if sorted.len() != 8 * wanted {
        return Err(PackError::Length { found: sorted.len() as u64 / 8, wanted: wanted as u64 });
    }
    before.resize(wanted, 0);
    let one = |(i, old): (usize, &mut u64)| {
        let change: [u8; 8] = std::array::from_fn(|k| sorted[k * wanted + i]);
        *old ^= u64::from_be_bytes(change);
        f64::from_bits(*old)
    };
    Ok(before.iter_mut().enumerate().map(one).collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn arrays_are_bitwise_preserved(
            series in prop::collection::vec(prop::collection::vec(any::<u64>(), 0..40), 1..5)
        ) {
            let (mut written, mut read) = (Vec::new(), Vec::new());
            for bits in series {
                let values: Vec<f64> = bits.iter().map(|b| f64::from_bits(*b)).collect();
                let packed = pack(&values, &mut written);
                let back = unpack(&packed, values.len(), &mut read).unwrap();
                prop_assert_eq!(back.iter().map(|v| v.to_bits()).collect::<Vec<_>>(), bits);
            }
        }

        #[test]
        fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), wanted in 0usize..64) {
            let packed = Packed { len: wanted as u64, bytes };
            if let Ok(values) = unpack(&packed, wanted, &mut Vec::new()) {
                prop_assert_eq!(values.len(), wanted);
            }
        }
    }

    #[test]
    fn small_changes_compress_well() {
        let grid = |t: f64| (0..6000).map(|i| (i as f64).sqrt() + 1e-6 * t).collect::<Vec<f64>>();
        let mut before = Vec::new();
        pack(&grid(0.0), &mut before);
        let packed = pack(&grid(1.0), &mut before);
        assert!(packed.bytes.len() < 6000 * 5, "{} bytes of {}", packed.bytes.len(), 6000 * 8);
    }
}
