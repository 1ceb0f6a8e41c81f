//! SAM 2.1: promptable segmentation of images and videos (Ravi et al. 2024).

mod config;
mod error;
mod fpn_neck;
mod hiera;
mod image_encoder;
mod kernels;
mod layers;
mod mask_decoder;
mod memory_attention;
mod memory_encoder;
mod network;
mod position_encoding;
mod prompt_encoder;
mod resize;
mod sam_heads;
mod two_way_transformer;
mod weights;

pub use config::{HieraConfig, Sam2Config, Sam2Size};
pub use error::Sam2Error;
pub use network::Sam2;
pub use prompt_encoder::PointLabel;
pub use weights::Weights;

#[cfg(test)]
mod block_tests;
