//! Errors of tracks from one frame to the next.
//!
//! In this order: a track is **lost**, for some frames or until prompted, when its objects reappear after they were
//! hidden; two tracks **swap** their objects; a track becomes a **duplicate** of another; a mask **drifts** into a
//! neighbouring object, farther in each frame. A track gets at most one new error per frame.

use super::scene::TrueFrame;
use super::{Drift, Loss, SimTrack, SimTrackerSettings};
use crate::FrameChance;
use rand::RngExt;
use splatseg_geometry::SegmentId;
use std::collections::{BTreeMap, BTreeSet};

/// Objects are hidden (out of view or occluded) if less than this fraction of their largest area so far is visible.
const HIDDEN_FRACTION: f64 = 0.1;

/// Kinds of random decisions. The oracle's decisions have smaller numbers, so that both can use one seed.
#[derive(Clone, Copy, Debug)]
enum Decision {
    Loss = 101,
    Swap,
    Duplicate,
    Drift,
}

impl From<Decision> for u64 {
    fn from(decision: Decision) -> Self {
        decision as Self
    }
}

/// The errors of one frame.
pub(super) struct FrameFaults<'a> {
    pub(super) frame: &'a TrueFrame,
    pub(super) model: &'a SimTrackerSettings,
    pub(super) chance: FrameChance<'a>,
}

/// Identifies a track in random draws: the first object that it follows, and its rank among the tracks of this object.
type Key = (SegmentId, usize);

impl FrameFaults<'_> {
    /// Applies this frame's errors to the tracks.
    pub(super) fn apply(&self, tracks: &mut BTreeMap<SegmentId, SimTrack>) {
        let keys = keys(tracks);
        for (id, track) in tracks.iter_mut() {
            self.update(track, keys.get(id).copied());
        }
        let mut untouched: BTreeMap<SegmentId, Key> = keys;
        untouched.retain(|id, _| self.centroid(&tracks[id]).is_some() && tracks[id].drift.is_none());
        for (id, key) in untouched.clone() {
            if self.happens(Decision::Swap, key, self.model.swap_rate)
                && untouched.contains_key(&id)
                && let Some(other) = self.nearest(tracks, id).filter(|other| untouched.contains_key(other))
            {
                let (first, second) = (tracks[&id].target.clone(), tracks[&other].target.clone());
                tracks.insert(id, SimTrack { target: second, ..SimTrack::default() });
                tracks.insert(other, SimTrack { target: first, ..SimTrack::default() });
                untouched.remove(&id);
                untouched.remove(&other);
            }
        }
        for (id, key) in untouched.clone() {
            if self.happens(Decision::Duplicate, key, self.model.duplicate_rate)
                && let Some(other) = self.nearest(tracks, id)
            {
                let target = tracks[&other].target.clone();
                tracks.insert(id, SimTrack { target, ..SimTrack::default() });
                untouched.remove(&id);
            }
        }
        for (id, key) in untouched {
            if self.happens(Decision::Drift, key, self.model.drift_rate)
                && let Some(track) = tracks.get_mut(&id)
                && let Some(into) = self.frame.neighbour(&self.frame.union(&track.target.objects))
            {
                track.drift = Some(Drift { into, frames: 1 });
            }
        }
    }

    /// Updates the visibility of a track's objects, and its drift and loss.
    fn update(&self, track: &mut SimTrack, key: Option<Key>) {
        let area = self.frame.union(&track.target.objects).area();
        track.target.largest_area = track.target.largest_area.max(area);
        let hidden = area == 0 || (area as f64) < HIDDEN_FRACTION * track.target.largest_area as f64;
        let returns = track.target.hidden && !hidden;
        track.target.hidden = hidden;
        if hidden {
            track.drift = None;
            return;
        }
        if let Some(drift) = &mut track.drift {
            drift.frames += 1;
        }
        track.loss = match track.loss {
            Some(Loss::Frames(left)) if left > 1 => Some(Loss::Frames(left - 1)),
            Some(Loss::Lasting) => Some(Loss::Lasting),
            Some(Loss::Frames(_)) | None => None,
        };
        if let (true, None, Some(key)) = (returns, track.loss, key) {
            track.loss = self.loss(key);
        }
    }

    fn loss(&self, (object, rank): Key) -> Option<Loss> {
        let mut random = self.chance.of_frame(Decision::Loss, object, rank);
        let [lost, lasting, length]: [f64; 3] = std::array::from_fn(|_| random.random());
        if lost >= self.model.loss_rate {
            return None;
        }
        if lasting < self.model.lasting_loss_fraction {
            return Some(Loss::Lasting);
        }
        // Geometrically distributed: the number of trials until the first success, each with probability 1 / mean.
        let more = (1.0 - length).ln() / (1.0 - 1.0 / self.model.loss_frames).ln();
        Some(Loss::Frames(1 + more.clamp(0.0, 1e6) as usize))
    }

    fn happens(&self, decision: Decision, (object, rank): Key, rate: f64) -> bool {
        self.chance.of_frame(decision, object, rank).random::<f64>() < rate
    }

    /// Returns the track nearest to `id` in the image that follows different objects. Ties go to the smallest id.
    fn nearest(&self, tracks: &BTreeMap<SegmentId, SimTrack>, id: SegmentId) -> Option<SegmentId> {
        let own = &tracks[&id];
        let from = self.centroid(own)?;
        let others = tracks.iter().filter(|(_, other)| other.target.objects != own.target.objects);
        let distances = others.filter_map(|(other, track)| {
            let to = self.centroid(track)?;
            Some(((from.0 - to.0).powi(2) + (from.1 - to.1).powi(2), *other))
        });
        distances.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, other)| other)
    }

    /// Returns the centroid of a track in the image. `None` if the track is lost or hidden.
    fn centroid(&self, track: &SimTrack) -> Option<(f64, f64)> {
        if track.loss.is_some() || track.target.hidden {
            return None;
        }
        self.frame.union(&track.target.objects).centroid()
    }
}

fn keys(tracks: &BTreeMap<SegmentId, SimTrack>) -> BTreeMap<SegmentId, Key> {
    let mut ranks: BTreeMap<SegmentId, usize> = BTreeMap::new();
    let first = |objects: &BTreeSet<SegmentId>| objects.first().copied();
    let keyed = tracks.iter().filter_map(|(id, track)| {
        let object = first(&track.target.objects)?;
        let rank = ranks.entry(object).or_insert(0);
        *rank += 1;
        Some((*id, (object, *rank - 1)))
    });
    keyed.collect()
}
