//! A ROS 2 node without ROS: feeds a [`LiveSession`](splatseg_live::LiveSession) with topics and publishes its results,
//! over DDS ([RustDDS](https://docs.rs/rustdds)). Nothing of ROS is needed to build or run it.
//!
//! [`Ros2Node::join`] makes the node. Its [`Ros2Node::outlet`] goes into the session; [`Ros2Node::start`] then feeds the
//! session's stream and offers services and parameters until the node is dropped.
//!
//! Messages pass through as bytes (`raw_cdr.rs`). One thread takes messages that have arrived (`subscriptions.rs`) and
//! looks for topics and subscribers that have changed, one publishes (`outlet.rs`: of each kind the newest message, so
//! that a slow network delays no frame), one answers requests (`service.rs`). `endpoints.rs` tells other nodes which
//! node an endpoint belongs to. ROS 2's names and services are built on DDS here, not taken from `ros2-client`: that
//! decodes every message, expects another type on `/clock`, and does not say which node a reader of bytes belongs to.

mod domain;
mod endpoints;
mod error;
mod names;
mod node;
mod outlet;
mod parameters;
mod raw_cdr;
mod receive_buffer;
mod requests;
mod service;
mod sim_time;
mod subscriptions;
#[cfg(test)]
mod tests;

pub use domain::{DiscoveryRange, Domain};
pub use error::Ros2Error;
pub use names::NodeName;
pub use node::{Report, Ros2Node};
pub use outlet::Ros2Outlet;
pub use parameters::ParameterValue;
