//! FastSAM (Zhao et al. 2023, arXiv 2306.12156): YOLOv8-seg with one class, "object", and its pre- and postprocessing.
//!
//! An image passes through `letterbox` (the network's input), [`FastSamNetwork`] (a [`RawOutput`]), [`Candidates`]
//! (boxes and NMS) and `masks` (from prototypes to masks). The reference for every step is Ultralytics 8.4. Files with
//! the same role as in [`sam2`](crate::sam2) have the same names: `config`, `weights`, `network`, `predictor`,
//! `settings`, `error`.

mod c2f;
mod candidates;
mod config;
mod conv;
mod detection;
mod error;
mod head;
mod letterbox;
mod masks;
mod network;
mod placement;
mod point_prompt;
mod predictor;
mod prototypes;
mod raw_output;
mod resampling;
mod settings;
mod sppf;
mod weights;

pub use candidates::Candidates;
pub use config::FastSamConfig;
pub use detection::Detection;
pub use error::FastSamError;
pub use letterbox::{input_values, letterbox};
pub use masks::{image_masks, input_mask_in_image, input_masks};
pub use network::FastSamNetwork;
pub use placement::Placement;
pub use point_prompt::masks_at;
pub use predictor::{FastSamPredictor, detections};
pub use raw_output::{Prototypes, RawOutput};
pub use settings::FastSamPredictorSettings;
pub use weights::Weights;
