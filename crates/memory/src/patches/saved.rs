//! Saved state of the patches and the evidence about them.
//!
//! | Array | Type | |
//! |---|---|---|
//! | `of_gaussians` | `u32 [n]` | patch of each Gaussian, 4294967295 for none; without it, none has one |
//! | `frames` | `u32 [n]` | frames in which each patch was seen; without it, none |
//! | `ids` | `u32 [n, 3]` | patch, id, pixels of all frames that were predicted as that id there |
//! | `pairs` | `u32 [n, 3]` | the patches of a pair, the smaller one first, and the number of pairs of pixels; by increasing patches |
//! | `sums` | `i32 [n]` | sum of the log-odds of each of `pairs`, units of 1/16 |

use super::{IDS_PER_PATCH, MAX_PAIRS, NO_PATCH, PairEvidence, Patch, PatchGraph, pair_key, patches_of};
use splatseg_files::{StateBlock, StateError};
use splatseg_geometry::SegmentId;

/// Evidence of more bytes is not saved: that of about 2,000 square metres. The rest of a map's state needs room, too.
const MAX_BYTES: usize = 200 << 20;

const OF_GAUSSIANS: &str = "of_gaussians";
const FRAMES: &str = "frames";
const IDS: &str = "ids";
const PAIRS: &str = "pairs";
const SUMS: &str = "sums";

/// The arrays of a file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct SavedPatches {
    pub(super) of_gaussians: Vec<u32>,
    pub(super) frames: Vec<u32>,
    pub(super) ids: Vec<[u32; 3]>,
    pub(super) pairs: Vec<[u32; 3]>,
    pub(super) sums: Vec<i32>,
}

impl SavedPatches {
    /// Returns the arrays for a file; none without patches, or if they are too large.
    pub fn into_block(self) -> StateBlock {
        let mut block = StateBlock::default();
        let numbers = self.of_gaussians.len() + self.frames.len() + 3 * self.ids.len() + 4 * self.pairs.len();
        if 4 * numbers > MAX_BYTES {
            tracing::warn!("the evidence about objects has {} MB: the map is saved without it", (4 * numbers) >> 20);
        } else if self.of_gaussians.iter().any(|patch| *patch != NO_PATCH) {
            block.put(OF_GAUSSIANS, &[], self.of_gaussians);
            block.put(FRAMES, &[], self.frames);
            block.put(IDS, &[3], self.ids.into_iter().flatten());
            block.put(PAIRS, &[3], self.pairs.into_iter().flatten());
            block.put(SUMS, &[], self.sums);
        }
        block
    }

    /// Reads the arrays of a file.
    ///
    /// # Errors
    /// If an array has another form than [`Self::into_block`] gives it. The values are checked when they are restored.
    pub fn from_block(block: &StateBlock) -> Result<Self, StateError> {
        let pairs = block.get_tuples(PAIRS)?;
        Ok(Self {
            of_gaussians: block.get(OF_GAUSSIANS, &[])?,
            frames: block.get(FRAMES, &[])?,
            ids: block.get_tuples(IDS)?,
            sums: block.get_rows(SUMS, pairs.len(), &[])?,
            pairs,
        })
    }
}

impl PatchGraph {
    /// Returns the state to be saved.
    pub fn saved(&self) -> SavedPatches {
        let ids = |(number, patch): (usize, &Patch)| {
            let number = number as u32;
            patch.pixels_of_ids.iter().map(move |(id, pixels)| [number, *id, *pixels]).collect::<Vec<_>>()
        };
        SavedPatches {
            of_gaussians: self.of_gaussians.clone(),
            frames: self.patches.iter().map(|patch| patch.frames).collect(),
            ids: self.patches.iter().enumerate().flat_map(ids).collect(),
            sums: self.pairs.iter().map(|(_, evidence)| evidence.sum).collect(),
            pairs: self.pairs.iter().map(|(key, evidence)| pair(key, evidence.count)).collect(),
        }
    }

    /// Restores the patches of a map with `gaussians` Gaussians and the ids 1 to `highest`.
    ///
    /// # Errors
    /// If the arrays contradict each other.
    pub fn restored(saved: SavedPatches, gaussians: usize, highest: SegmentId) -> Result<Self, String> {
        let mut graph = Self { of_gaussians: saved.of_gaussians, ..Self::default() };
        if graph.of_gaussians.is_empty() {
            graph.add_unknown(gaussians);
        }
        if graph.of_gaussians.len() != gaussians {
            return Err(format!("patches of {} Gaussians, expected {gaussians}", graph.of_gaussians.len()));
        }
        let known = graph.of_gaussians.iter().filter(|patch| **patch != NO_PATCH);
        let count = known.clone().max().map_or(0, |last| *last as usize + 1);
        // A map that has lost Gaussians may have more numbers of patches than Gaussians.
        if count > gaussians.max(saved.frames.len()) {
            return Err(format!("the patch {} of a map of {gaussians} Gaussians", count - 1));
        }
        graph.patches = vec![Patch::default(); count];
        known.for_each(|patch| graph.patches[*patch as usize].gaussians += 1);
        let is_used =
            |patches: &[Patch], patch: u32| patches.get(patch as usize).is_some_and(|patch| patch.gaussians > 0);
        // A patch at the end may have lost its Gaussians.
        if saved.frames.len() < count && !saved.frames.is_empty() {
            return Err(format!("the frames of {} patches, expected {count}", saved.frames.len()));
        }
        let with_gaussians = graph.patches.iter_mut().zip(saved.frames).filter(|(patch, _)| patch.gaussians > 0);
        with_gaussians.for_each(|(patch, frames)| patch.frames = frames);
        for [number, id, pixels] in saved.ids {
            if !is_used(&graph.patches, number) || id == 0 || id > highest {
                return Err(format!("the patch {number} was predicted as {id}: one of them does not exist"));
            }
            if pixels == 0 {
                return Err(format!("the patch {number} was predicted as {id} by no pixel"));
            }
            let patch = &mut graph.patches[number as usize];
            if patch.pixels_of_ids.len() == IDS_PER_PATCH
                || patch.pixels_of_ids.last().is_some_and(|(last, _)| *last >= id)
            {
                return Err(format!("the ids of the patch {number} are too many, or do not increase"));
            }
            patch.pixels_of_ids.push((id, pixels));
        }
        let mut last = None;
        for ([one, other, count], sum) in saved.pairs.into_iter().zip(saved.sums) {
            let is_possible = (1..=MAX_PAIRS).contains(&count) && sum.unsigned_abs() <= count * i8::MAX as u32;
            let are_used = one < other && is_used(&graph.patches, one) && is_used(&graph.patches, other);
            if !is_possible || !are_used || last >= Some((one, other)) {
                return Err(format!(
                    "impossible evidence about the patches {one} and {other}: {count} pairs, sum {sum}"
                ));
            }
            last = Some((one, other));
            graph.pairs.add(pair_key(one, other), PairEvidence { sum, count });
        }
        let unused = graph.patches.iter().enumerate().filter(|(_, patch)| patch.gaussians == 0);
        graph.unused = unused.map(|(number, _)| number as u32).collect();
        Ok(graph)
    }
}

fn pair(key: u64, count: u32) -> [u32; 3] {
    let (one, other) = patches_of(key);
    [one, other, count]
}
