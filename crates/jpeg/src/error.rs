//! What can be wrong with a JPEG file.

use thiserror::Error;

/// A JPEG file that cannot be decoded.
#[derive(Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum JpegError {
    /// The file may be fine, but is of a kind that is not decoded here.
    #[error("{0} is not supported")]
    Unsupported(&'static str),
    /// The file ends within its header.
    #[error("the file ends within its header")]
    Ended,
    /// A segment is not as the standard requires.
    #[error("the segment FF {marker:02X} is wrong: {reason}")]
    Segment {
        /// Second byte of the segment's marker.
        marker: u8,
        /// What is wrong.
        reason: &'static str,
    },
    /// Compressed data for a component of the image is missing.
    #[error("there is no compressed data for a component of the image")]
    NoScan,
    /// The compressed data uses a quantisation table that was not given.
    #[error("quantisation table {0} is missing")]
    NoQuantisation(usize),
    /// The compressed data holds bits that mean nothing.
    #[error("the compressed data is damaged: {0}")]
    Data(&'static str),
}
