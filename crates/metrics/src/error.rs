//! Errors in the input to be scored.

use crate::ScoreSettings;
use splatseg_geometry::SegmentId;
use thiserror::Error;

/// Errors in the input to be scored. Sizes are `(width, height)` in pixels. Frames are numbered from 0.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MetricsError {
    /// A predicted map or mask differs in size from the ground truth of its frame.
    #[error(
        "frame {frame}: the prediction is {}x{} but the ground truth is {}x{}",
        found.0, found.1, expected.0, expected.1
    )]
    PredictionSize {
        /// Index of the frame.
        frame: usize,
        /// Size of the prediction.
        found: (usize, usize),
        /// Size of the ground truth.
        expected: (usize, usize),
    },
    /// The ground truth differs in size from that of the video's first frame.
    #[error(
        "frame {frame}: the ground truth is {}x{} but the video began with {}x{}",
        found.0, found.1, expected.0, expected.1
    )]
    SizeChanged {
        /// Index of the frame.
        frame: usize,
        /// Size of this frame.
        found: (usize, usize),
        /// Size of the first frame.
        expected: (usize, usize),
    },
    /// A predicted 3D instance has a vertex index that is out of range.
    #[error("a predicted instance has vertex {vertex}, expected less than {vertices}, the number of vertices")]
    NoSuchVertex {
        /// Index of the vertex, from 0.
        vertex: usize,
        /// Number of vertices.
        vertices: usize,
    },
    /// A predicted mask has id 0, which means "no segment".
    #[error("frame {frame}: a predicted mask has id 0, expected an id above 0")]
    MaskWithoutId {
        /// Index of the frame.
        frame: usize,
    },
    /// Two predicted masks of one frame have the same id.
    #[error("frame {frame}: two predicted masks have id {id}, expected each id once in a frame")]
    RepeatedId {
        /// Index of the frame.
        frame: usize,
        /// The id.
        id: SegmentId,
    },
    /// A video has predictions both with and without ids.
    #[error("frame {frame}: predictions with and without ids are mixed in one video")]
    MixedPredictions {
        /// Index of the frame.
        frame: usize,
    },
    /// No pose of an estimated trajectory has a time close enough to that of a true pose.
    #[error(
        "none of the {estimated} estimated poses is within {max_seconds_apart} s of one of the {true_poses} true poses: \
         they are from {}, the true ones from {}",
        range_text(*estimated_seconds),
        range_text(*true_seconds)
    )]
    NoPosePairs {
        /// Number of true poses.
        true_poses: usize,
        /// Number of estimated poses.
        estimated: usize,
        /// First and last time of the true poses, seconds; `None` if there are none.
        true_seconds: Option<(f64, f64)>,
        /// First and last time of the estimated poses, seconds; `None` if there are none.
        estimated_seconds: Option<(f64, f64)>,
        /// Maximum time between the poses of a pair, seconds.
        max_seconds_apart: f64,
    },
    /// A video's settings differ from those of the dataset to which it is added.
    #[error("the video was scored with {found:?} but the dataset with {expected:?}")]
    SettingsDiffer {
        /// Settings of the video.
        found: ScoreSettings,
        /// Settings of the dataset.
        expected: ScoreSettings,
    },
}

/// Formats first and last time, seconds.
fn range_text(range: Option<(f64, f64)>) -> String {
    range.map_or_else(|| "no time".to_owned(), |(first, last)| format!("{first:.3} to {last:.3} s"))
}
