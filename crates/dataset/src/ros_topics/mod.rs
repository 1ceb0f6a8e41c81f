//! Frames from the topics of ROS 2, recorded (`recording/`) or as they arrive (`live/`).
//!
//! `contents.rs` keeps from each message what is needed, `choice.rs` chooses topics by settings or because they are the
//! only suitable ones. `timeline.rs` sorts the messages of a topic by time; `clock.rs` judges the stamps of a whole recording,
//! `stream_clock.rs` those of a stream.
//! `frames.rs` pairs colour with depth and finds the pose of a frame in `transforms.rs` or `poses.rs`. `reader.rs` decodes
//! (`images.rs`, `compressed_depth.rs`) and undistorts images, and registers depth to colour if necessary.

mod camera_list;
pub(crate) mod cameras;
pub(crate) mod choice;
pub(crate) mod clock;
mod compressed_depth;
pub(crate) mod contents;
mod corrections;
pub(crate) mod frame_names;
pub(crate) mod frames;
mod images;
mod links;
mod paths;
mod poses;
mod quaternions;
pub(crate) mod reader;
mod registration;
pub(crate) mod sdk_topics;
pub(crate) mod stream_clock;
pub(crate) mod timeline;
pub(crate) mod transform_tree;
pub(crate) mod transforms;
mod world;
