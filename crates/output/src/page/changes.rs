//! The page's data about what has changed since the loaded map.

use super::map::{MapData, map_data};
use crate::{ChangesSince, segment_color};
use glam::DVec3;
use serde::Serialize;
use splatseg_geometry::SegmentId;
use splatseg_objects::{ChangedObject, MapChanges, OrientedBox};
use std::collections::BTreeSet;

/// Changes of the map, read by `viewer/src/change_list.js`.
#[derive(Debug, Serialize)]
pub struct ChangesData {
    gone: Vec<PlaceData>,
    new: Vec<PlaceData>,
    moved: Vec<MoveData>,
    /// Numbers of objects.
    unchanged: usize,
    not_looked_at: usize,
    newly_seen: usize,
    /// The Gaussians of the objects that are gone or have moved, at their old places.
    map_before: MapData,
}

/// An object at its place.
#[derive(Debug, Serialize)]
struct PlaceData {
    id: SegmentId,
    /// Its colour on the page, sRGB.
    color: [u8; 3],
    #[serde(rename = "box")]
    oriented_box: OrientedBox,
}

#[derive(Debug, Serialize)]
struct MoveData {
    before: PlaceData,
    after: PlaceData,
    /// Metres.
    distance: f64,
}

impl ChangesData {
    /// The changes; the map at old places is relative to an origin in world coordinates.
    pub fn new(since: &ChangesSince<'_>, origin: DVec3) -> Self {
        let MapChanges { gone, new, moved, unchanged, not_looked_at, newly_seen, .. } = since.changes;
        let removed: BTreeSet<SegmentId> =
            gone.iter().chain(moved.iter().map(|moved| &moved.before)).map(|object| object.id).collect();
        let moves = moved.iter().map(|moved| MoveData {
            before: PlaceData::of(&moved.before),
            after: PlaceData::of(&moved.after),
            distance: moved.distance,
        });
        Self {
            gone: gone.iter().map(PlaceData::of).collect(),
            new: new.iter().map(PlaceData::of).collect(),
            moved: moves.collect(),
            unchanged: unchanged.len(),
            not_looked_at: not_looked_at.len(),
            newly_seen: newly_seen.len(),
            map_before: map_data(&since.before, origin, |id| removed.contains(&id)),
        }
    }
}

impl PlaceData {
    fn of(object: &ChangedObject) -> Self {
        Self { id: object.id, color: segment_color(object.id), oriented_box: object.shape.oriented_box }
    }
}
