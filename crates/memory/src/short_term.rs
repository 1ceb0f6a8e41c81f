//! What a memory keeps besides its Gaussians, as it is saved with them: without it, a run that continues would differ
//! for some frames from one that never stopped.
//!
//! It is written as JSON: it is small, and its parts change more often than the map. An empty text is an empty memory.

use crate::SplatMemory;
use crate::depthless::SavedDepthlessSegment;
use crate::recent::SavedRecentFrames;
use crate::recurring::SavedRecurringPredictions;
use crate::segments::SavedIds;
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Longer texts are not written by any memory: 256 regions of a few megapixels take a few megabytes.
pub(crate) const MAX_BYTES: u64 = 1 << 28;

/// In how many frames a segment was seen in which way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Appearances {
    /// Frames with a prediction of it alone.
    pub apart: usize,
    /// Frames with one prediction of it and another segment.
    pub merged: usize,
}

/// What methods keep with the memory, so that it is saved with it.
impl SplatMemory {
    /// Remembered segments that a method hides because predictions have overruled them, each with the largest area,
    /// square metres, expected of it since then.
    pub fn overruled_mut(&mut self) -> &mut BTreeMap<SegmentId, f32> {
        &mut self.overruled
    }

    /// How segments were seen. What is forgotten is left out by [`SplatMemory::update`].
    pub fn appearances_mut(&mut self) -> &mut BTreeMap<SegmentId, Appearances> {
        &mut self.appearances
    }
}

/// What is saved besides the Gaussians.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ShortTermMemory {
    /// See [`SplatMemory::overruled_mut`](crate::SplatMemory::overruled_mut).
    pub overruled: BTreeMap<SegmentId, f32>,
    /// See [`SplatMemory::appearances_mut`](crate::SplatMemory::appearances_mut). Older files lack it.
    #[serde(default)]
    pub appearances: BTreeMap<SegmentId, Appearances>,
    /// Predictions that were explained by what is remembered.
    pub recurring: SavedRecurringPredictions,
    /// Segments that no Gaussian can carry.
    pub depthless: Vec<SavedDepthlessSegment>,
    /// Ids that the memory has nothing of.
    #[serde(default)]
    pub ids: SavedIds,
    /// The last frames. Older files lack them.
    #[serde(default)]
    pub recent: SavedRecentFrames,
}

impl ShortTermMemory {
    /// The text that a file holds; empty if there is nothing.
    pub fn to_bytes(&self) -> Vec<u8> {
        if *self == Self::default() {
            return Vec::new();
        }
        // Numbers, lists and maps with whole numbers as keys can always be written.
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// What the text of a file says.
    ///
    /// # Errors
    /// If it is not what [`Self::to_bytes`] writes. What its parts say is checked when they are restored.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        if bytes.is_empty() {
            return Ok(Self::default());
        }
        serde_json::from_slice(bytes).map_err(|error| error.to_string())
    }

    /// Requires that what methods keep is of ids up to `largest_id`.
    ///
    /// # Errors
    /// Names an id that was never given.
    pub fn check_ids(&self, largest_id: SegmentId) -> Result<(), String> {
        let mut named = self.overruled.keys().chain(self.appearances.keys());
        match named.find(|id| !(1..=largest_id).contains(*id)) {
            Some(id) => Err(format!("the segment {id} does not exist")),
            None => Ok(()),
        }
    }
}
