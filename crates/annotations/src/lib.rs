//! Masks, id images, meshes and camera trajectories in the formats of other programs.
//!
//! - `id_image.rs` writes id images. [`read_segments_png`](splatseg_dataset::read_segments_png) reads them.
//! - `coco/` reads and writes COCO masks: [`CocoWriter`], [`read_mask_file`], and predictions of whole videos.
//! - `panoptic.rs` reads COCO's panoptic format.
//! - `predictions.rs` reads a video's predictions in any of these forms ([`Predictions`]). `frames.rs` matches them with the
//!   frames of a scene, `choice.rs` selects one video.
//! - `mesh.rs` reads the vertices of a mesh and their instances.
//! - `trajectory_file.rs` reads and writes camera trajectories in the format of TUM RGB-D.

mod choice;
mod coco;
mod error;
mod frames;
mod id_image;
mod mesh;
mod panoptic;
mod predictions;
mod trajectory_file;

pub use choice::PredictionChoice;
pub use coco::{CocoImage, CocoLabel, CocoWriter, EncodedMask, MaskFileError, read_mask_file};
pub use error::{AnnotationError, WriteIdsError};
pub use frames::SelectedFrames;
pub use id_image::write_segments_png;
pub use mesh::{read_mesh_vertices, read_vertex_instances};
pub use panoptic::{PanopticFrame, PanopticFrames};
pub use predictions::{Fit, Prediction, Predictions};
pub use trajectory_file::{TRAJECTORY_HEADER, frame_time, read_trajectory, trajectory_line};
