//! Encoding of values as bytes. No other crate of the project names bincode.

use std::io::{self, Write};

use bincode::config::standard;
use bincode::error::EncodeError;
use bincode::serde::{decode_from_slice, encode_into_std_write, encode_to_vec};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Bytes that do not encode the expected value.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// Not an encoded value of this type, or one that claims more memory than the bytes account for.
    #[error("its value cannot be decoded: {0}")]
    Content(#[from] bincode::error::DecodeError),
    /// Bytes remain after the value.
    #[error("it is longer than its content")]
    Longer,
}

/// Decodes `$bytes` in `$layout` with a memory limit that depends on their length: each `length => limit` (powers of
/// two, bytes) applies up to that length. A length within the bytes is only a claim, for which a string would
/// allocate memory at once. The limit is a constant of the layout, hence the steps.
macro_rules! decode_within {
    ($bytes:ident, $layout:expr, $($length:literal => $limit:literal,)* else $most:literal) => {{
        let length = $bytes.len().next_power_of_two().trailing_zeros();
        let (value, used) = match length {
            $(..=$length => decode_from_slice($bytes, $layout.with_limit::<{ 1 << $limit }>())?,)*
            _ => decode_from_slice($bytes, $layout.with_limit::<{ 1 << $most }>())?,
        };
        if used == $bytes.len() { Ok(value) } else { Err(DecodeError::Longer) }
    }};
}

/// Integers of full width: fastest for arrays.
pub mod fixed {
    use super::*;

    /// `value` as bytes.
    ///
    /// # Panics
    /// A `Serialize` that refuses its own value; plain data do not.
    pub fn encode(value: &impl Serialize) -> Vec<u8> {
        encode_to_vec(value, standard().with_fixed_int_encoding()).expect("plain data can be encoded")
    }

    /// Writes `value` as [`encode`] does, without an array of all bytes.
    ///
    /// # Errors
    /// Those of `writer`.
    ///
    /// # Panics
    /// As [`encode`].
    pub fn write(value: &impl Serialize, writer: &mut impl Write) -> io::Result<()> {
        match encode_into_std_write(value, writer, standard().with_fixed_int_encoding()) {
            Ok(_) => Ok(()),
            Err(EncodeError::Io { inner, .. }) => Err(inner),
            Err(error) => panic!("plain data can be encoded: {error}"),
        }
    }

    /// The value that [`encode`] encoded, from all of `bytes`.
    ///
    /// # Errors
    /// [`DecodeError`].
    pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
        // A value needs about as much memory as its bytes.
        decode_within!(bytes, standard().with_fixed_int_encoding(), 21 => 22, 27 => 28, else 40)
    }
}

/// Integers of variable length: recordings and the canopy's shape (`docs/reference/contract.md`).
pub mod compact {
    use super::*;

    /// `value` as bytes.
    ///
    /// # Panics
    /// A `Serialize` that refuses its own value; plain data do not.
    pub fn encode(value: &impl Serialize) -> Vec<u8> {
        encode_to_vec(value, standard()).expect("plain data can be encoded")
    }

    /// The value that [`encode`] encoded, from all of `bytes`.
    ///
    /// # Errors
    /// [`DecodeError`].
    pub fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, DecodeError> {
        // An integer of eight bytes may be encoded in one: a value needs up to eight times the memory of its bytes.
        decode_within!(bytes, standard(), 18 => 22, 21 => 24, 24 => 27, 27 => 30, else 40)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Found by random damage of recordings: a string that claimed 125 MB within 3 kB.
    #[test]
    fn length_beyond_the_bytes_allocates_no_memory() {
        let mut claim = compact::encode(&(1u64 << 27));
        claim.resize(3000, b'x');
        let refused = compact::decode::<String>(&claim).expect_err("a claim");
        let limit = bincode::error::DecodeError::LimitExceeded;
        assert!(
            matches!(&refused, DecodeError::Content(e) if e.to_string() == limit.to_string()),
            "{refused}"
        );
        let mut claim = fixed::encode(&(1u64 << 27));
        claim.resize(3000, b'x');
        assert!(fixed::decode::<String>(&claim).is_err());
        // Values with a small encoding are still read: one byte for each of these numbers of eight.
        for count in [10usize, 200_000, 300_000, 3_000_000] {
            let zeros = compact::encode(&vec![0u64; count]);
            assert_eq!(compact::decode::<Vec<u64>>(&zeros).expect("within the limit").len(), count);
            let zeros = fixed::encode(&vec![0u64; count]);
            assert_eq!(fixed::decode::<Vec<u64>>(&zeros).expect("within the limit").len(), count);
        }
    }

    #[test]
    fn remaining_bytes_are_rejected() {
        assert!(matches!(fixed::decode::<u64>(&fixed::encode(&(1u64, 2u64))), Err(DecodeError::Longer)));
        assert!(matches!(compact::decode::<u64>(&compact::encode(&(1u64, 2u64))), Err(DecodeError::Longer)));
    }
}
