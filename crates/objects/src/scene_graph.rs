//! The scene graph: rooms, their objects, and the relations between them. `docs/scene_graph.schema.json` is its schema.

use crate::list::outer_lines;
use crate::{ObjectList, OrientedBox, Relation, RoomNameSource};
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// Rooms, objects and relations of a map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneGraph {
    /// [`SceneGraph::FORMAT`].
    pub format: String,
    /// [`SceneGraph::VERSION`]: it changes when the meaning of a key changes, not when a key is added.
    pub version: u32,
    /// Unit vector that points up, in world coordinates; null if unknown.
    pub up: Option<Vec3>,
    /// Number of frames that the map was made from, of all runs together.
    pub frames: u32,
    /// The rooms. One without a name if rooms are not known.
    pub rooms: Vec<SceneRoom>,
    /// The objects that count, by id.
    pub objects: Vec<SceneObject>,
    /// The relations that are certain, by subject.
    pub relations: Vec<Relation>,
}

/// A room.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SceneRoom {
    /// Its number, from 1.
    pub id: u32,
    /// Its name; null without one.
    pub name: Option<String>,
    /// Who gave the name; missing without one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name_source: Option<RoomNameSource>,
    /// The objects in it, by id.
    pub objects: Vec<SegmentId>,
}

/// An object of a scene graph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneObject {
    /// Its id, which stays the same while the map is continued.
    pub id: SegmentId,
    /// Its label; null without one.
    pub label: Option<String>,
    /// The room that it is in; null if it is in none.
    pub room: Option<u32>,
    /// Mean sRGB colour.
    pub color: Option<[u8; 3]>,
    /// The box around it; null if it has no place.
    #[serde(rename = "box")]
    pub oriented_box: Option<OrientedBox>,
    /// When and where it was last seen.
    pub last_seen: LastSeen,
}

/// When and where an object was last seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LastSeen {
    /// Number of the frame, counted over all runs of the map, from 0; null if unknown.
    pub frame: Option<u32>,
    /// Time of the frame, seconds, as the scene stamps it; null if unknown, as in maps of earlier versions.
    pub time_s: Option<f64>,
    /// The object's centre, world coordinates, metres; null if it has no place.
    pub position: Option<DVec3>,
}

impl SceneGraph {
    /// The value of the key `format`.
    pub const FORMAT: &'static str = "splatseg-scene-graph";
    /// The value of the key `version`.
    pub const VERSION: u32 = 1;

    /// The graph of a list with its relations, with one room. `last_seen` has the number of the last frame that saw each
    /// object, of `frames`.
    pub fn new(list: &ObjectList, up: Option<Vec3>, frames: u32, last_seen: &BTreeMap<SegmentId, u32>) -> Self {
        let object = |object: &crate::Object| {
            let of_run = object.last_frame.as_ref().and_then(|frame| frame.time_s);
            let stamp = object.last_seen_s.or(of_run);
            let position = object.shape.as_ref().map(|shape| shape.centroid);
            SceneObject {
                id: object.id,
                label: object.label.clone(),
                room: Some(1),
                color: object.color,
                oriented_box: object.shape.as_ref().map(|shape| shape.oriented_box),
                last_seen: LastSeen { frame: last_seen.get(&object.id).copied(), time_s: stamp, position },
            }
        };
        let mut objects: Vec<SceneObject> = list.objects.iter().map(object).collect();
        objects.sort_by_key(|object| object.id);
        let whole = SceneRoom {
            id: 1,
            name: None,
            name_source: None,
            objects: objects.iter().map(|object| object.id).collect(),
        };
        Self {
            format: Self::FORMAT.to_owned(),
            version: Self::VERSION,
            up,
            frames,
            rooms: vec![whole],
            objects,
            relations: list.relations.clone(),
        }
    }

    /// Replaces the rooms by others, whose objects are those that `rooms` has in them.
    pub fn set_rooms(&mut self, mut others: Vec<SceneRoom>, rooms: &BTreeMap<SegmentId, u32>) {
        for object in &mut self.objects {
            let room = rooms.get(&object.id).copied();
            object.room = room.filter(|room| others.iter().any(|other| other.id == *room));
        }
        for room in &mut others {
            let inside = self.objects.iter().filter(|object| object.room == Some(room.id));
            room.objects = inside.map(|object| object.id).collect();
        }
        self.rooms = others;
    }

    /// The JSON text, with one line for each room, object and relation.
    ///
    /// # Errors
    /// No known cause: every value can be serialised.
    pub fn to_json(&self) -> serde_json::Result<String> {
        outer_lines(self)
    }
}
