//! The ids that a memory gives out, and their states.

mod released;
#[cfg(test)]
mod tests;

use released::ReleasedIds;
pub(crate) use released::SavedRelease;
use splatseg_geometry::{MAX_16_BIT_ID, MAX_SEGMENT_ID, RemappedId, SegmentId, SegmentMap};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

/// Frames in which an id must be predicted to stop being tentative. Lost ids with fewer sightings are released, so an
/// id that reappears without having been released has at least this many.
const CONFIRMED: u32 = 2;

/// How the Gaussians of a map remember an id.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum SegmentHold {
    /// No Gaussian has votes for it.
    #[default]
    Nothing,
    /// Some Gaussians have votes for it, but all of these show other ids.
    Votes,
    /// Some Gaussians show it by themselves.
    Shown,
}

/// The ids of a memory.
///
/// Ids count up to [`MAX_16_BIT_ID`]. From then on, released ids are reused, first released first: ids that were
/// predicted in one frame at most and that the memory does not hold any more. Only if there are none does counting
/// continue, up to a limit, and then from 1 again without the ids in use. So the size of this state is bounded by the
/// number of ids that the memory holds.
#[derive(Clone, Debug)]
pub(crate) struct Segments {
    /// Number of ids given out by counting, including those after counting restarted from 1.
    given: u64,
    /// The largest id.
    limit: SegmentId,
    /// Ids that the memory holds, or that were given out since the last [`Self::release_ids`].
    live: BTreeMap<SegmentId, LiveSegment>,
    released: ReleasedIds,
    /// Ids to keep even if no Gaussian holds them.
    held: BTreeSet<SegmentId>,
    /// Live ids whose state may have changed since [`Self::release_ids`].
    changed: BTreeSet<SegmentId>,
}

/// The state of an id.
#[derive(Clone, Copy, Debug, Default)]
struct LiveSegment {
    /// Frames in which a prediction had the id.
    sightings: u32,
    /// True if the id was carried at the last [`Segments::release_ids`]: shown by a Gaussian, or held.
    carried: bool,
    hold: SegmentHold,
}

/// An id as it is saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SavedSegment {
    pub id: SegmentId,
    pub sightings: u32,
    pub carried: bool,
}

/// Saved state of the ids that are not live.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct SavedIds {
    /// Number of ids given out by counting.
    pub given: u64,
    /// In the order in which they are reused.
    pub released: Vec<SavedRelease>,
}

/// Ids that the memory has lost.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct LostIds {
    /// Ids that were carried and are not any more.
    pub forgotten: Vec<SegmentId>,
    /// Ids that the memory does not hold any more, not even as votes.
    pub lost: Vec<SegmentId>,
}

impl Segments {
    /// Creates the state without ids. `limit` is the largest id to give out.
    pub fn new(limit: SegmentId) -> Self {
        Self {
            given: 0,
            limit: limit.clamp(1, MAX_SEGMENT_ID),
            live: BTreeMap::new(),
            released: ReleasedIds::default(),
            held: BTreeSet::new(),
            changed: BTreeSet::new(),
        }
    }

    /// Restores the ids of an earlier run.
    ///
    /// # Errors
    /// If the ids contradict each other.
    pub fn restored(live: &[SavedSegment], saved: SavedIds, limit: SegmentId) -> Result<Self, String> {
        let mut segments = Self::new(limit);
        let largest = live.iter().map(|segment| segment.id).max().unwrap_or(0);
        segments.given = saved.given.max(u64::from(largest));
        segments.released = ReleasedIds::restored(saved.released)?;
        for SavedSegment { id, sightings, carried } in live.iter().copied() {
            segments.live.insert(id, LiveSegment { sightings, carried, ..LiveSegment::default() });
            // The ids held by the frames before are not saved: each id is judged again.
            segments.changed.insert(id);
        }
        let mut spare = segments.released.ids();
        let known = segments.highest();
        match spare.find(|id| !(1..=known).contains(id) || segments.live.contains_key(id)) {
            Some(id) => return Err(format!("the released id {id} is in use or was never given out")),
            None => drop(spare),
        }
        Ok(segments)
    }

    /// As if Gaussians showed these ids, too; 0 is none.
    pub fn with_shown(&self, shown: impl Iterator<Item = SegmentId>) -> Cow<'_, Self> {
        let added: BTreeSet<SegmentId> = shown.filter(|id| *id != 0 && !self.is_carried(*id)).collect();
        let mut segments = Cow::Borrowed(self);
        for id in added {
            segments.to_mut().revive(id).carried = true;
        }
        segments
    }

    /// Returns the live ids to be saved, in increasing order.
    pub fn saved_live(&self) -> Vec<SavedSegment> {
        let saved = |(id, segment): (&SegmentId, &LiveSegment)| {
            let LiveSegment { sightings, carried, .. } = *segment;
            SavedSegment { id: *id, sightings, carried }
        };
        self.live.iter().map(saved).collect()
    }

    /// Returns the state to be saved besides [`Self::saved_live`].
    pub fn saved_ids(&self) -> SavedIds {
        SavedIds { given: self.given, released: self.released.saved() }
    }

    /// Number of ids given out by counting.
    #[cfg(test)]
    pub fn given(&self) -> u64 {
        self.given
    }

    /// Largest id given out so far.
    pub fn highest(&self) -> SegmentId {
        self.given.min(u64::from(self.limit)) as SegmentId
    }

    /// True if all ids that fit a 16-bit image have been given out.
    pub fn are_short_ids_given(&self) -> bool {
        self.given >= u64::from(MAX_16_BIT_ID.min(self.limit))
    }

    /// Live ids, in increasing order.
    #[cfg(test)]
    pub fn live(&self) -> impl Iterator<Item = SegmentId> + '_ {
        self.live.keys().copied()
    }

    /// True if the id was carried at the last [`Self::release_ids`].
    pub fn is_carried(&self, id: SegmentId) -> bool {
        self.live.get(&id).is_some_and(|segment| segment.carried)
    }

    /// Returns how Gaussians remember an id.
    #[cfg(test)]
    pub fn hold(&self, id: SegmentId) -> SegmentHold {
        self.live.get(&id).map_or(SegmentHold::Nothing, |segment| segment.hold)
    }

    /// Returns an id for a new object.
    pub fn add(&mut self) -> SegmentId {
        let id = self.next();
        self.live.insert(id, LiveSegment::default());
        self.changed.insert(id);
        id
    }

    /// Takes the next id.
    fn next(&mut self) -> SegmentId {
        if self.are_short_ids_given()
            && let Some(id) = self.released.pop_first()
        {
            return id;
        }
        loop {
            let id = (self.given % u64::from(self.limit)) as SegmentId + 1;
            self.given += 1;
            // With more objects than ids, two objects share an id.
            if !self.live.contains_key(&id) || self.live.len() >= self.limit as usize {
                return id;
            }
        }
    }

    /// Records a frame's predicted ids. Returns those predicted for the first time since they were given out.
    pub fn record_sightings(&mut self, predicted: &SegmentMap) -> Vec<SegmentId> {
        let mut new = Vec::new();
        for id in predicted.areas().into_keys().filter(|id| *id != 0) {
            let segment = self.revive(id);
            segment.sightings = segment.sightings.saturating_add(1);
            if segment.sightings == 1 {
                new.push(id);
            }
        }
        new
    }

    /// Returns the state of an id, making the id live if it is not.
    fn revive(&mut self, id: SegmentId) -> &mut LiveSegment {
        self.changed.insert(id);
        let Self { live, released, .. } = self;
        live.entry(id).or_insert_with(|| LiveSegment {
            sightings: released.remove(id).unwrap_or(CONFIRMED),
            ..LiveSegment::default()
        })
    }

    /// Adds the sightings of an id to those of another one that it turned out to be.
    pub fn remap(&mut self, RemappedId { from, into }: RemappedId) {
        let more = self.live.get(&from).map_or(0, |segment| segment.sightings);
        let kept = self.revive(into);
        kept.sightings = kept.sightings.saturating_add(more);
        if let Some(gone) = self.live.get_mut(&from) {
            // It must not be given to another object: earlier frames show it.
            gone.sightings = gone.sightings.max(CONFIRMED);
            self.changed.insert(from);
        }
    }

    /// Counts the frames that show an id again: `before` of its sightings are replaced by `after`.
    pub fn recount(&mut self, id: SegmentId, before: u32, after: u32) {
        if let Some(segment) = self.live.get_mut(&id) {
            segment.sightings = segment.sightings.saturating_sub(before).saturating_add(after);
            self.changed.insert(id);
        }
    }

    /// True if an id is tentative: predicted in one frame at most.
    pub fn is_tentative(&self, id: SegmentId) -> bool {
        let is_spare = || self.released.sightings(id).is_some();
        match self.live.get(&id) {
            Some(segment) => segment.sightings < CONFIRMED,
            None => id == 0 || id > self.highest() || is_spare(),
        }
    }

    /// Sets how Gaussians remember the ids in `holds`. The others stay as they are.
    pub fn set_holds(&mut self, holds: &[(SegmentId, SegmentHold)]) {
        for (id, hold) in holds {
            if *hold != SegmentHold::Nothing || self.live.contains_key(id) {
                self.revive(*id).hold = *hold;
            }
        }
    }

    /// Sets the ids that Gaussians show by themselves; no Gaussian holds any other id.
    pub fn set_shown(&mut self, shown: &BTreeSet<SegmentId>) {
        for (id, segment) in &mut self.live {
            segment.hold = if shown.contains(id) { SegmentHold::Shown } else { SegmentHold::Nothing };
            self.changed.insert(*id);
        }
    }

    /// Sets the ids to keep even if no Gaussian holds them.
    pub fn set_held(&mut self, held: BTreeSet<SegmentId>) {
        self.changed.extend(self.held.symmetric_difference(&held).copied());
        self.held = held;
    }

    /// Compares the state with that at the last call. Returns the ids that the memory has lost, and releases those seen
    /// too rarely.
    pub fn release_ids(&mut self) -> LostIds {
        let mut lost_ids = LostIds::default();
        for id in std::mem::take(&mut self.changed) {
            let Some(segment) = self.live.get_mut(&id) else { continue };
            let was_carried = segment.carried;
            segment.carried = segment.hold == SegmentHold::Shown || self.held.contains(&id);
            let LiveSegment { sightings, carried, hold, .. } = *segment;
            if was_carried && !carried {
                lost_ids.forgotten.push(id);
            }
            if !carried && hold == SegmentHold::Nothing {
                self.live.remove(&id);
                lost_ids.lost.push(id);
                if sightings < CONFIRMED {
                    self.released.push_last(id, sightings);
                }
            }
        }
        lost_ids
    }
}
