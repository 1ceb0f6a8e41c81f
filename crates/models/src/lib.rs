//! Neural networks and their checkpoints. Independent of splats.
//!
//! - [`fastsam`]: masks, boxes and scores from an image, or masks at given points. `splatseg-segmenter` wraps it as a
//!   segmenter; the method FastSPAM uses its masks at points.
//! - [`sam2`]: SAM 2.1, EdgeTAM and EfficientTAM, which follow prompted objects through a video.
//! - [`clip`]: images and texts become vectors that can be compared, for names of objects; on the CPU, without Burn.
//! - [`depth_anything`]: depth of an image; on the CPU, without Burn.
//! - [`checkpoint`]: their files, parsed and never executed.
//!
//! Burn holds the tensors and runs the cheap layers. On the CPU, the expensive ones are loops of `splatseg-kernels`; on
//! other devices the same layers use Burn's operations. All transfers to and from such a device go through
//! `transfer.rs`, which counts them.
//!
//! Burn is needed only with the feature `networks`. Without it, stand-ins take the networks' place
//! (`without_networks/`), so that other crates need no conditions of their own.

pub mod checkpoint;
pub mod clip;
#[cfg(feature = "networks")]
pub mod completeness;
#[cfg(feature = "networks")]
pub mod convolution;
pub mod depth_anything;
pub mod device;
#[cfg(feature = "networks")]
pub mod fastsam;
#[cfg(feature = "networks")]
pub mod sam2;
#[cfg(feature = "networks")]
pub mod transfer;
mod transformer;
#[cfg(not(feature = "networks"))]
mod without_networks;

#[cfg(not(feature = "networks"))]
pub use without_networks::{completeness, fastsam, sam2};

#[cfg(test)]
extern crate self as splatseg_models;

#[cfg(all(doctest, feature = "networks"))]
#[doc = include_str!("../README.md")]
struct Readme;
