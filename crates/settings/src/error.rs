//! The error for a setting with an invalid value.

use thiserror::Error;

/// A setting outside its range, or of the wrong type.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{key} is {found}, expected {expected}")]
pub struct SettingError {
    /// The full key, e.g. `memory.max_votes`.
    pub key: String,
    /// The value found.
    pub found: String,
    /// The allowed values.
    pub expected: String,
}
