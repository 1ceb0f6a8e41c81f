//! Errors decoding JPEG files.

use thiserror::Error;

/// Errors decoding a JPEG file.
#[derive(Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum JpegError {
    /// The file uses a feature of JPEG that this decoder does not support.
    #[error("{0} is not supported")]
    Unsupported(&'static str),
    /// The file ends within its header.
    #[error("the file ends within its header")]
    Ended,
    /// A segment violates the standard.
    #[error("the segment FF {marker:02X} is invalid: {reason}")]
    Segment {
        /// Second byte of the segment's marker.
        marker: u8,
        /// The violation.
        reason: &'static str,
    },
    /// A component of the image has no compressed data, or compressed data precedes the frame header.
    #[error("there is no compressed data for a component of the image")]
    NoScan,
    /// The compressed data uses an undefined quantisation table.
    #[error("quantisation table {0} is missing")]
    NoQuantisation(usize),
    /// The compressed data is invalid or incomplete.
    #[error("the compressed data is damaged: {0}")]
    Data(&'static str),
}
