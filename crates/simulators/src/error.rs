//! Errors of simulators.

use splatseg_dataset::DatasetError;
use splatseg_geometry::CameraFrame;
use splatseg_segmenter::SegmenterError;
use splatseg_settings::SettingError;
use splatseg_tracking::TrackerError;
use thiserror::Error;

/// Errors creating a simulator or processing a frame. Sizes are `(width, height)` in pixels.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SimulatorError {
    /// A setting is out of range.
    #[error(transparent)]
    Setting(#[from] SettingError),
    /// The scene has no ground truth.
    #[error(
        "{scene} has no ground truth, as required by the oracle segmenter, the simulated tracker and ground-truth prompts"
    )]
    NoGroundTruth {
        /// Name of the scene.
        scene: String,
    },
    /// The scene does not contain the frame, or the frame has no labels.
    #[error(
        "{scene} has no ground truth for frame {frame}, as required by the oracle segmenter, the simulated tracker and \
         ground-truth prompts"
    )]
    UnlabelledFrame {
        /// Name of the scene.
        scene: String,
        /// Name of the frame.
        frame: String,
    },
    /// The scene with the true depth does not contain the frame.
    #[error("{scene} has no frame {frame}, whose true depth is needed (true_depth)")]
    NoTrueDepth {
        /// Name of the scene.
        scene: String,
        /// Name of the frame.
        frame: String,
    },
    /// The frames have no depth, and no scene with their true depth is given.
    #[error("{scene} has no depth that could be distorted; true_depth names a scene that has it")]
    NothingToDistort {
        /// Name of the scene.
        scene: String,
    },
    /// The scene with the true depth has no depth.
    #[error("{scene} has no depth (true_depth)")]
    NoDepthInScene {
        /// Name of the scene.
        scene: String,
    },
    /// The true depth does not have the frame's size.
    #[error(
        "the true depth of frame {frame} has {}x{} pixels, expected the frame's {}x{} (true_depth)",
        found.0, found.1, expected.0, expected.1
    )]
    TrueDepthSize {
        /// Name of the frame.
        frame: String,
        /// Size of the true depth.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
    /// The ground truth of a frame could not be read.
    #[error("the ground truth of frame {frame}: {source}")]
    GroundTruth {
        /// Name of the frame.
        frame: String,
        /// The error.
        source: Box<DatasetError>,
    },
    /// The ground truth does not have the frame's size.
    #[error(
        "the ground truth of frame {frame} has {}x{} pixels, expected the frame's {}x{}",
        found.0, found.1, expected.0, expected.1
    )]
    GroundTruthSize {
        /// Name of the frame.
        frame: String,
        /// Size of the ground truth.
        found: (usize, usize),
        /// Size of the frame.
        expected: (usize, usize),
    },
}

impl SimulatorError {
    /// Checks that `found`, the size of a frame's ground truth, is the frame's size.
    pub(crate) fn check_size(frame: &CameraFrame, found: (usize, usize)) -> Result<(), Self> {
        let expected = (frame.width(), frame.height());
        if found == expected {
            return Ok(());
        }
        Err(Self::GroundTruthSize { frame: frame.name().to_owned(), found, expected })
    }
}

impl From<SimulatorError> for SegmenterError {
    fn from(error: SimulatorError) -> Self {
        Self::Other { name: "simulator".to_owned(), source: Box::new(error) }
    }
}

impl From<SimulatorError> for TrackerError {
    fn from(error: SimulatorError) -> Self {
        Self::Other { name: "sim".to_owned(), source: Box::new(error) }
    }
}
