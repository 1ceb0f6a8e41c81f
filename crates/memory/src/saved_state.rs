//! State of a memory besides its Gaussians, saved with them. Without it, a continued run would differ for some frames
//! from one that never stopped.
//!
//! It is written as JSON, because it is small and its parts change more often than the map. Empty text stands for the
//! default state.

use crate::recent::SavedRecentFrames;
use crate::segments::SavedIds;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{KeyframeId, SegmentId, SurfaceKind};

/// Maximum length of the text, when it is written and when it is read.
pub(crate) const MAX_BYTES: u64 = 1 << 28;

/// State saved besides the Gaussians. Unknown fields, from files of earlier versions, are ignored.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct SavedState {
    /// Ids that are not in use.
    pub ids: SavedIds,
    /// The last frames. Older files lack them.
    pub recent: SavedRecentFrames,
    /// The keyframe of each Gaussian, as runs: keyframe and length. Older files lack it, and all that follows.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub anchors: Vec<(KeyframeId, u64)>,
    /// What is known about the place of each Gaussian, as runs: kind and length. Empty if all were observed; older files
    /// lack it, and all their Gaussians count as observed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub surfaces: Vec<(SurfaceKind, u64)>,
    /// Ids that were shown side by side: for each the larger ones.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub together: Vec<(SegmentId, Vec<SegmentId>)>,
    /// Ids that were shown beside too many others to list them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub crowded: Vec<SegmentId>,
    /// Ids that turned out to be older ones' objects, with those.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub remapped: Vec<(SegmentId, SegmentId)>,
    /// The camera's keyframes, in a form of their own.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub keyframes: String,
    /// The names of objects, in a form of their own.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub names: String,
}

impl SavedState {
    /// Returns the text for a file; empty for the default state.
    pub fn to_bytes(&self) -> Vec<u8> {
        if *self == Self::default() {
            return Vec::new();
        }
        // Numbers, lists and maps with whole numbers as keys can always be written.
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// Parses the text of a file.
    ///
    /// # Errors
    /// If the text is not in the form that [`Self::to_bytes`] writes. The values are checked when they are restored.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        if bytes.is_empty() {
            return Ok(Self::default());
        }
        serde_json::from_slice(bytes).map_err(|error| error.to_string())
    }
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

/// The surfaces in the text of a file with `count` Gaussians.
///
/// # Errors
/// As [`SavedState::from_bytes`], and if the runs have another length.
pub(crate) fn saved_surfaces(bytes: &[u8], count: usize) -> Result<Vec<SurfaceKind>, String> {
    /// The rest of the text may be large.
    #[derive(Default, Deserialize)]
    #[serde(default)]
    struct Surfaces {
        surfaces: Vec<(SurfaceKind, u64)>,
    }
    let saved: Surfaces = match bytes {
        [] => Surfaces::default(),
        bytes => serde_json::from_slice(bytes).map_err(|error| error.to_string())?,
    };
    restored_runs("surfaces", &saved.surfaces, count, SurfaceKind::Observed)
}
