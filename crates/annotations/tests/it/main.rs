//! The integration tests of this crate, in one program: it is linked once.

mod coco_predictions;
mod folder_predictions;
mod id_images;
mod panoptic_predictions;
mod predicted_video;
mod trajectories;
