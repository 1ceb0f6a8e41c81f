//! FastSAM (Zhao et al. 2023, arXiv 2306.12156): YOLOv8-seg with one class, "object", and everything around it.
//!
//! One image goes through `letterbox` (to the network's input), [`Network`] (to a [`RawOutput`]), [`Candidates`] (boxes
//! that may be objects, and suppression), `masks` (from prototypes to masks). The reference for every step is
//! Ultralytics 8.4.

mod architecture;
mod c2f;
mod candidates;
mod conv;
mod error;
mod head;
mod letterbox;
mod masks;
mod network;
mod placement;
mod predictor;
pub mod prompts;
mod prototypes;
mod raw_output;
mod resampling;
mod settings;
mod sppf;
mod weights;

pub use architecture::YoloArchitecture;
pub use candidates::Candidates;
pub use error::FastSamError;
pub use letterbox::{letterbox, normalised};
pub use masks::{image_masks, input_mask_in_image, input_masks};
pub use network::Network;
pub use placement::Placement;
pub use predictor::{Detection, FastSamPredictor, detections};
pub use raw_output::{Prototypes, RawOutput};
pub use settings::FastSamPredictorSettings;
pub use weights::Weights;
