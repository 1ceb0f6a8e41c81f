//! Events that a source of poses reports about the camera and the map.

use serde::{Deserialize, Serialize};

/// Something that a source of poses has found out with a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PoseEvent {
    /// The camera, which was lost, has been recognised in the map.
    FoundAgain {
        /// Number of frames before this one in which it was lost.
        lost_frames: usize,
    },
    /// The camera has been found in a map that was loaded.
    FoundInLoadedMap {
        /// Number of frames before this one.
        lost_frames: usize,
    },
    /// The camera is at no known place: a new part of the map begins, whose place relative to the rest is not known.
    NewPart {
        /// Number of frames before this one in which it was lost.
        lost_frames: usize,
        /// True if the camera was searched for in a loaded map.
        was_loaded: bool,
    },
    /// The camera has come back to a known place, and the map has been corrected.
    LoopClosed {
        /// Distance by which the camera's present position was corrected, metres.
        moved: f64,
        /// Number of keyframes whose poses were corrected.
        keyframes: usize,
        /// True if this has told where a new part of the map is. Then all of that part has moved.
        joined_parts: bool,
    },
}

impl PoseEvent {
    /// True if the world's axes are others from now on.
    pub(crate) fn changes_axes(&self) -> bool {
        match self {
            Self::FoundInLoadedMap { .. } | Self::NewPart { .. } => true,
            Self::LoopClosed { joined_parts, .. } => *joined_parts,
            Self::FoundAgain { .. } => false,
        }
    }
}

/// Numbers of events.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PoseEventCounts {
    /// The camera was recognised in the map after a loss, or in a loaded map.
    pub found: usize,
    /// New parts of the map that were begun.
    pub new_parts: usize,
    /// Loops that were closed.
    pub loops: usize,
    /// Loops that joined a new part of the map with the rest.
    pub joined_parts: usize,
}

impl PoseEventCounts {
    /// Adds an event.
    pub fn add(&mut self, event: &PoseEvent) {
        match event {
            PoseEvent::FoundAgain { .. } | PoseEvent::FoundInLoadedMap { .. } => self.found += 1,
            PoseEvent::NewPart { .. } => self.new_parts += 1,
            PoseEvent::LoopClosed { joined_parts, .. } => {
                self.loops += 1;
                self.joined_parts += usize::from(*joined_parts);
            }
        }
    }
}
