//! Errors of the node.

use thiserror::Error;

/// Errors of the node.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Ros2Error {
    /// The node cannot take part in the network.
    #[error("ROS 2 domain {domain_id}: {reason}")]
    Network {
        /// The domain.
        domain_id: u16,
        /// Message of RustDDS.
        reason: String,
    },
    /// A name of a node or namespace that ROS 2 does not allow.
    #[error("{found}: not a namespace and a name of letters, digits and underscores, such as /robot1 splatseg")]
    Name {
        /// Namespace and name.
        found: String,
    },
    /// An environment variable with a wrong value.
    #[error("{variable}: found {found:?}, expected {expected}")]
    Environment {
        /// Its name.
        variable: &'static str,
        /// Its value.
        found: String,
        /// The allowed values.
        expected: &'static str,
    },
}
