//! Neural networks and their checkpoints. Independent of splats.

pub mod checkpoint;
pub mod completeness;
pub mod convolution;
pub mod device;
pub mod fastsam;
pub mod sam2;
pub mod transfer;

#[cfg(test)]
extern crate self as splatseg_models;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
