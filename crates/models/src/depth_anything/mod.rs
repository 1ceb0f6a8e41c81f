//! Depth Anything V2: a vision transformer (DINOv2) and a decoder (DPT) that return the depth of an image.
//!
//! | file | content |
//! | --- | --- |
//! | `layout.rs` | recognises a checkpoint by its names: the official code's, Hugging Face's |
//! | `config.rs` | the sizes, from the shapes and from a `config.json` beside the checkpoint |
//! | `resize.rs` | size of the input; cubic interpolation of images and of position embeddings |
//! | `encoder.rs` | image to tokens, after four of its blocks |
//! | `decoder.rs`, `fusion.rs`, `planes.rs` | tokens to depth |
//!
//! Yang et al., NeurIPS 2024; Oquab et al. 2024 for DINOv2; Ranftl et al., ICCV 2021 for DPT. All layers are loops of
//! `splatseg-kernels` on the CPU, so that a program without the feature `networks` has them too.

mod config;
mod decoder;
mod encoder;
mod error;
mod fusion;
mod layout;
mod network;
mod planes;
mod resize;

pub use config::{DepthAnythingConfig, DepthOutput};
pub use error::DepthAnythingError;
pub use layout::DepthAnythingLayout;
pub use network::DepthAnythingNetwork;
