//! State of a memory besides its Gaussians, saved with them. Without it, a continued run would differ for some frames
//! from one that never stopped.
//!
//! Its arrays, in a [`StateBlock`] (`ply/mod.rs` describes the whole file):
//!
//! | Array | Type | |
//! |---|---|---|
//! | `memory.given_ids` | `u64` | number of ids given out by counting |
//! | `memory.released_ids` | `u32 [n, 2]` | ids to be reused, in this order, and the frames in which each was predicted |
//! | `memory.anchors` | `u64 [n, 2]` | runs of Gaussians: keyframe that they are attached to, length |
//! | `memory.surfaces` | `u64 [n, 2]` | runs: 0 observed, 1 continued or 2 assumed, length; without it, all were observed |
//! | `memory.co_visible` | `u32 [n, 2]` | ids that were shown side by side, the smaller one first |
//! | `memory.crowded` | `u32 [n]` | ids that were shown beside too many others to list them |
//! | `memory.remapped` | `u32 [n, 2]` | ids that turned out to be older ones' objects, with those |
//! | `patches.…` | | evidence about which Gaussians are one object, see `patches/saved.rs` |
//! | `recent.…` | | the last frames, see `recent/saved.rs` |
//! | `keyframes.…` | | the camera's keyframes, see `saved_keyframes.rs` in `odometry` |
//! | `names.…` | | the names of objects, see `names.rs` in `objects` |
//! | `history.…` | | when objects were seen, and the rooms so far, see `map_history.rs` in `splatseg` |

use crate::patches::SavedPatches;
use crate::recent::SavedRecentFrames;
use crate::segments::{SavedIds, SavedRelease};
use splatseg_files::{StateBlock, StateError};
use splatseg_geometry::{KeyframeId, SegmentId, SurfaceKind};

/// Maximum length of the bytes, when they are written and when they are read.
pub(crate) const MAX_BYTES: u64 = 1 << 28;

const GIVEN: &str = "memory.given_ids";
const RELEASED: &str = "memory.released_ids";
const ANCHORS: &str = "memory.anchors";
const SURFACES: &str = "memory.surfaces";
const CO_VISIBLE: &str = "memory.co_visible";
const CROWDED: &str = "memory.crowded";
const REMAPPED: &str = "memory.remapped";
const PATCHES: &str = "patches";
const RECENT: &str = "recent";
const KEYFRAMES: &str = "keyframes";
const NAMES: &str = "names";
const HISTORY: &str = "history";

/// State saved besides the Gaussians.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SavedState {
    /// Ids that are not in use.
    pub ids: SavedIds,
    /// Evidence about which Gaussians are one object.
    pub patches: SavedPatches,
    /// The last frames.
    pub recent: SavedRecentFrames,
    /// The keyframe of each Gaussian, as runs: keyframe and length.
    pub anchors: Vec<(KeyframeId, u64)>,
    /// The [`SurfaceKind`] of each Gaussian, as runs: kind and length. Empty if all were observed.
    pub surfaces: Vec<(SurfaceKind, u64)>,
    /// Pairs of ids that were shown side by side, the smaller one first.
    pub together: Vec<[SegmentId; 2]>,
    /// Ids that were shown beside too many others to list them.
    pub crowded: Vec<SegmentId>,
    /// Ids that turned out to be older ones' objects, with those.
    pub remapped: Vec<[SegmentId; 2]>,
    /// The camera's keyframes; empty if there are none.
    pub keyframes: StateBlock,
    /// The names of objects; empty if there are none.
    pub names: StateBlock,
    /// When objects were seen, and the rooms so far; empty if nothing is known.
    pub history: StateBlock,
}

impl SavedState {
    /// Returns the arrays for a file; none for the default state.
    pub fn into_block(self) -> StateBlock {
        let mut block = StateBlock::default();
        if self.ids.given > 0 {
            block.put_number(GIVEN, self.ids.given);
        }
        let runs = |runs: Vec<(u64, u64)>| runs.into_iter().flat_map(|(entry, length)| [entry, length]);
        let anchors = self.anchors.into_iter().map(|(keyframe, length)| (u64::from(keyframe), length)).collect();
        let surfaces = self.surfaces.into_iter().map(|(kind, length)| (code(kind), length)).collect();
        for (name, entries) in [(ANCHORS, anchors), (SURFACES, surfaces)] {
            if !Vec::is_empty(&entries) {
                block.put(name, &[2], runs(entries));
            }
        }
        let released = self.ids.released.into_iter().map(|SavedRelease(id, sightings)| [id, sightings]).collect();
        for (name, pairs) in [(RELEASED, released), (CO_VISIBLE, self.together), (REMAPPED, self.remapped)] {
            if !pairs.is_empty() {
                block.put(name, &[2], pairs.into_iter().flatten());
            }
        }
        if !self.crowded.is_empty() {
            block.put(CROWDED, &[], self.crowded);
        }
        block.put_block(PATCHES, self.patches.into_block());
        block.put_block(RECENT, self.recent.into_block());
        block.put_block(KEYFRAMES, self.keyframes);
        block.put_block(NAMES, self.names);
        block.put_block(HISTORY, self.history);
        block
    }

    /// Reads the arrays of a file.
    ///
    /// # Errors
    /// If an array has another form than [`Self::into_block`] gives it. The values are checked when they are restored.
    pub fn from_block(mut block: StateBlock) -> Result<Self, StateError> {
        let released = block.get_tuples(RELEASED)?.into_iter().map(|[id, sightings]| SavedRelease(id, sightings));
        let anchor = |[keyframe, length]: [u64; 2]| {
            let keyframe = KeyframeId::try_from(keyframe).map_err(|_| impossible(ANCHORS, keyframe, "a keyframe"))?;
            Ok((keyframe, length))
        };
        Ok(Self {
            ids: SavedIds { given: block.get_number(GIVEN)?.unwrap_or(0), released: released.collect() },
            patches: SavedPatches::from_block(&block.take_block(PATCHES))?,
            recent: SavedRecentFrames::from_block(&mut block.take_block(RECENT))?,
            anchors: block.get_tuples(ANCHORS)?.into_iter().map(anchor).collect::<Result<_, StateError>>()?,
            surfaces: surface_runs(&block)?,
            together: block.get_tuples(CO_VISIBLE)?,
            crowded: block.get(CROWDED, &[])?,
            remapped: block.get_tuples(REMAPPED)?,
            keyframes: block.take_block(KEYFRAMES),
            names: block.take_block(NAMES),
            history: block.take_block(HISTORY),
        })
    }
}

fn code(kind: SurfaceKind) -> u64 {
    match kind {
        SurfaceKind::Observed => 0,
        SurfaceKind::Continued => 1,
        SurfaceKind::Assumed => 2,
    }
}

fn surface_runs(block: &StateBlock) -> Result<Vec<(SurfaceKind, u64)>, StateError> {
    let kinds = [SurfaceKind::Observed, SurfaceKind::Continued, SurfaceKind::Assumed];
    let run = |[kind, length]: [u64; 2]| {
        let known = kinds.into_iter().find(|known| code(*known) == kind);
        Ok((known.ok_or_else(|| impossible(SURFACES, kind, "0, 1 or 2"))?, length))
    };
    block.get_tuples(SURFACES)?.into_iter().map(run).collect()
}

fn impossible(name: &str, found: u64, expected: &str) -> StateError {
    StateError::Array { name: name.to_owned(), found: found.to_string(), expected: expected.to_owned() }
}

/// Runs of equal entries: entry and length.
pub(crate) fn runs<T: Copy + PartialEq>(entries: &[T]) -> Vec<(T, u64)> {
    entries.chunk_by(|one, other| one == other).map(|run| (run[0], run.len() as u64)).collect()
}

/// The entries of `count` Gaussians from their runs; all of them `missing` in a file without runs.
///
/// # Errors
/// If the runs have another length.
pub(crate) fn restored_runs<T: Copy>(
    what: &str,
    runs: &[(T, u64)],
    count: usize,
    missing: T,
) -> Result<Vec<T>, String> {
    if runs.is_empty() {
        return Ok(vec![missing; count]);
    }
    let found = runs.iter().fold(0u64, |sum, (_, length)| sum.saturating_add(*length));
    if found != count as u64 {
        return Err(format!("{what} of {found} Gaussians, expected {count}"));
    }
    Ok(runs.iter().flat_map(|(entry, length)| std::iter::repeat_n(*entry, *length as usize)).collect())
}

/// The surfaces in the state of a file with `count` Gaussians.
///
/// # Errors
/// If the array has another form, or the runs another length.
pub(crate) fn saved_surfaces(block: &StateBlock, count: usize) -> Result<Vec<SurfaceKind>, String> {
    let runs = surface_runs(block).map_err(|error| error.to_string())?;
    restored_runs("surfaces", &runs, count, SurfaceKind::Observed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state() -> SavedState {
        let mut keyframes = StateBlock::default();
        keyframes.put("id", &[], [3u32, 4]);
        SavedState {
            ids: SavedIds { given: 9, released: vec![SavedRelease(4, 1), SavedRelease(2, 0)] },
            patches: SavedPatches::default(),
            recent: SavedRecentFrames::default(),
            anchors: vec![(0, 5), (7, 1 << 40)],
            surfaces: vec![(SurfaceKind::Assumed, 2), (SurfaceKind::Observed, 1), (SurfaceKind::Continued, 3)],
            together: vec![[1, 3], [1, 5]],
            crowded: vec![8],
            remapped: vec![[6, 3]],
            keyframes,
            names: StateBlock::default(),
            history: StateBlock::default(),
        }
    }

    #[test]
    fn state_is_read_as_it_was_written() {
        assert_eq!(SavedState::from_block(state().into_block()).unwrap(), state());
        assert!(SavedState::default().into_block().is_empty(), "the default state takes no bytes");
        assert_eq!(SavedState::from_block(StateBlock::default()).unwrap(), SavedState::default());
    }

    #[test]
    fn unknown_arrays_are_ignored_and_wrong_ones_named() {
        let changed = |change: fn(&mut StateBlock)| {
            let mut block = state().into_block();
            change(&mut block);
            SavedState::from_block(block).map_err(|error| error.to_string())
        };
        assert_eq!(changed(|block| block.put_number("memory.of_a_later_version", 1.0f64)), Ok(state()));
        let error = changed(|block| block.put("memory.surfaces", &[2], [3u64, 1])).unwrap_err();
        assert_eq!(error, "memory.surfaces: found 3, expected 0, 1 or 2");
        let error = changed(|block| block.put("memory.anchors", &[2], [1u64 << 32, 1])).unwrap_err();
        assert_eq!(error, "memory.anchors: found 4294967296, expected a keyframe");
        assert!(changed(|block| block.put("memory.crowded", &[2], [3u32, 1])).unwrap_err().contains("memory.crowded"));
    }
}
