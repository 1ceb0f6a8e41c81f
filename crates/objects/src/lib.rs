//! The objects of a video: the sightings, confidence, position and size of each.
//!
//! [`ObjectLog`] counts the sightings of every frame; [`object_shapes`] measures the Gaussians of a memory;
//! [`ObjectList`] combines both and is the content of `objects.json`.

mod changes;
mod csv;
mod kept_views;
mod list;
mod listed_rooms;
mod names;
mod object_view;
mod old_names;
mod relations;
mod remap_log;
mod room_names;
mod scene_graph;
mod seen;
mod seen_surface;
mod seen_times;
mod shape;
mod sightings;
mod vertex_ids;

pub use changes::{
    ChangedObject, DepthView, MapChanges, MovedObject, ObservedMap, PlaceSight, UnchangedObject, place_sights,
};
pub use kept_views::{KeptViews, ViewedFrame};
pub use list::{BestView, Conventions, FrameStamp, Object, ObjectCounts, ObjectList, ObjectState};
pub use listed_rooms::ListedRoom;
pub use names::{LabelScore, NameError, ObjectName, ObjectNames};
pub use object_view::ObjectView;
pub use relations::{Relation, RelationKind, relations, relations_of};
pub use remap_log::RemapLog;
pub use room_names::{RoomName, RoomNameSource, RoomNames, moved_with_nearest};
pub use scene_graph::{LastSeen, SceneGraph, SceneObject, SceneRoom};
pub use seen::{SeenObjects, Sightings};
pub use seen_times::{SeenTime, SeenTimes};
pub use shape::{AxisAlignedBox, ObjectShape, ObjectSurfaces, OrientedBox, object_shapes};
pub use sightings::{BoundingBox, ObjectLog, ObjectRecord, ObjectSighting};
pub use vertex_ids::{VertexId, vertex_ids};

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
