//! The result of a pipeline for a frame.

use super::StageTimes;
use splatseg_geometry::{FrameAnchor, QuarterTurn, RemappedId, SegmentMap};
use splatseg_objects::ObjectSighting;
use splatseg_odometry::{CameraPose, InputDoubt, PoseEvent};
use splatseg_tracking::FrameOutput;

/// The result for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameResult {
    /// The method's result: an id per pixel, masks, changes to the memory.
    pub output: FrameOutput,
    /// The segmenter's finer cut of the frame, if it has one, at the resolution at which the frame was processed: for [`Pipeline::hindsight`](super::Pipeline::hindsight).
    pub regions: Option<SegmentMap>,
    /// The objects in the frame, by increasing id.
    pub objects: Vec<ObjectSighting>,
    /// Time of each stage.
    pub times: StageTimes,
    /// The camera's pose, from the pose source.
    pub pose: CameraPose,
    /// The keyframe to which the frame's surfaces are attached.
    pub anchor: FrameAnchor,
    /// The turn after which the frame is upright, as far as that was known; the segmenter may have seen it so.
    pub turn: QuarterTurn,
    /// Ids of earlier frames that turned out to be the same object, since the previous result.
    pub remapped: Vec<RemappedId>,
    /// Events of the pose source since the previous result: loops, a lost camera that was found.
    pub events: Vec<PoseEvent>,
    /// Doubts about the input that have arisen since the previous result, each once.
    /// [`Pipeline::finish`](super::Pipeline::finish) returns those that only all frames together justify.
    pub doubts: Vec<InputDoubt>,
}
