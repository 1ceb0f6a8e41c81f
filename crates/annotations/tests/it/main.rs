//! The integration tests of this crate, in one program: it is linked once.

mod folder_predictions;
mod id_images;
mod predicted_video;
mod trajectories;
