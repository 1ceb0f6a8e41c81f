//! SAM 2.1: promptable segmentation of images and videos (Ravi et al. 2024), and two networks with the same interface at
//! less work: EdgeTAM (Zhou et al. 2025) has a convolutional trunk, memories of a few tokens, and half of the attention;
//! EfficientTAM (Xiong et al. 2024) has a small plain ViT, and may pool its memories.
//!
//! The modules follow the paper's figure: `encoder` (a frame to features), `memory` (an object's memory, and attention
//! to it), `prompt` (clicks, boxes and masks), `heads` (features and prompts to masks). [`Sam2Network`] combines them;
//! [`Sam2Predictor`] tracks objects through a video.

mod config;
mod encoder;
mod error;
mod heads;
mod layers;
mod memory;
mod network;
mod predictor;
mod prompt;
mod prompting;
mod resize;
mod settings;
mod video_state;
mod weights;

pub use config::{HieraConfig, PerceiverConfig, RepVitConfig, Sam2Config, Sam2Size, TrunkConfig, VitConfig};
pub use error::Sam2Error;
pub use heads::ObjectMask;
pub use network::{FeatureMaps, Sam2Network};
pub use predictor::Sam2Predictor;
pub use prompt::PointLabel;
pub use settings::{MemoryPooling, Sam2PredictorSettings};
pub use video_state::VideoState;
pub use weights::Weights;

#[cfg(test)]
mod block_tests;
