//! Refusals of parameters.

use crate::MeshError;

/// The value of `key` is refused for a reason.
pub(crate) fn refuse(key: &'static str, value: impl ToString, reason: impl Into<String>) -> MeshError {
    MeshError::Parameter { key, value: value.to_string(), reason: reason.into() }
}

/// A length that must be finite and above zero.
pub(crate) fn positive(key: &'static str, value: f64) -> Result<f64, MeshError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(refuse(key, value, "must be a length above zero"))
    }
}

/// Numbers of cells that a grid can have.
pub(crate) fn even(key: &'static str, value: u32) -> Result<usize, MeshError> {
    if value >= 2 && value.is_multiple_of(2) && value <= 10_000 {
        Ok(value as usize)
    } else {
        Err(refuse(key, value, "must be an even number from 2 to 10000"))
    }
}
