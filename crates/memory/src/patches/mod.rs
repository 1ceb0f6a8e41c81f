//! Evidence about which places of the map are one object, for segmenters that say how surely pairs of pixels are.
//!
//! A patch is a group of neighbouring Gaussians that the map got from one frame, in one region of the segmenter's finer cut
//! and one cell of its grid. Every frame adds the log-odds of all pairs of pixels that show two different patches
//! ([`frame_pairs`]), and counts which ids were predicted where a patch is seen. Objects are a partition of the patches
//! ([`partition`]), each with the id that most frames gave it ([`objects`]). So what a frame found is kept with how sure it was, for as long as the surface is there, where votes
//! only remember the verdicts of the last few frames.

mod frame_pairs;
mod frame_patches;
mod objects;
mod partition;
mod patch_pairs;
mod saved;
#[cfg(test)]
mod tests;

use crate::MemorySettings;
use crate::map::NewGaussian;
use crate::recall::Recall;
use frame_pairs::pairs_of;
use frame_patches::{FrameCells, FramePatches};
use patch_pairs::PatchPairs;
use splatseg_geometry::{Affinities, SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{BuildHasherDefault, Hasher};

pub(crate) use objects::Scope;
pub(crate) use saved::SavedPatches;

/// Number that stands for no patch.
pub(crate) const NO_PATCH: u32 = u32::MAX;

/// Ids that a patch remembers. A new one replaces the one with the fewest pixels.
const IDS_PER_PATCH: usize = 8;

/// Pairs of pixels between two patches that are remembered. Beyond them, sum and count are halved.
const MAX_PAIRS: u32 = 1 << 22;

/// A hash for keys that differ in few bits: the multiplication moves them to the upper ones.
#[derive(Default)]
pub(crate) struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0
    }

    fn write(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.write_u64(u64::from(*byte)));
    }

    fn write_u64(&mut self, key: u64) {
        let product = (self.0 ^ key).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        self.0 = product ^ (product >> 32);
    }
}

type ByKey<T> = HashMap<u64, T, BuildHasherDefault<KeyHasher>>;

/// Evidence about a pair of patches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct PairEvidence {
    /// Sum of the log-odds, units of 1 / [`Affinities::UNIT`].
    pub sum: i32,
    /// Number of pairs of pixels.
    pub count: u32,
}

impl PairEvidence {
    fn add(&mut self, more: Self) {
        self.sum += more.sum;
        self.count += more.count;
        while self.count > MAX_PAIRS {
            self.sum /= 2;
            self.count /= 2;
        }
    }
}

/// A group of neighbouring Gaussians that are one object.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Patch {
    /// Number of its Gaussians; without any, its number is given to a new patch.
    gaussians: u32,
    /// Pixels of all frames at which each id was predicted there, by increasing id.
    pixels_of_ids: Vec<(SegmentId, u32)>,
    /// Frames in which it was seen as any id.
    frames: u32,
    /// Number of the latest of them, as [`PatchGraph::learnt`] counts.
    last_seen: u32,
    /// Id of the object that it is part of, as last decided; 0 for none.
    object: SegmentId,
}

impl Patch {
    fn count(&mut self, id: SegmentId, pixels: u32) {
        match self.pixels_of_ids.binary_search_by_key(&id, |(id, _)| *id) {
            Ok(place) => self.pixels_of_ids[place].1 = self.pixels_of_ids[place].1.saturating_add(pixels),
            Err(place) => self.pixels_of_ids.insert(place, (id, pixels)),
        }
        if self.pixels_of_ids.len() > IDS_PER_PATCH {
            let others = self.pixels_of_ids.iter().enumerate().filter(|(_, (other, _))| *other != id);
            let rarest = others.min_by_key(|(_, (_, pixels))| *pixels).map(|(place, _)| place);
            rarest.map(|place| self.pixels_of_ids.remove(place));
        }
    }
}

/// The patches of a map and the evidence about pairs of them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PatchGraph {
    /// Patch of each Gaussian; [`NO_PATCH`] for those of frames without affinities.
    of_gaussians: Vec<u32>,
    patches: Vec<Patch>,
    /// Patches without Gaussians and evidence.
    unused: BTreeSet<u32>,
    pairs: PatchPairs,
    /// Frames learnt since the graph was created or restored.
    learnt: u32,
    /// True if it was decided what the objects are; see [`Self::decide`].
    is_decided: bool,
}

/// Key of a pair of patches, the same in both orders.
fn pair_key(one: u32, other: u32) -> u64 {
    u64::from(one.min(other)) << 32 | u64::from(one.max(other))
}

/// The patches of a [`pair_key`].
fn patches_of(key: u64) -> (u32, u32) {
    ((key >> 32) as u32, key as u32)
}

impl PatchGraph {
    /// True if there is no evidence.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Adds new Gaussians until there are `gaussians`, without evidence about them.
    pub fn add_unknown(&mut self, gaussians: usize) {
        self.of_gaussians.resize(gaussians, NO_PATCH);
    }

    /// Learns a frame: makes patches of the map's new Gaussians `added` and of those that show another thing now, and adds the
    /// frame's evidence. `predicted` contains the frame's predictions, and `regions` is the segmenter's finer cut, both `[height, width]`, 0 for none.
    pub fn learn(
        &mut self,
        recall: &Recall<'_>,
        added: &[NewGaussian],
        predicted: &SegmentMap,
        (regions, affinities): (&SegmentMap, &Affinities),
        settings: &MemorySettings,
    ) {
        let cells = FrameCells::new(affinities, regions);
        let mut new: ByKey<u32> = ByKey::default();
        self.of_gaussians.extend(added.iter().map(|_| NO_PATCH));
        let first = self.of_gaussians.len() - added.len();
        let added = (first..).zip(added.iter().map(|gaussian| gaussian.pixel));
        let replaced = recall.replaced.iter().map(|seen| (seen.gaussian, seen.pixel));
        for (gaussian, pixel) in added.chain(replaced) {
            let place = (pixel % regions.width(), pixel / regions.width());
            let patch = *new.entry(cells.key(place)).or_insert_with(|| self.new_patch());
            self.patches[patch as usize].gaussians += 1;
            self.of_gaussians[gaussian] = patch;
        }
        let new_patch = |place| new.get(&cells.key(place)).copied();
        let shown = FramePatches::new(recall, &self.of_gaussians, affinities, settings, new_patch);
        self.learnt = self.learnt.saturating_add(1);
        for (patch, id, pixels) in shown.ids(&affinities.sampled(predicted)) {
            let patch = &mut self.patches[patch as usize];
            patch.count(id, pixels);
            if patch.last_seen != self.learnt {
                patch.last_seen = self.learnt;
                patch.frames = patch.frames.saturating_add(1);
            }
        }
        for (key, evidence) in pairs_of(&shown, affinities) {
            self.pairs.add(key, evidence);
        }
    }

    fn new_patch(&mut self) -> u32 {
        self.unused.pop_first().unwrap_or_else(|| {
            self.patches.push(Patch::default());
            self.patches.len() as u32 - 1
        })
    }

    /// Keeps the Gaussians for which `keep` is true, in their order. The evidence about patches without Gaussians is removed.
    pub fn retain(&mut self, keep: &[bool]) {
        self.forget((0..self.of_gaussians.len()).filter(|gaussian| !keep[*gaussian]));
        crate::map::retain(&mut self.of_gaussians, keep);
    }

    /// Takes Gaussians from their patches, because they show another thing now, or nothing. The evidence about patches
    /// without Gaussians is removed.
    pub fn forget(&mut self, gaussians: impl Iterator<Item = usize>) {
        let mut gone = BTreeSet::new();
        for gaussian in gaussians {
            let patch = std::mem::replace(&mut self.of_gaussians[gaussian], NO_PATCH);
            if patch != NO_PATCH {
                let gaussians = &mut self.patches[patch as usize].gaussians;
                *gaussians -= 1;
                if *gaussians == 0 {
                    gone.insert(patch);
                }
            }
        }
        for patch in &gone {
            self.patches[*patch as usize] = Patch::default();
            self.pairs.remove(*patch);
        }
        self.unused.append(&mut gone);
    }

    /// Learns that Gaussians show the same surface as earlier ones, and will be removed: `doubles` are pairs of such a
    /// Gaussian and the earlier one. The evidence about patches that lose all Gaussians goes to those that keep theirs.
    pub fn absorb(&mut self, doubles: &[(usize, usize)]) {
        let mut lost: BTreeMap<u32, BTreeMap<u32, u32>> = BTreeMap::new();
        for (from, into) in doubles {
            let [from, into] = [from, into].map(|gaussian| self.of_gaussians[*gaussian]);
            if from != NO_PATCH {
                *lost.entry(from).or_default().entry(into).or_default() += 1;
            }
        }
        let is_gone = |(from, into): &(&u32, &BTreeMap<u32, u32>)| {
            into.values().sum::<u32>() >= self.patches[**from as usize].gaussians
        };
        let most = |into: &BTreeMap<u32, u32>| {
            into.iter().max_by_key(|(patch, count)| (**count, **patch)).map(|(patch, _)| *patch)
        };
        let next: BTreeMap<u32, u32> = lost
            .iter()
            .filter(is_gone)
            .filter_map(|(from, into)| Some((*from, most(into)?)))
            .filter(|(from, into)| *into != NO_PATCH && from != into)
            .collect();
        // An heir that has an heir of its own is gone, too. In a circle, nothing stays.
        let heir = |patch: u32| {
            let steps = std::iter::successors(Some(patch), |patch| next.get(patch).copied());
            steps.take(next.len() + 1).last().unwrap_or(patch)
        };
        let heirs: BTreeMap<u32, u32> =
            next.keys().map(|patch| (*patch, heir(*patch))).filter(|(from, into)| from != into).collect();
        for (from, into) in &heirs {
            for (id, pixels) in std::mem::take(&mut self.patches[*from as usize].pixels_of_ids) {
                self.patches[*into as usize].count(id, pixels);
            }
            let frames = self.patches[*from as usize].frames;
            let heir = &mut self.patches[*into as usize];
            heir.frames = heir.frames.saturating_add(frames);
        }
        let mut moved: Vec<(u64, PairEvidence)> = heirs.keys().flat_map(|patch| self.pairs.remove(*patch)).collect();
        moved.sort_unstable_by_key(|(key, _)| *key);
        for (key, evidence) in moved {
            let (one, other) = patches_of(key);
            let (one, other) = (heir(one), heir(other));
            if one != other {
                self.pairs.add(pair_key(one, other), evidence);
            }
        }
    }

    /// The ids that frames gave to patches.
    pub fn ids(&self) -> BTreeSet<SegmentId> {
        self.patches.iter().flat_map(|patch| &patch.pixels_of_ids).map(|(id, _)| *id).collect()
    }

    /// Appends the patches of another map's Gaussians, and the evidence about them.
    pub fn append(&mut self, other: Self) {
        let first = self.patches.len() as u32;
        let number = |patch: u32| if patch == NO_PATCH { NO_PATCH } else { patch + first };
        self.of_gaussians.extend(other.of_gaussians.into_iter().map(number));
        self.unused.extend(other.unused.into_iter().map(number));
        self.patches.extend(other.patches);
        for (key, evidence) in other.pairs.iter() {
            let (one, other) = patches_of(key);
            self.pairs.add(pair_key(number(one), number(other)), evidence);
        }
    }

    /// Numbers the patches that have Gaussians from 0, in their order.
    pub fn renumber(&mut self) {
        let mut next = 0;
        let numbers: Vec<u32> = self
            .patches
            .iter()
            .map(|patch| {
                next += u32::from(patch.gaussians > 0);
                if patch.gaussians > 0 { next - 1 } else { NO_PATCH }
            })
            .collect();
        let number = |patch: u32| numbers.get(patch as usize).copied().unwrap_or(NO_PATCH);
        self.of_gaussians.iter_mut().for_each(|patch| *patch = number(*patch));
        self.patches.retain(|patch| patch.gaussians > 0);
        self.unused.clear();
        let pairs = std::mem::take(&mut self.pairs);
        let pairs = pairs.iter().map(|(key, evidence)| {
            let (one, other) = patches_of(key);
            (number(one), number(other), evidence)
        });
        let kept = pairs.filter(|(one, other, _)| *one != NO_PATCH && *other != NO_PATCH);
        self.pairs = kept.map(|(one, other, evidence)| (pair_key(one, other), evidence)).collect();
    }

    /// Replaces ids, `names[old] = new`.
    pub fn remap(&mut self, names: &BTreeMap<SegmentId, SegmentId>) {
        for patch in &mut self.patches {
            patch.object = names.get(&patch.object).copied().unwrap_or(patch.object);
            if patch.pixels_of_ids.iter().any(|(id, _)| names.contains_key(id)) {
                for (id, pixels) in std::mem::take(&mut patch.pixels_of_ids) {
                    patch.count(names.get(&id).copied().unwrap_or(id), pixels);
                }
            }
        }
    }
}
