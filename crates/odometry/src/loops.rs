//! Loops on their way from a search that is due to a correction of the map.

use crate::graph::Edge;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{KeyframeId, Pose};

/// A search for loops that is yet to be done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum LoopCheck {
    /// Align a keyframe with earlier ones nearby.
    Neighbours(KeyframeId),
    /// Search for a keyframe's place by appearance.
    Appearance(KeyframeId),
}

/// A place that was recognised once.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LoopCandidate {
    pub(crate) edge: Edge,
    /// The motion that would bring the newer keyframe to its recognised place.
    pub(crate) correction: Pose,
}

/// A loop that has been closed. The map is corrected in another frame than it was found, so that no frame takes long.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct ClosedLoop {
    /// Pairs of an earlier keyframe and a later one, the latest last.
    pub(crate) joined: Vec<(KeyframeId, KeyframeId)>,
    /// The motion of the later keyframe's part of the map, if that was another one.
    pub(crate) part_motion: Option<Pose>,
}
