//! RGB-D scenes on disk as streams of [`RgbdFrame`](splatseg_geometry::RgbdFrame)s, writers for predictions, and a
//! synthetic room with exact ground truth.
//!
//! [`open_scene`] recognises the format of a scene, [`FrameStream`] reads its frames ahead in the background, chosen
//! and framed (resized, cropped) as [`DatasetSettings`] say. Adding a format means one file that implements [`Scene`]
//! and one row in the table of `formats.rs`.

mod decode;
mod error;
mod formats;
mod framing;
mod listing;
mod output;
mod register;
mod resample;
mod scannet;
mod scene;
mod settings;
mod sevenscenes;
mod stream;
mod synthetic;
mod text;

pub use error::{DatasetError, FrameReadError};
pub use formats::{Format, FormatNameError, open_scene, supported_formats};
pub use framing::Framing;
pub use output::{
    OutputError, draw_overlay, read_segments_png, segment_color, write_atomically, write_overlay_jpeg,
    write_segments_png,
};
pub use scannet::ScannetScene;
pub use scene::Scene;
pub use settings::{DatasetSettings, ImageSize, ImageSizeTextError, SettingsError};
pub use sevenscenes::SevenScenesScene;
pub use stream::{FrameStream, GroundTruth, MAX_FRAMES_IN_MEMORY, StreamedFrame};
pub use synthetic::{Noise, SyntheticScene, SyntheticSettings};
