//! RGB-D scenes on disk as streams of [`RgbdFrame`](splatseg_geometry::RgbdFrame)s, and a synthetic room with exact
//! ground truth.
//!
//! [`open_scene`] recognises the format of a scene, [`FrameStream`] reads its frames ahead in the background, chosen
//! and framed (resized, cropped) as [`DatasetSettings`] say; a [`Preset`] has those of a benchmark. Adding a format
//! means one file or folder that implements [`Scene`] and one row in the table of `formats.rs`.

mod archive;
mod decode;
mod description;
mod error;
mod files;
mod format;
mod formats;
mod framing;
mod listing;
mod mcap;
mod mesh;
mod mvpd;
mod plain_folder;
mod plausibility;
mod preset;
mod recording_file;
mod register;
mod replica;
mod resample;
mod result_names;
mod scannet;
mod scene;
mod settings;
mod sevenscenes;
mod stream;
mod synthetic;
mod text;
mod tum;
mod undistort;

pub use decode::{read_color_image, read_segments_png};
pub use description::SceneDescription;
pub use error::{DatasetError, FrameReadError};
pub use format::{Format, FormatNameError};
pub use formats::{open_scene, supported_formats};
pub use framing::{Framing, ImageSize, ImageSizeTextError};
pub use mcap::{McapScene, McapSummary, McapTopic};
pub use mesh::{read_mesh_vertices, read_vertex_instances};
pub use mvpd::{MvpdScene, MvpdVideo, MvpdVideos};
pub use plain_folder::FolderScene;
pub use preset::{Preset, PresetNameError};
pub use replica::ReplicaScene;
pub use result_names::{padded_number, unpadded_number};
pub use scannet::{ScannetScene, SensScene};
pub use scene::{FramePart, LeftOut, Scene};
pub use settings::DatasetSettings;
pub use sevenscenes::SevenScenesScene;
pub use stream::{FrameStream, GroundTruth, MAX_FRAMES_IN_MEMORY, StreamedFrame};
pub use synthetic::{CameraMotion, Motion, Mover, Noise, SyntheticScene, SyntheticSettings, Thing, ThingKind};
pub use tum::TumScene;
pub use undistort::Undistortion;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
