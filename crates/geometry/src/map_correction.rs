//! Corrections of a map: keyframes that move, and ids that turn out to be the same object.

use crate::{Pose, SegmentId};
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Number of a keyframe, from 0, in the order in which they were made. Never reused.
pub type KeyframeId = u32;

/// The keyframe to which the surfaces of a frame are attached: if the keyframe's pose is corrected, they move with it.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameAnchor {
    /// The keyframe.
    pub keyframe: KeyframeId,
    /// The keyframe's pose when the frame was processed, camera to world.
    pub world_from_keyframe: Pose,
    /// True if the camera is tracked: then its poses never jump without a [`MapCorrection`].
    pub is_tracked: bool,
    /// Keyframes whose pose relative to this frame may have drifted by more than the map tolerates. The frame does not
    /// prove that their surfaces are gone.
    pub uncertain: Arc<BTreeSet<KeyframeId>>,
}

impl Default for FrameAnchor {
    fn default() -> Self {
        let uncertain = Arc::default();
        Self { keyframe: 0, world_from_keyframe: Pose::IDENTITY, is_tracked: false, uncertain }
    }
}

/// A correction of keyframes' poses, e.g. after a loop was closed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapCorrection {
    /// The motion of each keyframe that moves: new world coordinates from old ones. The others stay.
    pub new_from_old: BTreeMap<KeyframeId, Pose>,
    /// Pairs of keyframes that now are known to show the same place, an earlier one first. Surfaces that are there twice
    /// become one.
    pub joined: Vec<(KeyframeId, KeyframeId)>,
}

impl MapCorrection {
    /// The new place of a point, world coordinates, metres, that is attached to a keyframe.
    pub fn moved(&self, keyframe: KeyframeId, point: DVec3) -> DVec3 {
        self.new_from_old.get(&keyframe).map_or(point, |motion| motion.rotation() * point + motion.translation())
    }
}

/// Two ids turned out to be the same object.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct RemappedId {
    /// The id that is not used any more.
    pub from: SegmentId,
    /// The older id, which stays.
    pub into: SegmentId,
}
