//! SAM 2.1: promptable segmentation of images and videos (Ravi et al. 2024).

mod config;
mod error;
mod fpn_neck;
mod hiera;
mod host;
mod image_encoder;
mod kernels;
mod layers;
mod mask_decoder;
mod memory_attention;
mod memory_bank;
mod memory_encoder;
mod network;
mod object_mask;
mod position_encoding;
mod predictor;
mod prompt;
mod prompt_encoder;
mod resize;
mod sam_heads;
mod settings;
mod two_way_transformer;
mod weights;

pub use config::{HieraConfig, Sam2Config, Sam2Size};
pub use error::Sam2Error;
pub use network::{FeatureMaps, Sam2};
pub use object_mask::ObjectMask;
pub use predictor::{VideoPredictor, VideoState};
pub use prompt::{Click, Prompt};
pub use prompt_encoder::PointLabel;
pub use settings::PredictorSettings;
pub use weights::Weights;

#[cfg(test)]
mod block_tests;
