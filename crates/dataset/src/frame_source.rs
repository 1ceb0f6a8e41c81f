//! Ordered streams of frames: recordings, and cameras.

use crate::{CorrectedPose, FrameReadError, SceneDescription};
use splatseg_geometry::{CameraFrame, Pose, RgbdFrame, SegmentMap};

/// An ordered stream of frames, such as a [`FrameStream`](crate::FrameStream) of a recorded scene. A frame that cannot be
/// read is an `Err`, and the stream continues with the next.
///
/// A camera implements this trait with [`frames_left`](Self::frames_left) = `None`.
pub trait FrameSource: Iterator<Item = Result<StreamedFrame, FrameReadError>> {
    /// Number of frames to come, including those that cannot be read. `None` if the end is not known.
    fn frames_left(&self) -> Option<usize>;

    /// Returns the format, number and size of the frames, as far as they are known.
    fn description(&self) -> &SceneDescription;
}

/// One frame of a stream, resized and cropped as the settings say.
#[derive(Clone, Debug, PartialEq)]
pub struct StreamedFrame {
    /// Index of the frame in its source.
    pub index: usize,
    /// The frame. Its name is the source's name for it.
    pub frame: CameraFrame<'static>,
    /// The camera's pose, if the source has it.
    pub world_from_camera: Option<Pose>,
    /// Corrected poses of earlier frames of the stream that became known since the frame before, at most one per frame,
    /// by increasing frame. A pose is listed only if it differs from the one given before by more than 1 mm or 0.05
    /// degrees. Empty if the source does not correct its poses.
    pub corrections: Vec<CorrectedPose>,
    /// The true segments, of the frame's size; `None` if there are none or they were not requested.
    pub ground_truth: Option<SegmentMap>,
}

impl StreamedFrame {
    /// The frame with its pose; `None` if the source has none.
    pub fn posed(self) -> Option<RgbdFrame<'static>> {
        Some(self.frame.at(self.world_from_camera?))
    }
}
