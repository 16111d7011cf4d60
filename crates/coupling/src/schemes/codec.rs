//! What schemes and accelerations carry from window to window, as bytes: a resumed run is bitwise identical.

use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::RunError;

/// `value` as bytes.
pub fn pack(value: &impl Serialize) -> Vec<u8> {
    let config = bincode::config::standard().with_fixed_int_encoding();
    // Plain numbers and lists of them: nothing that cannot be written down.
    bincode::serde::encode_to_vec(value, config).expect("plain data can be encoded")
}

/// The value that [`pack`] encoded.
///
/// # Errors
/// Bytes of another scheme.
pub fn unpack<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, RunError> {
    let config = bincode::config::standard().with_fixed_int_encoding().with_limit::<{ 1 << 36 }>();
    match bincode::serde::decode_from_slice(bytes, config) {
        Ok((value, used)) if used == bytes.len() => Ok(value),
        _ => Err(RunError::Input(
            "the saved state of the coupling is that of another scheme or version of ripstop".into(),
        )),
    }
}
