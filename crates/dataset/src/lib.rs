//! RGB-D scenes on disk as streams of [`RgbdFrame`](splatseg_geometry::RgbdFrame)s, and a synthetic room with exact
//! ground truth.
//!
//! [`open_scene`] detects a scene's format. [`FrameStream`] reads its frames ahead in the background, selected, resized
//! and cropped as [`DatasetSettings`] specifies. [`FrameMatcher`] makes frames of ROS 2 messages while they arrive. A
//! [`Preset`] holds the settings of a benchmark. To add a format, implement [`Scene`] in a new file or folder, and add its
//! name to `format_names.rs` and one row to the table in `formats.rs`.

mod archive;
mod arkitscenes;
mod corrections;
mod decode;
mod depth_ceiling;
mod depth_file;
mod depth_registration;
mod depth_scale;
mod description;
mod error;
mod ffmpeg;
mod files;
mod format_names;
mod formats;
mod frame_checks;
mod frame_list;
mod frame_source;
mod framing;
mod listing;
mod live;
mod mvpd;
mod nerfstudio;
mod own_camera;
mod plain_folder;
mod plausibility;
mod polycam;
mod pose_convention;
mod preset;
mod r3d;
mod recorded_poses;
mod recording;
mod recording_file;
mod replica;
mod result_names;
mod ros_topics;
mod scannet;
mod scene;
mod settings;
mod sevenscenes;
mod stamps;
mod stray;
mod stream;
mod synthetic;
mod text;
mod tum;
mod undistort;
mod unread_files;
mod upright;
mod video;

pub use corrections::CorrectedPose;
pub use decode::{read_color_image, read_segments_png};
pub use depth_registration::DepthRegistration;
pub use depth_scale::whole_millimetres;
pub use description::SceneDescription;
pub use error::{DatasetError, FrameReadError};
pub use format_names::{Format, FormatNameError};
pub use formats::{has_depth, is_scene, lacks_depth_topic, open_scene, supported_formats};
pub use frame_source::{FrameSource, StreamedFrame};
pub use framing::{Framing, ImageSize, ImageSizeTextError};
pub use live::{CoordinateFrames, DropCounts, FrameMatcher, MatchCounts, MatchLimits, UndecodedFrame};
pub use mvpd::{MvpdScene, MvpdVideo, MvpdVideos};
pub use own_camera::GuessedCamera;
pub use plain_folder::{FolderScene, ListedPose, read_pose_list};
pub use pose_convention::{PoseConvention, QuaternionOrder};
pub use preset::{Preset, PresetNameError};
pub use recording::{
    RecordedMessage, RecordingFrames, RecordingScene, RecordingSummary, RecordingTopic, read_messages,
};
pub use replica::ReplicaScene;
pub use result_names::{padded_number, unpadded_number};
pub use scannet::{ScannetScene, SensScene};
pub use scene::{FramePart, LeftOut, RecordedFrame, Scene};
pub use settings::DatasetSettings;
pub use sevenscenes::SevenScenesScene;
pub use stream::{FrameStream, GroundTruth, MAX_FRAMES_IN_MEMORY};
pub use tum::TumScene;
pub use undistort::{LensCorrection, Undistortion};
// Users of scenes need not know that rooms are rendered by a crate of their own.
pub use splatseg_synthetic::{
    CameraMotion, ChangeKind, Layout, Motion, Mover, Noise, Speed, SpeedError, SyntheticError, SyntheticScene,
    SyntheticSettings, Thing, ThingKind, TrueChange, Visit,
};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
