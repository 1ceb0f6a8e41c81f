//! The error of a synthetic scene's settings.

use thiserror::Error;

/// Error for a setting of a synthetic scene, or its text, that is out of range or not understood.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{text:?}: {field}: found {found:?}, expected {expected}")]
pub struct SyntheticError {
    /// All settings, as text.
    pub text: String,
    /// The invalid setting.
    pub field: String,
    /// Value found.
    pub found: String,
    /// Value expected.
    pub expected: String,
}
