//! Objects that a person says are one.

use super::{NamedMap, Pipeline};
use splatseg_geometry::{RemappedId, SegmentId};
use splatseg_memory::SplatMemory;
use splatseg_odometry::MethodFindings;
use std::collections::BTreeSet;
use thiserror::Error;

/// Objects cannot be merged.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum MergeObjectsError {
    /// Fewer than two different objects.
    #[error("found {found} object, expected two or more to merge")]
    TooFew {
        /// Number of different ids.
        found: usize,
    },
    /// The map has no such object.
    #[error("there is no object {id} in the map")]
    Unknown {
        /// The id.
        id: SegmentId,
    },
    /// There is no memory, or one of a kind whose ids cannot change.
    #[error("found a method or a kind of memory whose ids cannot change, expected votes, e.g. memory.kind = evidence")]
    Fixed,
}

/// The ids and what they become: the lowest, which is the oldest.
fn merged_ids(ids: &[SegmentId], memory: Option<&SplatMemory>) -> Result<Vec<RemappedId>, MergeObjectsError> {
    let memory = memory.filter(|memory| memory.can_merge_objects()).ok_or(MergeObjectsError::Fixed)?;
    let ids: BTreeSet<SegmentId> = ids.iter().copied().collect();
    let carried = memory.map().carried_ids();
    if let Some(id) = ids.iter().copied().find(|id| !carried.contains(id)) {
        return Err(MergeObjectsError::Unknown { id });
    }
    match ids.first() {
        Some(into) if ids.len() > 1 => {
            Ok(ids.iter().skip(1).map(|from| RemappedId { from: *from, into: *into }).collect())
        }
        _ => Err(MergeObjectsError::TooFew { found: ids.len() }),
    }
}

impl Pipeline {
    /// Makes objects of the map one, which keeps the lowest of their ids, and returns what became of the others. The next
    /// [`FrameResult::remapped`](super::FrameResult::remapped) tells it, too. Of their labels, one that a person gave stays.
    ///
    /// # Errors
    /// [`MergeObjectsError`]; then nothing has changed.
    pub fn merge_objects(&mut self, ids: &[SegmentId]) -> Result<Vec<RemappedId>, MergeObjectsError> {
        let remapped = merged_ids(ids, self.memory())?;
        self.method.merge_objects(&remapped);
        self.poses.receive(MethodFindings { remapped: &remapped, segments: None });
        self.remap_known(&remapped);
        Ok(remapped)
    }
}

impl NamedMap {
    /// Makes objects of the map one, as [`Pipeline::merge_objects`] does.
    ///
    /// # Errors
    /// [`MergeObjectsError`]; then nothing has changed.
    pub fn merge_objects(&mut self, ids: &[SegmentId]) -> Result<Vec<RemappedId>, MergeObjectsError> {
        let remapped = merged_ids(ids, Some(&self.memory))?;
        self.memory.merge_objects(&remapped);
        self.names.remap(&remapped);
        self.history.remap(&remapped);
        Ok(remapped)
    }
}
