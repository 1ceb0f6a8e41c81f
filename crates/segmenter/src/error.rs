//! Everything that can go wrong in a segmenter.

use crate::AffinityWeightsError;
use splatseg_dataset::DatasetError;
use splatseg_geometry::RleError;
use splatseg_input::display_bytes;
use splatseg_models::fastsam::FastSamError;
use splatseg_settings::SettingError;
use std::path::PathBuf;
use thiserror::Error;

/// Why a frame could not be segmented, or a segmenter could not be made. Sizes are `(width, height)` in pixels.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SegmenterError {
    /// The network failed.
    #[error(transparent)]
    FastSam(#[from] FastSamError),
    /// The device of the affinity network failed.
    #[error("the device failed: {message}")]
    Device {
        /// What the device said.
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
        /// What the system reported.
        source: std::io::Error,
    },
    /// The path given as a folder of masks is something else.
    #[error("{path} is not a folder, expected one with a .png or .json file for each frame", path = path.display())]
    NotAFolder {
        /// The path given.
        path: PathBuf,
    },
    /// The folder holds no file that could contain masks.
    #[error("{path} holds neither .png nor .json files, expected one for each frame", path = path.display())]
    NoMasks {
        /// The folder.
        path: PathBuf,
    },
    /// There are no masks for a frame.
    #[error("no masks for frame {frame}: looked for {png} and {json}", png = png.display(), json = json.display())]
    MissingFrame {
        /// Name of the frame.
        frame: String,
        /// The missing id image.
        png: PathBuf,
        /// The missing annotation file.
        json: PathBuf,
    },
    /// An image of ids cannot be read, or is of a kind that cannot hold ids.
    #[error(transparent)]
    IdImage(Box<DatasetError>),
    /// An annotation file is damaged or incomplete.
    #[error("{path}: {field}: found {found}, expected {expected}", path = path.display())]
    Annotation {
        /// The file.
        path: PathBuf,
        /// Where in the file, e.g. `annotation 3, score`.
        field: String,
        /// What is there, or what the parser said.
        found: String,
        /// What should be there.
        expected: &'static str,
    },
    /// A run-length encoded mask is damaged.
    #[error("{path}: annotation {index}, segmentation: {source}", path = path.display())]
    Rle {
        /// The file.
        path: PathBuf,
        /// Place of the annotation in its list, from 0.
        index: usize,
        /// What is wrong with it.
        source: RleError,
    },
    /// A file states an image that is empty, or too large to be one.
    #[error("{path} states masks of {}x{} pixels, expected 1 to {limit} pixels in all", size.0, size.1, path = path.display())]
    ImpossibleSize {
        /// The file.
        path: PathBuf,
        /// Stated size.
        size: (usize, usize),
        /// Most pixels accepted.
        limit: usize,
    },
    /// The masks do not fit the frame.
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
    /// A file holds more masks than a frame can have ids.
    #[error("{path} holds more than {limit} masks, expected at most as many as there are ids", path = path.display())]
    TooManyMasks {
        /// The file.
        path: PathBuf,
        /// Most masks of a frame.
        limit: usize,
    },
    /// The masks of a frame take more memory than they may.
    #[error(
        "{path}: the first {masks} masks take {}, expected at most {} (memory_limit)",
        display_bytes(*bytes), display_bytes(*limit), path = path.display()
    )]
    TooMuchMemory {
        /// The file.
        path: PathBuf,
        /// Masks read so far.
        masks: usize,
        /// Bytes that they take at the frame's size.
        bytes: u64,
        /// Bytes that they may take.
        limit: u64,
    },
    /// A [`Segmenter`](crate::Segmenter) that is defined elsewhere failed.
    #[error("{name}: {source}")]
    Other {
        /// Name of the segmenter.
        name: String,
        /// What it reports.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
}
