//! Errors of segmenters.

use crate::AffinityWeightsError;
use splatseg_annotations::MaskFileError;
use splatseg_dataset::DatasetError;
use splatseg_files::display_bytes;
use splatseg_models::fastsam::FastSamError;
use splatseg_settings::SettingError;
use std::path::PathBuf;
use thiserror::Error;

/// Errors creating a segmenter or segmenting a frame. Sizes are `(width, height)` in pixels.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SegmenterError {
    /// The FastSAM network failed.
    #[error(transparent)]
    FastSam(#[from] FastSamError),
    /// The device running the affinity network failed.
    #[error("the device failed: {message}")]
    Device {
        /// Message from the device.
        message: String,
    },
    /// The weights of the affinity network cannot be used.
    #[error(transparent)]
    AffinityWeights(#[from] AffinityWeightsError),
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// A file or folder could not be read.
    #[error("cannot read {path}: {source}", path = path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The I/O error.
        source: std::io::Error,
    },
    /// The path given as a folder of masks is not a folder.
    #[error("{path} is not a folder, expected one with a .png or .json file for each frame", path = path.display())]
    NotAFolder {
        /// The path given.
        path: PathBuf,
    },
    /// The folder contains no `.png` or `.json` files.
    #[error("{path} contains no .png or .json files, expected one for each frame", path = path.display())]
    NoMasks {
        /// The folder.
        path: PathBuf,
    },
    /// There are no masks for a frame.
    #[error("no masks for frame {frame}: looked for {png} and {json}", png = png.display(), json = json.display())]
    MissingFrame {
        /// Name of the frame.
        frame: String,
        /// Path of the missing id image.
        png: PathBuf,
        /// Path of the missing annotation file.
        json: PathBuf,
    },
    /// An id image cannot be read, or its pixel format cannot represent ids.
    #[error(transparent)]
    IdImage(Box<DatasetError>),
    /// An annotation file is damaged, incomplete or too large.
    #[error("{path}: {source}", path = path.display())]
    MaskFile {
        /// The file.
        path: PathBuf,
        /// The defect.
        source: Box<MaskFileError>,
    },
    /// The masks do not have the frame's size.
    #[error(
        "{path}: masks of {}x{} pixels become {}x{} when resized and cropped like the video, expected {}x{} as in the frame",
        stored.0, stored.1, found.0, found.1, expected.0, expected.1, path = path.display()
    )]
    WrongSize {
        /// The file.
        path: PathBuf,
        /// Size of the masks in the file.
        stored: (usize, usize),
        /// Their size after resizing and cropping.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// A file contains more masks than there are ids.
    #[error("{path} contains more than {limit} masks, expected at most one for each 16-bit id", path = path.display())]
    TooManyMasks {
        /// The file.
        path: PathBuf,
        /// Maximum number of masks in a frame.
        limit: usize,
    },
    /// The masks of a frame exceed the memory limit.
    #[error(
        "{path}: the first {masks} masks take {}, expected at most {} (memory_limit)",
        display_bytes(*bytes), display_bytes(*limit), path = path.display()
    )]
    TooMuchMemory {
        /// The file.
        path: PathBuf,
        /// Number of masks read so far.
        masks: usize,
        /// Their size in memory at the frame's resolution, bytes.
        bytes: u64,
        /// The memory limit, bytes.
        limit: u64,
    },
    /// A [`Segmenter`](crate::Segmenter) defined in another crate failed.
    #[error("{name}: {source}")]
    Other {
        /// Name of the segmenter.
        name: String,
        /// Its error.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}
