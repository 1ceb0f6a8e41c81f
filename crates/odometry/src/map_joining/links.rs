//! Measured relative poses between keyframes of two maps that show the same surfaces.

use crate::graph::Edge;
use crate::keyframes::{KeyframeStore, StoredKeyframe, apart, distance};
use crate::loop_closing::{edge, features_agree};
use crate::relocalisation::{Query, Recognised};
use rayon::prelude::*;
use splatseg_geometry::KeyframeId;

/// Keyframes of two maps are aligned if they are this close, as in [`distance`].
const NEAR: f64 = 1.3;

/// Number of keyframes that each one is aligned with.
const NEIGHBOURS: usize = 2;

/// An alignment may move a keyframe this far, metres and radians: it was put near its place already.
const MAX_CHANGE: (f64, f64) = (0.12, 0.08);

/// A measured relative pose.
#[derive(Clone, Debug)]
pub(super) struct Link {
    pub(super) edge: Edge,
    /// Share of the measurements that agree, 0 to 1: the lower one of depth and image.
    pub(super) agreement: f32,
}

/// Aligns keyframes from number `first_later` on with the earlier ones that should show the same.
pub(super) fn links(store: &KeyframeStore, first_later: KeyframeId) -> Vec<Link> {
    let (earlier, later): (Vec<&StoredKeyframe>, Vec<&StoredKeyframe>) =
        store.iter().partition(|keyframe| keyframe.id < first_later);
    later.par_iter().flat_map_iter(|keyframe| links_of(keyframe, &earlier)).collect()
}

fn links_of(keyframe: &StoredKeyframe, earlier: &[&StoredKeyframe]) -> Vec<Link> {
    let start = &keyframe.world_from_key;
    let away = |other: &StoredKeyframe| distance(&other.world_from_key, start);
    let same_part = earlier.iter().copied().filter(|other| other.part == keyframe.part);
    let mut near: Vec<(f64, &StoredKeyframe)> =
        same_part.map(|other| (away(other), other)).filter(|(away, _)| *away <= NEAR).collect();
    near.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.id.cmp(&other.1.id)));
    near.truncate(NEIGHBOURS);
    let Some(query) = (!near.is_empty()).then(|| Query::of_keyframe(keyframe)).flatten() else { return Vec::new() };
    let link = |(_, other): (f64, &StoredKeyframe)| {
        let found = query.align(other, start).filter(Recognised::is_sure)?;
        let (moved, turned) = apart(&found.world_from_camera, start);
        let is_near = moved <= MAX_CHANGE.0 && turned <= MAX_CHANGE.1;
        (is_near && features_agree(keyframe, other, &found.key_from_camera))
            .then(|| Link { edge: edge(&found, keyframe.id), agreement: found.agreement })
    };
    near.into_iter().filter_map(link).collect()
}
