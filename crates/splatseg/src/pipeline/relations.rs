//! Relations between the objects of a map, and its scene graph.

use super::map_places::add_rooms;
use super::{NamedMap, Pipeline, depth_views};
use glam::Vec3;
use splatseg_geometry::{MapView, SegmentId, UpEstimate};
use splatseg_objects::{
    ListedRoom, ObjectList, ObjectLog, ObjectSurfaces, Relation, SceneGraph, SceneRoom, relations_of,
};
use splatseg_odometry::{PoseSourceError, keyframe_views};
use splatseg_places::{FloorPlan, PlanSettings};
use std::collections::BTreeMap;

impl Pipeline {
    /// Where up is, as the camera of the keyframes was held: a unit vector in world coordinates. `None` without keyframes.
    pub fn up(&self) -> Option<Vec3> {
        UpEstimate::of(self.keyframes().values().map(|keyframe| &keyframe.world_from_keyframe))
    }

    /// The objects as [`Self::object_list`] has them, with the relations between them that are certain, and with their rooms if
    /// there is a plan of the map. Objects are looked for again in the plan: the map may show other ones than it did.
    pub fn objects_with_places(&self, plan: Option<&mut FloorPlan>) -> ObjectList {
        let Some(map) = self.map() else { return self.object_list() };
        let surfaces = ObjectSurfaces::of(&map);
        let relations = self.up().map_or_else(Vec::new, |up| relations_of(&map, &surfaces, up));
        let mut list = self.list_with(&map, &surfaces, &relations);
        if let Some(plan) = plan {
            plan.look_for_objects(&map, &surfaces);
            plan.name_rooms(self.names());
            add_rooms(&mut list, plan);
        }
        list
    }

    /// The objects of the map with these surfaces and relations.
    pub(super) fn list_with(&self, map: &MapView<'_>, surfaces: &ObjectSurfaces, relations: &[Relation]) -> ObjectList {
        let mut list = self.described(ObjectList::with_surfaces(self.objects(), Some(*map), surfaces));
        list.set_relations(relations);
        list
    }
}

impl NamedMap {
    /// Where up is, as the camera of the keyframes was held: a unit vector in world coordinates. `None` without keyframes.
    ///
    /// # Errors
    /// If the keyframes are damaged, or take more than the memory limit.
    pub fn up(&self) -> Result<Option<Vec3>, PoseSourceError> {
        let Some(keyframes) = &self.keyframes else { return Ok(None) };
        let views = keyframe_views(keyframes, None)?;
        Ok(UpEstimate::of(views.iter().map(|view| &view.world_from_camera)))
    }

    /// The objects as [`Self::object_list`] has them, with their rooms and the relations between them that are certain, as
    /// [`Pipeline::objects_with_places`]. A map that shows no floor has no rooms.
    ///
    /// # Errors
    /// As [`Self::up`].
    pub fn objects_with_places(&self) -> Result<ObjectList, PoseSourceError> {
        let map = self.memory.map();
        let surfaces = ObjectSurfaces::of(&map);
        let mut list = self.described(ObjectList::with_surfaces(&ObjectLog::default(), Some(map), &surfaces));
        let Some(keyframes) = &self.keyframes else { return Ok(list) };
        if let Some(up) = self.up()? {
            list.set_relations(&relations_of(&map, &surfaces, up));
        }
        let views = depth_views(keyframes, None)?;
        if let Ok(mut plan) = FloorPlan::without_objects(&map, &views, PlanSettings::default()) {
            plan.look_for_objects(&map, &surfaces);
            plan.keep_room_ids(&mut self.history.rooms.clone());
            plan.name_rooms(&self.names);
            add_rooms(&mut list, &plan);
        }
        Ok(list)
    }

    /// The objects of the map that count, their rooms and relations, and when each was last seen. A map that shows no floor is
    /// one room.
    ///
    /// # Errors
    /// As [`Self::up`].
    pub fn scene_graph(&self) -> Result<SceneGraph, PoseSourceError> {
        let seen = (self.memory.frame_count(), self.memory.last_seen());
        Ok(graph_of(&self.objects_with_places()?, self.up()?, seen))
    }
}

/// The scene graph of a list, where up is, and when objects were seen: the frames of the map, and the last one of each.
pub(super) fn graph_of(
    list: &ObjectList,
    up: Option<Vec3>,
    (frames, last_seen): (u32, BTreeMap<SegmentId, u32>),
) -> SceneGraph {
    let mut graph = SceneGraph::new(list, up, frames, &last_seen);
    if !list.rooms.is_empty() {
        let room = |room: &ListedRoom| SceneRoom {
            id: room.id,
            name: room.name.clone(),
            name_source: room.name_source,
            objects: Vec::new(),
        };
        let of_objects = list.objects.iter().filter_map(|one| Some((one.id, one.room?))).collect();
        graph.set_rooms(list.rooms.iter().map(room).collect(), &of_objects);
    }
    graph
}
