//! Keyframes in maps of version 4, which are text: JSON, with images and features in Base64. They are only read.

use crate::graph::Edge;
use crate::keyframes::{CompactView, StoredFeature, StoredKeyframe};
use crate::loops::{ClosedLoop, LoopCandidate, LoopCheck};
use crate::read_keyframes::{ReadKeyframes, SearchState};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::Deserialize;
use splatseg_geometry::{Intrinsics, KeyframeId, Pose};

/// Bytes of a feature: three coordinates and a descriptor, the lower bytes of each number first.
const FEATURE_BYTES: usize = 6 + 32;

#[derive(Deserialize)]
struct OldKeyframes {
    session: u32,
    part: u32,
    next: KeyframeId,
    latest: Option<KeyframeId>,
    keyframes: Vec<OldKeyframe>,
    replaced: Vec<(KeyframeId, KeyframeId, Pose)>,
    edges: Vec<Edge>,
    checks: Vec<LoopCheck>,
    candidates: Vec<LoopCandidate>,
    #[serde(default)]
    closed: Option<ClosedLoop>,
}

#[derive(Deserialize)]
struct OldKeyframe {
    id: KeyframeId,
    world_from_key: Pose,
    part: u32,
    session: u32,
    #[serde(default)]
    given_frame: Option<usize>,
    intrinsics: Intrinsics,
    /// Compressed, in Base64.
    grey: String,
    depth: String,
    /// Features of [`FEATURE_BYTES`], in Base64.
    features: String,
}

/// The keyframes from the text of a map.
///
/// # Errors
/// If the text is not in the form of that version. What belongs together is checked by [`ReadKeyframes::checked`].
pub(crate) fn converted(text: &[u8]) -> Result<ReadKeyframes, String> {
    let old: OldKeyframes = serde_json::from_slice(text).map_err(|error| error.to_string())?;
    let OldKeyframes { session, part, next, latest, keyframes, replaced, edges, checks, candidates, closed } = old;
    let state = SearchState { session, part, next, latest, checks, candidates, closed };
    let keyframes = keyframes.into_iter().map(OldKeyframe::converted).collect::<Result<_, _>>()?;
    Ok(ReadKeyframes { keyframes, replaced, edges, state })
}

impl OldKeyframe {
    fn converted(self) -> Result<StoredKeyframe, String> {
        let Self { id, world_from_key, part, session, given_frame, intrinsics, grey, depth, features } = self;
        let damaged = |what: &str| format!("keyframe {id}: {what} cannot be read");
        let bytes = |text: &str, what| STANDARD.decode(text).map_err(|_| damaged(what));
        let features = bytes(&features, "features")?;
        if !features.len().is_multiple_of(FEATURE_BYTES) {
            return Err(damaged("features"));
        }
        let view = CompactView { intrinsics, grey: bytes(&grey, "luminance")?, depth: bytes(&depth, "depth")? };
        let features = features.chunks_exact(FEATURE_BYTES).map(feature).collect();
        StoredKeyframe { id, world_from_key, part, session, view, color: Vec::new(), features, given_frame }.checked()
    }
}

fn feature(bytes: &[u8]) -> StoredFeature {
    let point = std::array::from_fn(|k| i16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]));
    let word = |k: usize| std::array::from_fn(|byte| bytes[6 + 8 * k + byte]);
    StoredFeature { point, descriptor: std::array::from_fn(|k| u64::from_le_bytes(word(k))) }
}
