//! Errors that end the server.

use splatseg::pipeline::PipelineError;
use std::path::PathBuf;
use thiserror::Error;

/// The server cannot start or go on.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum McpError {
    /// The map cannot be loaded.
    #[error(transparent)]
    Map(#[from] PipelineError),
    /// A file cannot be used.
    #[error("{}: {problem}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The problem with it.
        problem: String,
    },
    /// The address for clients cannot be used.
    #[error("{address}: {problem}")]
    Address {
        /// The address.
        address: std::net::SocketAddr,
        /// The problem with it.
        problem: String,
    },
    /// The connection or the system failed.
    #[error("the assistant's connection: {0}")]
    Connection(String),
}
