//! Where single frames were taken, in a saved map.

use crate::PoseSourceError;
use crate::keyframes::KeyframeStore;
use crate::keyframes::apart;
use crate::relocalisation::{MIN_INLIERS_LOST, Query};
use crate::saved_keyframes::parsed;
use crate::tracked_frame::TrackedFrame;
use splatseg_geometry::{CameraFrame, KeyframeId, Pose};

/// Seed of the random draws. All frames have the same, so that none depends on the others.
const SEED: u64 = 1;

/// Finds single frames in the keyframes of a saved map, as a camera that is lost, but with one frame only.
#[derive(Clone, Debug)]
pub struct Relocaliser {
    store: KeyframeStore,
}

/// Where a frame was taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocatedFrame {
    /// The camera's pose, camera to world, in the coordinates of the map.
    pub world_from_camera: Pose,
    /// The keyframe that it was aligned with.
    pub keyframe: KeyframeId,
    /// Part of the map, from 0. Only poses in the same part can be compared: where parts are relative to each other is
    /// unknown.
    pub part: u32,
    /// Number of image features that agree with the map.
    pub features: usize,
    /// Share of the measurements in view of the keyframe that agree with it, 0 to 1: the lower one of depth and image.
    pub agreement: f32,
}

impl Relocaliser {
    /// Reads the keyframes of a saved map: bytes from [`PoseSource::save`](crate::PoseSource::save) for a
    /// [map](crate::StateScope::Map).
    ///
    /// # Errors
    /// [`PoseSourceError::State`] if the bytes are damaged.
    pub fn new(keyframes: &[u8]) -> Result<Self, PoseSourceError> {
        Ok(Self { store: parsed(keyframes).map_err(PoseSourceError::State)?.store })
    }

    /// Finds where a frame was taken. `None` if the map does not show that place, if several places look alike, or if the
    /// frame has too little depth or texture. The frame's size and camera need not be those of the map.
    ///
    /// A place that looks the same but is not in the map can be mistaken for one that is: there is no second frame that
    /// confirms it.
    pub fn locate(&self, frame: &CameraFrame<'_>) -> Option<LocatedFrame> {
        let query = Query::new(&TrackedFrame::new(frame).pyramid);
        if !query.has_view() {
            return None;
        }
        let found = query.recognise(&self.store, |_| true, SEED)?;
        if found.inliers < MIN_INLIERS_LOST {
            return None;
        }
        Some(LocatedFrame {
            world_from_camera: found.world_from_camera,
            keyframe: found.keyframe,
            part: self.store.get(found.keyframe)?.part,
            features: found.inliers,
            agreement: found.agreement,
        })
    }

    /// Number of keyframes.
    pub fn keyframe_count(&self) -> usize {
        self.store.len()
    }

    /// Number of parts of the map that keyframes are in.
    pub fn part_count(&self) -> usize {
        let parts: std::collections::BTreeSet<u32> = self.store.iter().map(|keyframe| keyframe.part).collect();
        parts.len()
    }

    /// True if a keyframe is this close to a pose: metres, and degrees of turn.
    pub fn has_keyframe_within(&self, world_from_camera: &Pose, metres: f64, degrees: f64) -> bool {
        self.store.iter().any(|keyframe| {
            let (distance, angle) = apart(&keyframe.world_from_key, world_from_camera);
            distance <= metres && angle.to_degrees() <= degrees
        })
    }
}
