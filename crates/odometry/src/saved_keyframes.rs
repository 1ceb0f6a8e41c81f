//! The keyframes of a map as bytes, to be saved with the map or with a run.

use crate::PoseSourceError;
use crate::graph::{Edge, PoseGraph};
use crate::keyframe_map::KeyframeMap;
use crate::keyframes::{CompactView, KeyframeStore, MAX_PIXELS, MAX_STORED, MAX_WIDTH, StoredFeature, StoredKeyframe};
use crate::loops::{ClosedLoop, LoopCandidate, LoopCheck};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use splatseg_files::{MemoryLimit, display_bytes};
use splatseg_geometry::{Image, Intrinsics, KeyframeId, Pose};

/// Numbers of a feature: three coordinates and a descriptor, bytes.
const FEATURE_BYTES: usize = 6 + 32;

/// A keyframe has at most this many features.
const MAX_FEATURES: usize = 1000;

/// Saved form of [`KeyframeMap`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedKeyframes {
    session: u32,
    part: u32,
    next: KeyframeId,
    latest: Option<KeyframeId>,
    keyframes: Vec<SavedStoredKeyframe>,
    replaced: Vec<(KeyframeId, KeyframeId, Pose)>,
    edges: Vec<Edge>,
    checks: Vec<LoopCheck>,
    candidates: Vec<LoopCandidate>,
    /// Files of earlier versions lack it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    closed: Option<ClosedLoop>,
}

/// Saved form of [`StoredKeyframe`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedStoredKeyframe {
    id: KeyframeId,
    world_from_key: Pose,
    part: u32,
    session: u32,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    given_frame: Option<usize>,
    intrinsics: Intrinsics,
    /// Compressed, in Base64.
    grey: String,
    depth: String,
    /// Per feature the coordinates and the descriptor, lower bytes first, in Base64.
    features: String,
}

/// The bytes of a map's keyframes; `None` if there are none.
pub(crate) fn bytes(map: &KeyframeMap) -> Option<Vec<u8>> {
    if map.store.len() == 0 {
        return None;
    }
    serde_json::to_vec(&SavedKeyframes::of(map)).ok()
}

/// The map of keyframes from [`bytes`].
pub(crate) fn parsed(bytes: &[u8]) -> Result<KeyframeMap, String> {
    let saved: SavedKeyframes = serde_json::from_slice(bytes).map_err(|error| error.to_string())?;
    saved.restored()
}

impl SavedKeyframes {
    /// Keyframes that [`SavedStoredKeyframe::restored`] would refuse are left out.
    pub(crate) fn of(map: &KeyframeMap) -> Self {
        let is_saved = |keyframe: &&StoredKeyframe| keyframe.view.has_possible_size();
        let is_known = |id: KeyframeId| map.store.get(id).as_ref().is_some_and(is_saved);
        Self {
            session: map.session,
            part: map.part,
            next: map.store.next,
            latest: map.latest,
            keyframes: map.store.iter().filter(is_saved).map(SavedStoredKeyframe::of).collect(),
            replaced: map.store.replaced.iter().map(|(id, (kept, pose))| (*id, *kept, *pose)).collect(),
            edges: map.graph.edges.iter().filter(|edge| is_known(edge.from) && is_known(edge.to)).cloned().collect(),
            checks: map.checks.iter().copied().collect(),
            candidates: map.candidates.iter().cloned().collect(),
            closed: map.closed.clone(),
        }
    }

    pub(crate) fn restored(self) -> Result<KeyframeMap, String> {
        if self.keyframes.len() > MAX_STORED {
            return Err(format!("{} keyframes, expected at most {MAX_STORED}", self.keyframes.len()));
        }
        let mut store = KeyframeStore::default();
        for keyframe in self.keyframes {
            let keyframe = keyframe.restored()?;
            if keyframe.id >= self.next || store.get(keyframe.id).is_some() {
                return Err(format!("keyframe {} occurs twice or was never made", keyframe.id));
            }
            store.add(keyframe);
        }
        store.next = self.next;
        store.replaced = self.replaced.into_iter().map(|(id, kept, pose)| (id, (kept, pose))).collect();
        let is_known = |id: KeyframeId| store.get(id).is_some();
        if self.edges.iter().any(|edge| !is_known(edge.from) || !is_known(edge.to)) {
            return Err("a relative pose of a keyframe that does not exist".to_owned());
        }
        if self.edges.iter().flat_map(|edge| edge.information).flatten().any(|number| !number.is_finite()) {
            return Err("a relative pose with information that is not finite".to_owned());
        }
        let latest = self.latest.filter(|id| is_known(*id));
        let mut map = KeyframeMap {
            store,
            graph: PoseGraph { edges: self.edges },
            part: self.part,
            session: self.session,
            latest,
            checks: self.checks.into(),
            candidates: self.candidates.into(),
            closed: self.closed,
            ..KeyframeMap::default()
        };
        map.find_uncertain();
        Ok(map)
    }
}

impl SavedStoredKeyframe {
    pub(crate) fn of(keyframe: &StoredKeyframe) -> Self {
        let mut features = Vec::with_capacity(keyframe.features.len() * FEATURE_BYTES);
        for StoredFeature { point, descriptor } in &keyframe.features {
            point.iter().for_each(|part| features.extend(part.to_le_bytes()));
            descriptor.iter().for_each(|part| features.extend(part.to_le_bytes()));
        }
        Self {
            id: keyframe.id,
            world_from_key: keyframe.world_from_key,
            part: keyframe.part,
            session: keyframe.session,
            given_frame: keyframe.given_frame,
            intrinsics: keyframe.view.intrinsics,
            grey: STANDARD.encode(&keyframe.view.grey),
            depth: STANDARD.encode(&keyframe.view.depth),
            features: STANDARD.encode(features),
        }
    }

    pub(crate) fn restored(self) -> Result<StoredKeyframe, String> {
        let Self { id, world_from_key, part, session, given_frame, intrinsics, grey, depth, features } = self;
        let damaged = |what: &str| format!("keyframe {id}: {what} cannot be read");
        let intrinsics = intrinsics.validated().map_err(|error| format!("keyframe {id}: {error}"))?;
        let bytes = |text: &str, what| STANDARD.decode(text).map_err(|_| damaged(what));
        let features = bytes(&features, "features")?;
        if !features.len().is_multiple_of(FEATURE_BYTES) || features.len() > MAX_FEATURES * FEATURE_BYTES {
            return Err(damaged("features"));
        }
        let view = CompactView { intrinsics, grey: bytes(&grey, "luminance")?, depth: bytes(&depth, "depth")? };
        if !view.has_possible_size() {
            let (width, height) = (intrinsics.width, intrinsics.height);
            let expected = format!("at most {MAX_WIDTH} columns and {MAX_PIXELS} pixels in all");
            return Err(format!("keyframe {id}: {width}x{height} pixels, expected {expected}"));
        }
        view.pyramid().ok_or_else(|| damaged("image"))?;
        let features = features.chunks_exact(FEATURE_BYTES).map(stored_feature).collect();
        Ok(StoredKeyframe { id, world_from_key, part, session, view, features, given_frame })
    }
}

fn stored_feature(bytes: &[u8]) -> StoredFeature {
    let point = std::array::from_fn(|k| i16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]));
    let word = |k: usize| std::array::from_fn(|byte| bytes[6 + 8 * k + byte]);
    StoredFeature { point, descriptor: std::array::from_fn(|k| u64::from_le_bytes(word(k))) }
}

/// A keyframe of a saved map, as others see it.
#[derive(Clone, Debug)]
pub struct KeyframeView {
    /// Its number.
    pub id: KeyframeId,
    /// Its pose, camera to world.
    pub world_from_camera: Pose,
    /// The camera of its image.
    pub intrinsics: Intrinsics,
    /// z-depth, metres, 0 where missing, `[height, width]`, at most 200 pixels wide.
    pub depth: Image<f32>,
}

/// The keyframes that a saved map contains, without those that it has in common with an earlier one: `keyframes` and
/// `earlier` are bytes from [`PoseSource::save`](crate::PoseSource::save) for a map.
///
/// # Errors
/// [`PoseSourceError::State`] if the bytes are damaged, or the views would take more than the memory limit.
pub fn keyframe_views(keyframes: &[u8], earlier: Option<&[u8]>) -> Result<Vec<KeyframeView>, PoseSourceError> {
    let map = |bytes| parsed(bytes).map_err(PoseSourceError::State);
    let earlier = earlier.map(map).transpose()?;
    let is_known = |keyframe: &StoredKeyframe| {
        let same = earlier.as_ref().and_then(|earlier| earlier.store.get(keyframe.id));
        same.is_some_and(|same| same.view == keyframe.view && same.session == keyframe.session)
    };
    let map = map(keyframes)?;
    let others = || map.store.iter().filter(|keyframe| !is_known(keyframe));
    require_memory(others()).map_err(PoseSourceError::State)?;
    let view = |keyframe: &StoredKeyframe| {
        Some(KeyframeView {
            id: keyframe.id,
            world_from_camera: keyframe.world_from_key,
            intrinsics: keyframe.view.intrinsics,
            depth: keyframe.view.depth()?,
        })
    };
    Ok(others().filter_map(view).collect())
}

/// Checks that the depth of keyframes fits into the memory limit.
fn require_memory<'a>(keyframes: impl Iterator<Item = &'a StoredKeyframe>) -> Result<(), String> {
    let bytes = |keyframe: &StoredKeyframe| 4 * keyframe.view.intrinsics.width * keyframe.view.intrinsics.height;
    let (needed, limit) = (keyframes.map(|keyframe| bytes(keyframe) as u64).sum(), MemoryLimit::in_force());
    if needed <= limit {
        return Ok(());
    }
    let (needed, limit) = (display_bytes(needed), display_bytes(limit));
    Err(format!("the views of the keyframes take {needed}, but the memory limit is {limit}: raise memory_limit"))
}
