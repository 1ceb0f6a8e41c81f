//! Images between cameras: resampling, undistortion, registration of depth to colour, and the focal length of a camera
//! from the images it took.
//!
//! These functions work on pixels and know nothing of file formats: they do no I/O. Pixel centres have integer coordinates,
//! and depth is z-depth in metres, 0 for none, as everywhere in the project.

mod focal_length;
mod register;
mod resample;
mod undistortion;

pub use focal_length::{FocalLength, estimated_focal_length};
pub use register::{CameraPair, register_depth};
pub use resample::{ImageMap, resample_color, resample_depth, resample_labels};
pub use undistortion::{SeenBy, UndistortionMap, whole_view};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
