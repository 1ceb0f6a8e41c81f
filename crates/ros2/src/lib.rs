//! A ROS 2 node without ROS: feeds a [`LiveSession`](splatseg_live::LiveSession) with topics and publishes its results,
//! over DDS ([RustDDS](https://docs.rs/rustdds)). Nothing of ROS is needed to build or run it.
//!
//! [`Ros2Node::join`] makes the node. Its [`Ros2Node::outlet`] goes into the session; [`Ros2Node::start`] then feeds the
//! session's stream and offers services and parameters until the node is dropped.

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
