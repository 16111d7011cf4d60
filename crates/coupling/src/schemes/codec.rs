//! State that schemes and accelerations carry from window to window, as bytes, so that a resumed run is bitwise
//! identical.

use archive::codec::fixed;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::RunError;

/// `value` as bytes.
pub fn pack(value: &impl Serialize) -> Vec<u8> {
    fixed::encode(value)
}

/// The value that [`pack`] encoded.
///
/// # Errors
/// Bytes that another scheme wrote.
pub fn unpack<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, RunError> {
    fixed::decode(bytes).map_err(|_| {
        RunError::Input(
            "the saved state of the coupling belongs to another scheme or version of ripstop; restart the stage \
             or restore the scheme of the saved run"
                .into(),
        )
    })
}
