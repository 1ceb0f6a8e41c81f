//! All keyframes of a map, and the search among them.
//!
//! A keyframe takes about 38 kB: luminance with depth 19 kB, a small colour image 13 kB, features 6 kB. Their number is
//! bounded: beyond [`MAX_STORED`], the keyframe that is closest to another one is dropped, and what was attached to it is
//! attached to that other one.

mod compact_view;
mod features;
mod index;
mod small_color;

pub(crate) use compact_view::{CompactView, MAX_PIXELS, MAX_WIDTH, coarse_pyramid};
pub(crate) use features::{Descriptor, Feature, Random, detect, hamming};
pub(crate) use index::{FeatureIndex, Posting};
pub(crate) use small_color::{decoded as decoded_color, is_possible as is_possible_color};

use crate::se3;
use crate::tracked_frame::TrackedFrame;
use glam::Vec3;
use splatseg_geometry::{KeyframeId, Pose};
use std::collections::BTreeMap;

/// Maximum number of keyframes.
pub(crate) const MAX_STORED: usize = 400;

/// The latest keyframes are not dropped.
const KEPT_LATEST: usize = 20;

/// Number of features per keyframe.
const MAX_FEATURES: usize = 200;

/// Distances in space and angles between keyframes count equally in these units, metres and radians.
const UNITS: (f64, f64) = (0.3, 0.35);

/// A feature of a keyframe.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StoredFeature {
    /// Place in the keyframe's coordinates, millimetres.
    pub(crate) point: [i16; 3],
    pub(crate) descriptor: Descriptor,
}

/// A keyframe of the map.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StoredKeyframe {
    pub(crate) id: KeyframeId,
    pub(crate) world_from_key: Pose,
    /// Part of the map, from 0: the poses of different parts relative to each other are unknown.
    pub(crate) part: u32,
    /// Number of the run that made the keyframe, from 0.
    pub(crate) session: u32,
    pub(crate) view: CompactView,
    /// A small colour image, JPEG; empty in maps of earlier versions.
    pub(crate) color: Vec<u8>,
    pub(crate) features: Vec<StoredFeature>,
    /// Index of the frame in the source of this run, if its pose came with it.
    pub(crate) given_frame: Option<usize>,
}

/// All keyframes.
#[derive(Clone, Debug, Default)]
pub(crate) struct KeyframeStore {
    /// Keyframes by slot; a slot is reused.
    slots: Vec<Option<StoredKeyframe>>,
    by_id: BTreeMap<KeyframeId, u16>,
    index: FeatureIndex,
    /// Number of the next keyframe.
    pub(crate) next: KeyframeId,
    /// For each dropped keyframe, the one that what was attached to it is attached to now, and its pose relative to it.
    pub(crate) replaced: BTreeMap<KeyframeId, (KeyframeId, Pose)>,
}

impl StoredFeature {
    fn new(feature: &Feature) -> Self {
        let point = (feature.point * 1000.0).to_array().map(|part| part.round().clamp(-32_000.0, 32_000.0) as i16);
        Self { point, descriptor: feature.descriptor }
    }

    /// Place in the keyframe's coordinates, metres.
    pub(crate) fn place(&self) -> Vec3 {
        Vec3::from_array(self.point.map(|part| f32::from(part) * 0.001))
    }
}

impl StoredKeyframe {
    /// Describes a frame.
    pub(crate) fn new(id: KeyframeId, frame: &TrackedFrame<'_>, world_from_key: Pose, part: u32, session: u32) -> Self {
        let features = || detect(&frame.pyramid, MAX_FEATURES).iter().map(StoredFeature::new).collect();
        let views = || (CompactView::new(&frame.pyramid), small_color::encoded(frame.color));
        let (features, (view, color)) = rayon::join(features, views);
        Self { id, world_from_key, part, session, view, color, features, given_frame: None }
    }
}

impl KeyframeStore {
    /// Adds a keyframe. Returns the one that was dropped for it, and the one that replaces that.
    pub(crate) fn add(&mut self, keyframe: StoredKeyframe) -> Option<(KeyframeId, KeyframeId)> {
        let dropped = if self.by_id.len() >= MAX_STORED { self.drop_redundant() } else { None };
        self.insert(keyframe);
        dropped
    }

    /// Adds a keyframe, even if there are [`MAX_STORED`] already.
    pub(crate) fn insert(&mut self, keyframe: StoredKeyframe) {
        let free = self.slots.iter().position(Option::is_none);
        let slot = free.unwrap_or_else(|| {
            self.slots.push(None);
            self.slots.len() - 1
        });
        self.index.add(slot as u16, keyframe.features.iter().map(|feature| &feature.descriptor));
        self.by_id.insert(keyframe.id, slot as u16);
        self.next = self.next.max(keyframe.id.saturating_add(1));
        self.slots[slot] = Some(keyframe);
    }

    pub(crate) fn get(&self, id: KeyframeId) -> Option<&StoredKeyframe> {
        self.at(*self.by_id.get(&id)?)
    }

    pub(crate) fn get_mut(&mut self, id: KeyframeId) -> Option<&mut StoredKeyframe> {
        self.slots.get_mut(usize::from(*self.by_id.get(&id)?))?.as_mut()
    }

    /// The slot of a keyframe.
    pub(crate) fn slot_of(&self, id: KeyframeId) -> Option<u16> {
        self.by_id.get(&id).copied()
    }

    /// The keyframe in a slot.
    pub(crate) fn at(&self, slot: u16) -> Option<&StoredKeyframe> {
        self.slots.get(usize::from(slot))?.as_ref()
    }

    /// Keyframes by increasing number.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &StoredKeyframe> {
        self.by_id.values().filter_map(|slot| self.at(*slot))
    }

    /// The keyframe itself, or the one that replaces it if it was dropped.
    pub(crate) fn kept(&self, id: KeyframeId) -> KeyframeId {
        self.replaced.get(&id).map_or(id, |(kept, _)| *kept)
    }

    /// The part of the map that a keyframe is or was in.
    pub(crate) fn part_of(&self, id: KeyframeId) -> Option<u32> {
        Some(self.get(self.kept(id))?.part)
    }

    pub(crate) fn len(&self) -> usize {
        self.by_id.len()
    }

    /// Number of slots.
    pub(crate) fn slot_count(&self) -> usize {
        self.slots.len()
    }

    pub(crate) fn index(&self) -> &FeatureIndex {
        &self.index
    }

    /// The pose that a keyframe has or, if it was dropped, would have now.
    pub(crate) fn pose_of(&self, id: KeyframeId) -> Option<Pose> {
        match self.replaced.get(&id) {
            Some((kept, kept_from_dropped)) => Some(self.get(*kept)?.world_from_key * *kept_from_dropped),
            None => Some(self.get(id)?.world_from_key),
        }
    }

    /// The poses of all keyframes, dropped ones too.
    pub(crate) fn poses(&self) -> BTreeMap<KeyframeId, Pose> {
        let mut poses: BTreeMap<KeyframeId, Pose> =
            self.iter().map(|keyframe| (keyframe.id, keyframe.world_from_key)).collect();
        let dropped = self.replaced.iter().filter_map(|(id, (kept, kept_from_dropped))| {
            Some((*id, self.get(*kept)?.world_from_key * *kept_from_dropped))
        });
        let dropped: Vec<(KeyframeId, Pose)> = dropped.collect();
        poses.extend(dropped);
        poses
    }

    /// Drops the keyframe that is closest to another one of the same part.
    pub(crate) fn drop_redundant(&mut self) -> Option<(KeyframeId, KeyframeId)> {
        let all: Vec<&StoredKeyframe> = self.iter().collect();
        let candidates = &all[..all.len().saturating_sub(KEPT_LATEST)];
        let mut closest: Option<(f64, KeyframeId, KeyframeId)> = None;
        for (index, one) in candidates.iter().enumerate() {
            for other in candidates[..index].iter().filter(|other| other.part == one.part) {
                let distance = distance(&one.world_from_key, &other.world_from_key);
                if closest.is_none_or(|(least, ..)| distance < least) {
                    // The later one is dropped: older ones have more attached to them.
                    closest = Some((distance, one.id, other.id));
                }
            }
        }
        let (_, dropped, kept) = closest?;
        self.drop_keyframe(dropped, kept);
        Some((dropped, kept))
    }

    /// Drops a keyframe, and attaches what was attached to it to another one.
    pub(crate) fn drop_keyframe(&mut self, dropped: KeyframeId, kept: KeyframeId) {
        let Some(slot) = self.by_id.remove(&dropped) else { return };
        let (Some(gone), Some(kept_pose)) =
            (self.slots[usize::from(slot)].take(), self.get(kept).map(|keyframe| keyframe.world_from_key))
        else {
            return;
        };
        self.index.remove(slot, gone.features.iter().map(|feature| &feature.descriptor));
        let kept_from_dropped = kept_pose.inverse() * gone.world_from_key;
        for (target, relative) in self.replaced.values_mut().filter(|(target, _)| *target == dropped) {
            (*target, *relative) = (kept, kept_from_dropped * *relative);
        }
        self.replaced.insert(dropped, (kept, kept_from_dropped));
    }
}

/// Distance between two poses in units in which positions and angles count equally; see [`UNITS`].
pub(crate) fn distance(one: &Pose, other: &Pose) -> f64 {
    let apart = one.translation().distance(other.translation());
    // 2 sin of half the angle, from the trace of the relative rotation.
    let (a, b) = (one.rotation(), other.rotation());
    let trace = a.x_axis.dot(b.x_axis) + a.y_axis.dot(b.y_axis) + a.z_axis.dot(b.z_axis);
    apart / UNITS.0 + (3.0 - trace).max(0.0).sqrt() / UNITS.1
}

/// Distance between two poses, metres, and angle between them, radians.
pub(crate) fn apart(one: &Pose, other: &Pose) -> (f64, f64) {
    let (_, angle) = se3::size(&(one.inverse() * *other));
    (one.translation().distance(other.translation()), angle)
}
