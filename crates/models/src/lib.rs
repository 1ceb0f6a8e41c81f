//! Neural networks and their checkpoints. Independent of splats.

pub mod checkpoint;
#[cfg(feature = "networks")]
pub mod completeness;
#[cfg(feature = "networks")]
pub mod convolution;
pub mod device;
#[cfg(feature = "networks")]
pub mod fastsam;
#[cfg(feature = "networks")]
pub mod sam2;
#[cfg(feature = "networks")]
pub mod transfer;
#[cfg(not(feature = "networks"))]
mod without_networks;

#[cfg(not(feature = "networks"))]
pub use without_networks::{completeness, fastsam, sam2};

#[cfg(test)]
extern crate self as splatseg_models;

#[cfg(all(doctest, feature = "networks"))]
#[doc = include_str!("../README.md")]
struct Readme;
