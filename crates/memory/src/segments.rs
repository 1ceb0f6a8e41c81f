//! The ids that a memory gives, and the state of each.

mod released;
#[cfg(test)]
mod tests;

use crate::ABSTAIN;
use released::ReleasedIds;
pub(crate) use released::SavedRelease;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};

/// The largest id: an 8-bit RGB image holds 24 bits.
pub const MAX_SEGMENT_ID: SegmentId = (1 << 24) - 1;

/// Ids up to this fit a 16-bit image. They are all given before a released one is given again.
pub const MAX_16_BIT_ID: SegmentId = u16::MAX as SegmentId;

/// An id that is seen again although nothing was known of it any more had been seen in this many frames at least.
const CONFIRMED: u32 = 2;

/// How the Gaussians of a map hold an id.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum SegmentHold {
    /// Not at all.
    #[default]
    Nothing,
    /// Some have votes for it, but show another one.
    Votes,
    /// Some show it by themselves.
    Shown,
}

/// The ids of a memory.
///
/// Ids count up to [`MAX_16_BIT_ID`]. From then on, released ids are given again, those released first before others: ids
/// whose thing was seen in one frame only and of which the memory has nothing any more. Only if there are none do ids
/// count on, up to a limit, and then from 1 again without those that are in use. So the state that is kept is bounded by
/// what the memory holds.
#[derive(Debug)]
pub(crate) struct Segments {
    /// Ids that were given for the first time, counted on when they start from 1 again.
    given: u64,
    /// The largest id.
    limit: SegmentId,
    /// Ids that were seen since they were given, or given in this frame.
    live: BTreeMap<SegmentId, LiveSegment>,
    /// Ids that were taken back before anything was seen under them: they are given again first.
    taken_back: BTreeSet<SegmentId>,
    released: ReleasedIds,
    /// Ids of the remembered regions without depth.
    regions: BTreeSet<SegmentId>,
    /// Live ids whose state may have changed since [`Self::settle`].
    changed: BTreeSet<SegmentId>,
}

/// The state of an id.
#[derive(Clone, Copy, Debug, Default)]
struct LiveSegment {
    /// Frames in which a prediction had the id.
    sightings: u32,
    /// Whether anything carried the id at the last [`Segments::settle`].
    carried: bool,
    hold: SegmentHold,
    /// If the id was given again: how often its former thing had been seen.
    before: Option<u32>,
}

/// An id as it is saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SavedSegment {
    pub id: SegmentId,
    pub sightings: u32,
    pub carried: bool,
}

/// What is saved of ids that the memory has nothing of.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedIds {
    /// Ids given for the first time.
    given: u64,
    /// Ids that were taken back.
    taken_back: BTreeSet<SegmentId>,
    /// In the order in which they are given again.
    released: Vec<SavedRelease>,
}

/// Ids that the memory has lost.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Settled {
    /// Ids that something carried and nothing carries any more.
    pub forgotten: Vec<SegmentId>,
    /// Ids of which the memory has nothing any more, not even votes.
    pub lost: Vec<SegmentId>,
}

impl Segments {
    /// No ids yet; the largest will be `limit`.
    pub fn new(limit: SegmentId) -> Self {
        Self {
            given: 0,
            limit: limit.clamp(1, MAX_SEGMENT_ID),
            live: BTreeMap::new(),
            taken_back: BTreeSet::new(),
            released: ReleasedIds::default(),
            regions: BTreeSet::new(),
            changed: BTreeSet::new(),
        }
    }

    /// The ids of an earlier run.
    ///
    /// # Errors
    /// If no run can have left them.
    pub fn restored(live: &[SavedSegment], saved: SavedIds, limit: SegmentId) -> Result<Self, String> {
        let mut segments = Self::new(limit);
        let largest = live.iter().map(|segment| segment.id).max().unwrap_or(0);
        segments.given = saved.given.max(u64::from(largest));
        segments.released = ReleasedIds::restored(saved.released)?;
        segments.taken_back = saved.taken_back;
        for SavedSegment { id, sightings, carried } in live.iter().copied() {
            segments.live.insert(id, LiveSegment { sightings, carried, ..LiveSegment::default() });
        }
        let mut spare = segments.taken_back.iter().copied().chain(segments.released.ids());
        let known = segments.highest();
        match spare.find(|id| !(1..=known).contains(id) || segments.live.contains_key(id)) {
            Some(id) => return Err(format!("the id {id} cannot be given again")),
            None => drop(spare),
        }
        Ok(segments)
    }

    /// The ids of which the memory has something, in increasing order.
    pub fn saved_live(&self) -> Vec<SavedSegment> {
        let saved = |(id, segment): (&SegmentId, &LiveSegment)| {
            let LiveSegment { sightings, carried, .. } = *segment;
            SavedSegment { id: *id, sightings, carried }
        };
        self.live.iter().map(saved).collect()
    }

    /// What is saved besides [`Self::saved_live`].
    pub fn saved_ids(&self) -> SavedIds {
        SavedIds { given: self.given, taken_back: self.taken_back.clone(), released: self.released.saved() }
    }

    /// Number of ids given for the first time.
    #[cfg(test)]
    pub fn given(&self) -> u64 {
        self.given
    }

    /// The largest id given so far.
    pub fn highest(&self) -> SegmentId {
        self.given.min(u64::from(self.limit)) as SegmentId
    }

    /// Whether all ids that fit a 16-bit image were given.
    pub fn are_short_ids_given(&self) -> bool {
        self.given >= u64::from(MAX_16_BIT_ID.min(self.limit))
    }

    /// The ids of which the memory has something, in increasing order.
    pub fn live(&self) -> impl Iterator<Item = SegmentId> + '_ {
        self.live.keys().copied()
    }

    /// Whether anything carried an id when that was last looked at.
    pub fn is_carried(&self, id: SegmentId) -> bool {
        self.live.get(&id).is_some_and(|segment| segment.carried)
    }

    /// How Gaussians hold an id.
    #[cfg(test)]
    pub fn hold(&self, id: SegmentId) -> SegmentHold {
        self.live.get(&id).map_or(SegmentHold::Nothing, |segment| segment.hold)
    }

    /// An id for a new thing.
    pub fn add(&mut self) -> SegmentId {
        let (id, before) = self.next();
        self.live.insert(id, LiveSegment { before, ..LiveSegment::default() });
        self.changed.insert(id);
        id
    }

    /// The id to be given next and, if its former thing was seen, how often.
    fn next(&mut self) -> (SegmentId, Option<u32>) {
        if let Some(id) = self.taken_back.pop_first() {
            return (id, None);
        }
        if self.are_short_ids_given()
            && let Some((id, sightings)) = self.released.pop_first()
        {
            return (id, Some(sightings));
        }
        loop {
            let id = (self.given % u64::from(self.limit)) as SegmentId + 1;
            self.given += 1;
            // With more things than ids, two share one.
            if !self.live.contains_key(&id) || self.live.len() >= self.limit as usize {
                return (id, None);
            }
        }
    }

    /// Takes an id back if nothing was seen under it since it was given.
    pub fn take_back(&mut self, id: SegmentId) {
        if self.live.get(&id).is_some_and(|segment| segment.sightings == 0) {
            match self.live.remove(&id).and_then(|segment| segment.before) {
                Some(sightings) => self.released.push_first(id, sightings),
                None => {
                    self.taken_back.insert(id);
                }
            }
        } else if self.released.sightings(id) == Some(0) {
            self.released.remove(id);
            self.taken_back.insert(id);
        }
    }

    /// Counts the ids that a frame's predictions have. Returns those that are seen for the first time since they were
    /// given.
    pub fn note_sightings(&mut self, seen: &SegmentMap) -> Vec<SegmentId> {
        let mut new = Vec::new();
        for id in seen.areas().into_keys().filter(|id| *id != ABSTAIN && *id != 0) {
            let segment = self.revive(id);
            segment.sightings = segment.sightings.saturating_add(1);
            if segment.sightings == 1 {
                new.push(id);
            }
        }
        new
    }

    /// Makes an id live that Gaussians are about to hold, if it is not.
    pub fn keep(&mut self, id: SegmentId) {
        self.revive(id);
    }

    /// The state of an id that is live from now on: what is known of it if it is released.
    fn revive(&mut self, id: SegmentId) -> &mut LiveSegment {
        self.changed.insert(id);
        let Self { live, taken_back, released, .. } = self;
        live.entry(id).or_insert_with(|| {
            let spare = if taken_back.remove(&id) { Some(0) } else { released.remove(id) };
            LiveSegment { sightings: spare.unwrap_or(CONFIRMED), ..LiveSegment::default() }
        })
    }

    /// Whether the thing of an id was seen in one frame at most.
    pub fn is_tentative(&self, id: SegmentId) -> bool {
        let is_spare = || self.taken_back.contains(&id) || self.released.sightings(id).is_some();
        match self.live.get(&id) {
            Some(segment) => segment.sightings < CONFIRMED,
            None => id == 0 || id > self.highest() || is_spare(),
        }
    }

    /// Takes note of how Gaussians hold some ids; the others are held as before.
    pub fn note_holds(&mut self, holds: &[(SegmentId, SegmentHold)]) {
        for (id, hold) in holds {
            if *hold != SegmentHold::Nothing || self.live.contains_key(id) {
                self.revive(*id).hold = *hold;
            }
        }
    }

    /// Takes note of all ids that Gaussians show by themselves.
    pub fn note_shown(&mut self, shown: &BTreeSet<SegmentId>) {
        for (id, segment) in &mut self.live {
            segment.hold = if shown.contains(id) { SegmentHold::Shown } else { SegmentHold::Nothing };
            self.changed.insert(*id);
        }
    }

    /// Takes note of all ids of regions without depth.
    pub fn note_regions(&mut self, regions: BTreeSet<SegmentId>) {
        self.changed.extend(self.regions.symmetric_difference(&regions).copied());
        self.regions = regions;
    }

    /// Compares the noted state with that of the last call: returns what the memory has lost, and releases ids.
    pub fn settle(&mut self) -> Settled {
        let mut settled = Settled::default();
        for id in std::mem::take(&mut self.changed) {
            let Some(segment) = self.live.get_mut(&id) else { continue };
            let was_carried = segment.carried;
            segment.carried = segment.hold == SegmentHold::Shown || self.regions.contains(&id);
            let LiveSegment { sightings, carried, hold, .. } = *segment;
            if was_carried && !carried {
                settled.forgotten.push(id);
            }
            if !carried && hold == SegmentHold::Nothing {
                self.live.remove(&id);
                settled.lost.push(id);
                if sightings < CONFIRMED {
                    self.released.push_last(id, sightings);
                }
            }
        }
        settled
    }
}
