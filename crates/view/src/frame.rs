//! Frames as shown to viewers.

use splatseg_geometry::{Image, Intrinsics, SegmentId, SegmentMap};
use splatseg_objects::{ObjectState, OrientedBox};
use std::time::Duration;

/// A frame with its result.
#[derive(Clone, Debug)]
pub struct ViewFrame {
    /// Number of the frame in the video, from 0.
    pub number: usize,
    /// Name of the frame.
    pub name: String,
    /// Time of the frame, if its source has a clock.
    pub timestamp: Option<Duration>,
    /// Colour, sRGB, `[height, width]`.
    pub color: Image<[u8; 3]>,
    /// Id of the object at each pixel, 0 for none, `[height, width]`.
    pub segments: SegmentMap,
    /// Intrinsics of the camera.
    pub intrinsics: Intrinsics,
    /// State of the run.
    pub status: ViewStatus,
}

/// An object in the list of [`ViewServer::publish_objects`](crate::ViewServer::publish_objects).
#[derive(Clone, Debug, PartialEq)]
pub struct ViewObject {
    /// Its id.
    pub id: SegmentId,
    /// Its name, if it has one.
    pub label: Option<String>,
    /// The tightest box around it, world coordinates; `None` if it is not in the map.
    pub oriented_box: Option<OrientedBox>,
    /// Number of frames that show it.
    pub frames: usize,
    /// Its state in the map; `None` without a map. The page folds away what [does not count](splatseg_objects::Object::counts).
    pub state: Option<ObjectState>,
    /// When it was seen: stretches `(first, last)`, seconds since the first frame. See [`SeenSpans`](crate::SeenSpans).
    pub seen: Vec<(f64, f64)>,
}

/// State of a run in a [`ViewFrame`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewStatus {
    /// Number of frames of the source that were not processed. A frame of colour and depth counts once.
    pub dropped: u64,
    /// True if the frame's pose came with it; otherwise the camera is tracked.
    pub is_pose_given: bool,
    /// How finely frames are segmented: the name of a degree of detail. `None` if that cannot be chosen.
    pub detail: Option<&'static str>,
    /// Time from taking the picture to showing its result; `None` for a recording.
    pub delay: Option<Duration>,
    /// Further lines to show, e.g. warnings.
    pub lines: Vec<String>,
}
