//! The objects of a map: a partition of its patches, and an id for each of them.

use super::partition::partition;
use super::{PairEvidence, PatchGraph, patches_of};
use crate::Verdict;
use splatseg_geometry::SegmentId;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

/// Number of frames of evidence that weigh as much as one vote. Votes come from the last four frames. They decide where a patch
/// was seen in few frames, and the evidence decides where it was seen in many.
const FRAMES_PER_VOTE: f32 = 8.0;

/// The patches to be partitioned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scope {
    /// All patches.
    All,
    /// Patches seen in the last `n` frames. The others keep their objects.
    Frames(u32),
}

impl PatchGraph {
    /// Decides from the evidence what the objects are; see [`Self::verdicts`]. An object keeps the id that most of it had when
    /// this was last decided or, where nothing was, that most frames gave it, measured in pixels. If other objects have more
    /// of all of its ids, there is no verdict on it.
    pub fn decide(&mut self, scope: Scope) {
        let is_seen: Vec<bool> = match scope {
            Scope::All => vec![true; self.patches.len()],
            Scope::Frames(frames) => {
                let first = self.learnt.saturating_sub(frames);
                self.patches.iter().map(|patch| patch.last_seen > first).collect()
            }
        };
        let is_wanted = |(key, _): &(u64, PairEvidence)| {
            let (one, other) = patches_of(*key);
            is_seen[one as usize] && is_seen[other as usize]
        };
        let pairs: Vec<(u64, PairEvidence)> = self.pairs.iter().filter(is_wanted).collect();
        let of_patches = partition(&self.patches, &pairs);
        let [had, given] = self.shares(&of_patches, &is_seen);
        let (mut ids, mut taken) = (vec![0; self.patches.len()], BTreeSet::new());
        for (_, object, id) in had.iter().chain(&given) {
            if ids[*object] == 0 && taken.insert(*id) {
                ids[*object] = *id;
            }
        }
        for (patch, object) in of_patches.into_iter().enumerate().filter(|(patch, _)| is_seen[*patch]) {
            self.patches[patch].object = ids[object as usize];
        }
        self.is_decided = true;
    }

    /// The pixels of each object and id, the most first: of the ids that its patches had when objects were last decided or,
    /// where they had none, were given by frames; and of the latter alone. Only patches that are seen count.
    fn shares(&self, of_patches: &[u32], is_seen: &[bool]) -> [Vec<(u64, usize, SegmentId)>; 2] {
        let mut sums: [BTreeMap<(u32, SegmentId), u64>; 2] = Default::default();
        for ((patch, object), _) in self.patches.iter().zip(of_patches).zip(is_seen).filter(|(_, seen)| **seen) {
            for (id, pixels) in &patch.pixels_of_ids {
                let had = if patch.object == 0 { *id } else { patch.object };
                for (sums, id) in sums.iter_mut().zip([had, *id]) {
                    *sums.entry((*object, id)).or_default() += u64::from(*pixels);
                }
            }
        }
        sums.map(|sums| {
            let mut shares: Vec<_> =
                sums.into_iter().map(|((object, id), pixels)| (pixels, object as usize, id)).collect();
            shares.sort_unstable_by_key(|(pixels, object, id)| (Reverse(*pixels), *object, *id));
            shares
        })
    }

    /// The verdict on each Gaussian, with id 0 for those without evidence. Empty before the first [`Self::decide`].
    pub fn verdicts(&self) -> Vec<Verdict> {
        if !self.is_decided {
            return Vec::new();
        }
        let verdict = |patch: &u32| {
            let patch = self.patches.get(*patch as usize).filter(|patch| patch.object != 0)?;
            Some(Verdict { id: patch.object, votes: patch.frames as f32 / FRAMES_PER_VOTE })
        };
        self.of_gaussians.iter().map(|patch| verdict(patch).unwrap_or_default()).collect()
    }

    /// True if there are verdicts that votes do not contain.
    pub fn is_decided(&self) -> bool {
        self.is_decided
    }

    /// Forgets what was decided, because the votes of Gaussians contain it.
    pub fn forget_verdicts(&mut self) {
        self.patches.iter_mut().for_each(|patch| patch.object = 0);
        self.is_decided = false;
    }
}
