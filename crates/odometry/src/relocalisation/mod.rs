//! Recognises the place that a frame shows among all keyframes.
//!
//! 1. Features are looked up in the index; keyframes with many similar ones are candidates.
//! 2. The rigid motion that most of the matches agree with, in three dimensions (`rigid.rs`). Matches with all keyframes
//!    around the candidate take part.
//! 3. The frame is aligned with the nearest keyframe, as in tracking.
//! 4. The pose is accepted only if depth and image agree with the keyframe, and no other place fits nearly as well: a
//!    wrong place is far worse than none.

mod rigid;

use crate::alignment::Fit;
use crate::keyframe::Reference;
use crate::keyframes::{
    Feature, KeyframeStore, Posting, StoredKeyframe, apart, coarse_pyramid, detect, distance, hamming,
};
use crate::prior::MotionPrior;
use crate::pyramid::Pyramid;
use glam::DVec3;
use rigid::{PointPair, find_motion};
use splatseg_geometry::{KeyframeId, Pose};

/// Number of features of a frame that is searched for.
const MAX_FEATURES: usize = 350;

/// A frame with fewer features cannot be recognised.
const MIN_FEATURES: usize = 40;

/// Descriptors of the same place differ in at most this many of their 256 bits.
pub(crate) const MAX_DIFFERENCE: u32 = 64;

/// Number of places that are tried.
const CANDIDATES: usize = 4;

/// Matches with this many keyframes around a candidate take part...
const NEIGHBOURS: usize = 12;
/// ...if they are closer than this, as in [`distance`].
const NEIGHBOURHOOD: f64 = 5.0;

/// Candidates are different places if they are at least this far apart, as in [`distance`].
const OTHER_PLACE: f64 = 3.0;

/// Number of matches per feature.
const MATCHES_PER_FEATURE: usize = 3;

/// A place is accepted only if this many features agree...
const MIN_INLIERS: usize = 12;
/// ...or this many if nothing else is known of where the camera is: corners of rooms look alike...
pub(crate) const MIN_INLIERS_LOST: usize = 24;
/// ...and at least this many times as many as at any other place.
const MIN_RATIO: f64 = 1.4;

/// Depth and image must agree with the keyframe in this share of the points in view.
const MIN_AGREEMENT: f32 = 0.7;
/// This share of the keyframe's points must be in view.
const MIN_OVERLAP: f32 = 0.3;

/// The alignment may move the camera this far from where the features put it, metres and radians.
const MAX_CHANGE: (f64, f64) = (0.15, 0.1);

/// A frame whose place is searched for.
pub(crate) struct Query {
    features: Vec<Feature>,
    /// The frame at the resolution of keyframes.
    pyramid: Pyramid,
}

/// The place of a frame.
pub(crate) struct Recognised {
    pub(crate) keyframe: KeyframeId,
    pub(crate) world_from_camera: Pose,
    /// Keyframe from camera.
    pub(crate) key_from_camera: Pose,
    /// Number of features that agree.
    pub(crate) inliers: usize,
    pub(crate) fit: Option<Fit>,
    /// Share of depth and image that agree.
    pub(crate) agreement: f32,
    /// Share of the keyframe's points in view.
    pub(crate) overlap: f32,
}

/// A match of a frame's feature with one of a keyframe.
#[derive(Clone, Copy)]
struct Match {
    feature: u16,
    posting: Posting,
    difference: u32,
}

/// A place that matches, in the coordinates of a keyframe.
struct Place<'a> {
    candidate: &'a StoredKeyframe,
    key_from_camera: Pose,
    inliers: usize,
}

impl Query {
    pub(crate) fn new(pyramid: &Pyramid) -> Self {
        Self { features: detect(pyramid, MAX_FEATURES), pyramid: coarse_pyramid(pyramid) }
    }

    /// A keyframe whose place is searched for among the others. `None` if its image is damaged.
    pub(crate) fn of_keyframe(keyframe: &StoredKeyframe) -> Option<Self> {
        let stored = keyframe.features.iter();
        let features = stored.map(|stored| Feature { point: stored.place(), descriptor: stored.descriptor }).collect();
        Some(Self { features, pyramid: keyframe.view.pyramid()? })
    }

    /// True if the frame shows enough to be recognised.
    pub(crate) fn has_view(&self) -> bool {
        self.features.len() >= MIN_FEATURES
    }

    /// Finds the frame's place among the keyframes that `is_candidate` selects. `seed` is that of the random draws.
    pub(crate) fn recognise(
        &self,
        store: &KeyframeStore,
        is_candidate: impl Fn(&StoredKeyframe) -> bool,
        seed: u64,
    ) -> Option<Recognised> {
        let matches = self.matches(store, is_candidate);
        let candidates = candidates(store, &matches);
        let places = candidates.into_iter().filter_map(|candidate| self.place(store, &matches, candidate, seed));
        let mut places: Vec<Place<'_>> = places.collect();
        places.sort_by_key(|place| std::cmp::Reverse(place.inliers));
        let best = places.first()?;
        if best.inliers < MIN_INLIERS || !is_unique(&places) {
            return None;
        }
        self.aligned(store, best)
    }

    /// The matches of all features, by feature.
    fn matches(&self, store: &KeyframeStore, is_candidate: impl Fn(&StoredKeyframe) -> bool) -> Vec<Match> {
        let is_open: Vec<bool> =
            (0..store.slot_count()).map(|slot| store.at(slot as u16).is_some_and(&is_candidate)).collect();
        let mut matches = Vec::new();
        // Of several similar features of a keyframe the most similar one.
        let mut best: Vec<Option<Match>> = vec![None; store.slot_count()];
        for (number, feature) in self.features.iter().enumerate() {
            let mut touched = Vec::new();
            store.index().visit(&feature.descriptor, |posting| {
                let slot = usize::from(posting.slot);
                let Some(keyframe) = store.at(posting.slot).filter(|_| is_open[slot]) else { return };
                let Some(stored) = keyframe.features.get(usize::from(posting.feature)) else { return };
                let difference = hamming(&feature.descriptor, &stored.descriptor);
                if difference > MAX_DIFFERENCE {
                    return;
                }
                if best[slot].is_none() {
                    touched.push(slot);
                }
                if best[slot].is_none_or(|best| difference < best.difference) {
                    best[slot] = Some(Match { feature: number as u16, posting, difference });
                }
            });
            // By number, not by slot: a map that was saved and loaded has other slots.
            touched.sort_unstable_by_key(|slot| store.at(*slot as u16).map(|keyframe| keyframe.id));
            matches.extend(touched.into_iter().filter_map(|slot| best[slot].take()));
        }
        matches
    }

    /// The motion that most matches around a candidate agree with.
    fn place<'a>(
        &self,
        store: &KeyframeStore,
        matches: &[Match],
        candidate: &'a StoredKeyframe,
        seed: u64,
    ) -> Option<Place<'a>> {
        let mut around: Vec<(f64, &StoredKeyframe)> = store
            .iter()
            .filter(|other| other.part == candidate.part)
            .map(|other| (distance(&other.world_from_key, &candidate.world_from_key), other))
            .filter(|(distance, _)| *distance <= NEIGHBOURHOOD)
            .collect();
        around.sort_by(|one, other| one.0.total_cmp(&other.0));
        around.truncate(NEIGHBOURS);
        let mut from_slot = vec![None; store.slot_count()];
        let key_from_world = candidate.world_from_key.inverse();
        for (_, other) in &around {
            let slot = store.slot_of(other.id)?;
            from_slot[usize::from(slot)] = Some((key_from_world * other.world_from_key).relative_to(DVec3::ZERO));
        }
        let near: Vec<&Match> =
            matches.iter().filter(|found| from_slot[usize::from(found.posting.slot)].is_some()).collect();
        let mut pairs = Vec::new();
        for of_feature in near.chunk_by(|one, other| one.feature == other.feature) {
            let mut of_feature = of_feature.to_vec();
            of_feature.sort_by_key(|found| found.difference);
            for found in of_feature.into_iter().take(MATCHES_PER_FEATURE) {
                let stored = store.at(found.posting.slot)?.features.get(usize::from(found.posting.feature))?;
                let there = from_slot[usize::from(found.posting.slot)]?.to_world(stored.place());
                pairs.push(PointPair {
                    feature: found.feature,
                    here: self.features[usize::from(found.feature)].point,
                    there,
                });
            }
        }
        let motion = find_motion(&pairs, seed)?;
        Some(Place { candidate, key_from_camera: motion.pose, inliers: motion.inliers })
    }

    /// Aligns the frame with the keyframe nearest to a place, and checks the result.
    fn aligned(&self, store: &KeyframeStore, place: &Place<'_>) -> Option<Recognised> {
        let start = place.candidate.world_from_key * place.key_from_camera;
        let same_part = store.iter().filter(|keyframe| keyframe.part == place.candidate.part);
        let nearest = same_part.min_by(|one, other| {
            distance(&one.world_from_key, &start).total_cmp(&distance(&other.world_from_key, &start))
        })?;
        let found = self.align(nearest, &start)?;
        let (moved, turned) = apart(&found.world_from_camera, &start);
        let agrees = moved <= MAX_CHANGE.0 && turned <= MAX_CHANGE.1;
        (agrees && found.is_sure()).then_some(Recognised { inliers: place.inliers, ..found })
    }

    /// Aligns the frame with a keyframe, from a start nearby.
    pub(crate) fn align(&self, keyframe: &StoredKeyframe, start: &Pose) -> Option<Recognised> {
        let reference = Reference::new(&keyframe.view.pyramid()?, keyframe.world_from_key);
        let prior = MotionPrior { predicted: *start, deviation: crate::prior::MAX_ERROR };
        let aligned = reference.align(&self.pyramid, start, &prior);
        let shares = aligned.counts.inliers();
        // Without depth in common there is no proof.
        let agreement = shares[0]?.min(shares[1].unwrap_or(1.0));
        Some(Recognised {
            keyframe: keyframe.id,
            world_from_camera: aligned.world_from_camera,
            key_from_camera: keyframe.world_from_key.inverse() * aligned.world_from_camera,
            inliers: 0,
            agreement,
            overlap: aligned.counts.visible / reference.size().max(1) as f32,
            fit: aligned.fit,
        })
    }
}

impl Recognised {
    /// True if depth and image prove the place.
    pub(crate) fn is_sure(&self) -> bool {
        self.agreement >= MIN_AGREEMENT && self.overlap >= MIN_OVERLAP
    }
}

/// The keyframes with the most matches, of different places.
fn candidates<'a>(store: &'a KeyframeStore, matches: &[Match]) -> Vec<&'a StoredKeyframe> {
    let mut counts = vec![0usize; store.slot_count()];
    for found in matches {
        counts[usize::from(found.posting.slot)] += 1;
    }
    let keyframes = (0..counts.len()).filter_map(|slot| Some((counts[slot], store.at(slot as u16)?)));
    let mut order: Vec<(usize, &StoredKeyframe)> = keyframes.filter(|(count, _)| *count >= 4).collect();
    order.sort_by_key(|(count, keyframe)| (std::cmp::Reverse(*count), keyframe.id));
    let mut chosen: Vec<&StoredKeyframe> = Vec::new();
    for (_, keyframe) in order {
        let is_other = |other: &&StoredKeyframe| {
            other.part != keyframe.part || distance(&other.world_from_key, &keyframe.world_from_key) >= OTHER_PLACE
        };
        if chosen.iter().all(is_other) {
            chosen.push(keyframe);
        }
        if chosen.len() == CANDIDATES {
            break;
        }
    }
    chosen
}

/// True if no other place fits nearly as well as the first.
fn is_unique(places: &[Place<'_>]) -> bool {
    let world = |place: &Place<'_>| place.candidate.world_from_key * place.key_from_camera;
    let Some((best, others)) = places.split_first() else { return false };
    others.iter().all(|other| {
        let is_same = other.candidate.part == best.candidate.part && distance(&world(other), &world(best)) < 1.0;
        is_same || best.inliers as f64 >= MIN_RATIO * other.inliers as f64
    })
}
