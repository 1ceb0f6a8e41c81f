//! Class-agnostic video segmentation quality (VSQ) and segmentation and tracking quality (STQ), and the errors of camera
//! trajectories (ATE and RPE).
//!
//! [`VideoScorer`] receives labels one frame at a time and keeps counts instead of images. [`DatasetScore`] sums the
//! counts of videos. There are two definitions of both metrics, see [`Protocol`]. [`SizeScores`] reports id consistency
//! by object size, and [`SingleFrameScores`] the segmentation quality of single frames. [`score_trajectory`] compares
//! camera poses with the true ones.
//!
//! ```
//! use splatseg_geometry::SegmentMap;
//! use splatseg_metrics::{FramePrediction, Protocol, ScoreSettings, VideoScorer};
//!
//! let settings = ScoreSettings { protocol: Protocol::Strict, ..ScoreSettings::default() };
//! let mut scorer = VideoScorer::new(settings);
//! let truth = SegmentMap::from_fn(4, 2, |column, _| if column < 2 { 7 } else { 0 });
//! let prediction = SegmentMap::from_fn(4, 2, |column, _| if column < 2 { 1 } else { 0 });
//! scorer.push(&truth, &FramePrediction::Ids(&prediction))?;
//! assert_eq!(scorer.finish().scores().stq, Some(100.0));
//! # Ok::<(), splatseg_metrics::MetricsError>(())
//! ```

mod by_size;
mod error;
mod instance_ap;
mod overlap;
mod prediction;
mod score;
mod scorer;
mod settings;
mod single_frame;
mod stq;
mod trajectory;
mod tubes;
mod vsq;

pub use by_size::{LARGE_ABOVE_PX, SMALL_BELOW_PX, SizeClass, SizeCounts, SizeScores};
pub use error::MetricsError;
pub use instance_ap::{InstanceScorer, InstanceScores, MIN_INSTANCE_VERTICES, PredictedInstance};
pub use prediction::FramePrediction;
pub use score::{DatasetScore, RawCounts, Scores, VideoScore};
pub use scorer::VideoScorer;
pub use settings::{Protocol, ScoreSettings, Void};
pub use single_frame::{
    BOUNDARY_TOLERANCE_PX, BoundaryCounts, ConfidenceCounts, DetectionCounts, SingleFrameCounts, SingleFrameScores,
};
pub use stq::StqCounts;
pub use trajectory::{
    AbsoluteError, ErrorStatistics, RelativeError, RigidAlignment, TrajectoryScore, TrajectorySettings,
    score_trajectory,
};
pub use vsq::{VsqCounts, WindowLength};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
