//! Surfaces that are gone, in the views of keyframes that were made before.

use crate::PoseSourceError;
use crate::saved_keyframes::{bytes, parsed};
use glam::{DVec3, IVec3, Vec2};
use rayon::prelude::*;
use splatseg_geometry::KeyframeId;
use std::collections::{BTreeMap, BTreeSet};

/// A measured surface is gone if it is this close to a place that is, metres.
const NEAR: f64 = 0.05;

/// Makes the depth of surfaces unknown in the keyframes before number `end`: those at `places`, world coordinates, metres.
/// `keyframes` are bytes from [`PoseSource::save`](crate::PoseSource::save) for a map, and so is the result.
///
/// # Errors
/// [`PoseSourceError::State`] if the bytes are damaged.
pub fn erase_surfaces(keyframes: &[u8], end: KeyframeId, places: &[DVec3]) -> Result<Vec<u8>, PoseSourceError> {
    let mut map = parsed(keyframes).map_err(PoseSourceError::State)?;
    let mut cells: BTreeMap<[i32; 3], Vec<DVec3>> = BTreeMap::new();
    for place in places {
        cells.entry(cell(*place).to_array()).or_default().push(*place);
    }
    let is_gone = |point: DVec3| {
        let own = cell(point);
        let around = (0..27).map(|index| own + IVec3::new(index % 3 - 1, index / 3 % 3 - 1, index / 9 - 1));
        around.filter_map(|cell| cells.get(&cell.to_array())).flatten().any(|place| place.distance(point) <= NEAR)
    };
    let earlier: BTreeSet<KeyframeId> = map.store.iter().map(|keyframe| keyframe.id).filter(|id| *id < end).collect();
    let views: Vec<_> = map.store.iter().filter(|keyframe| earlier.contains(&keyframe.id)).collect();
    let erased = views.into_par_iter().map(|keyframe| {
        let mut view = keyframe.view.clone();
        let (camera, pose) = (view.intrinsics, keyframe.world_from_key);
        let at = |(column, row): (usize, usize)| Vec2::new(column as f32, row as f32);
        view.erase_depth(|pixel, depth| is_gone(pose.to_world(camera.unproject(at(pixel), depth))));
        (keyframe.id, view)
    });
    for (id, view) in erased.collect::<Vec<_>>() {
        if let Some(keyframe) = map.store.get_mut(id) {
            keyframe.view = view;
        }
    }
    Ok(bytes(&map).unwrap_or_default())
}

fn cell(point: DVec3) -> IVec3 {
    (point / NEAR).floor().as_ivec3()
}
