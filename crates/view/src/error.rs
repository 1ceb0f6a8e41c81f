//! Errors starting a server.

use std::io;
use std::net::SocketAddr;
use thiserror::Error;

/// Errors starting a [`ViewServer`](crate::ViewServer).
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ViewError {
    /// Other computers could connect to the address, and [`Reach::Loopback`](crate::Reach) does not allow that.
    #[error("{0} can be reached from other computers; that must be allowed explicitly")]
    NotLoopback(SocketAddr),
    /// The port cannot be opened.
    #[error("cannot listen on {address}: {source}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// The reason.
        source: io::Error,
    },
    /// A thread cannot be started.
    #[error("cannot start a thread of the viewer: {0}")]
    Thread(#[source] io::Error),
    /// The system has no random numbers for the token.
    #[error("no random numbers for the token: {0}")]
    Random(String),
}
