//! The integration tests of this crate, in one program: it is linked once.

mod color_images;
mod containers;
mod damage;
mod depth_scale;
mod folder;
mod folder_corrections;
mod live;
mod live_disorder;
mod mcap;
mod mcap_alignment;
mod mcap_cameras;
mod mcap_clock;
mod mcap_compression;
mod mcap_corrections;
mod mcap_damage;
mod mcap_transforms;
#[path = "support/messages.rs"]
mod messages;
mod mvpd;
mod open;
mod own_camera;
mod real_data;
mod realsense;
mod replica;
mod scannet;
mod sens;
mod sevenscenes;
mod stream;
mod support;
mod synthetic;
mod synthetic_changes;
mod synthetic_layouts;
mod synthetic_moving;
mod tum;
mod undistort;
mod without_poses;
