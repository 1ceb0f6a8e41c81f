//! Keyframes that were read from a file: whether they can be, and belong together.

use crate::graph::{Edge, PoseGraph};
use crate::keyframe_map::KeyframeMap;
use crate::keyframes::{KeyframeStore, MAX_PIXELS, MAX_STORED, MAX_WIDTH, StoredKeyframe, is_possible_color};
use crate::loops::{ClosedLoop, LoopCandidate, LoopCheck};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{KeyframeId, Pose};

/// A keyframe has at most this many features.
const MAX_FEATURES: usize = 1000;

/// The fields of a [`KeyframeMap`] in a file, not checked yet.
pub(crate) struct ReadKeyframes {
    pub(crate) keyframes: Vec<StoredKeyframe>,
    pub(crate) replaced: Vec<(KeyframeId, KeyframeId, Pose)>,
    pub(crate) edges: Vec<Edge>,
    pub(crate) state: SearchState,
}

/// The fields of a [`KeyframeMap`] that are no arrays.
#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct SearchState {
    pub(crate) session: u32,
    pub(crate) part: u32,
    pub(crate) next: KeyframeId,
    pub(crate) latest: Option<KeyframeId>,
    pub(crate) checks: Vec<LoopCheck>,
    pub(crate) candidates: Vec<LoopCandidate>,
    pub(crate) closed: Option<ClosedLoop>,
}

impl ReadKeyframes {
    /// The map of keyframes.
    pub(crate) fn checked(self) -> Result<KeyframeMap, String> {
        let Self { keyframes, replaced, edges, state } = self;
        if keyframes.len() > MAX_STORED {
            return Err(format!("{} keyframes, expected at most {MAX_STORED}", keyframes.len()));
        }
        let mut store = KeyframeStore::default();
        for keyframe in keyframes {
            if keyframe.id >= state.next || store.get(keyframe.id).is_some() {
                return Err(format!("keyframe {} occurs twice or was never made", keyframe.id));
            }
            store.add(keyframe);
        }
        store.next = state.next;
        store.replaced = replaced.into_iter().map(|(id, kept, pose)| (id, (kept, pose))).collect();
        let is_known = |id: KeyframeId| store.get(id).is_some();
        if edges.iter().any(|edge| !is_known(edge.from) || !is_known(edge.to)) {
            return Err("a relative pose of a keyframe that does not exist".to_owned());
        }
        if edges.iter().flat_map(|edge| edge.information).flatten().any(|number| !number.is_finite()) {
            return Err("a relative pose with information that is not finite".to_owned());
        }
        let latest = state.latest.filter(|id| is_known(*id));
        let mut map = KeyframeMap {
            store,
            graph: PoseGraph { edges },
            part: state.part,
            session: state.session,
            latest,
            checks: state.checks.into(),
            candidates: state.candidates.into(),
            closed: state.closed,
            ..KeyframeMap::default()
        };
        map.find_uncertain();
        Ok(map)
    }
}

impl StoredKeyframe {
    /// Returns `self` if its images can be read.
    pub(crate) fn checked(self) -> Result<Self, String> {
        let (id, camera) = (self.id, self.view.intrinsics);
        let damaged = |what: &str| format!("keyframe {id}: {what} cannot be read");
        camera.validated().map_err(|error| format!("keyframe {id}: {error}"))?;
        if self.features.len() > MAX_FEATURES {
            return Err(damaged("features"));
        }
        if !self.view.has_possible_size() {
            let (width, height) = (camera.width, camera.height);
            let expected = format!("at most {MAX_WIDTH} columns and {MAX_PIXELS} pixels in all");
            return Err(format!("keyframe {id}: {width}x{height} pixels, expected {expected}"));
        }
        if !self.color.is_empty() && !is_possible_color(&self.color) {
            return Err(damaged("the colour image"));
        }
        self.view.pyramid().ok_or_else(|| damaged("image"))?;
        Ok(self)
    }
}
