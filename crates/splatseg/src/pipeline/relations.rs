//! Relations between the objects of a map, and its scene graph.

use super::map_places::add_rooms;
use super::{NamedMap, Pipeline};
use glam::Vec3;
use splatseg_geometry::{MapView, UpEstimate};
use splatseg_objects::{
    ObjectList, ObjectSurfaces, Relation, SceneGraph, SceneObject, SceneRoom, relations, relations_of,
};
use splatseg_odometry::{PoseSourceError, keyframe_views};
use splatseg_places::{FloorPlan, PlanSettings, Room};

impl Pipeline {
    /// Where up is, as the camera of the keyframes was held: a unit vector in world coordinates. `None` without keyframes.
    pub(super) fn up(&self) -> Option<Vec3> {
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

    /// The objects of the map that count, their rooms and relations, and when each was last seen. A map that shows no floor is
    /// one room.
    ///
    /// # Errors
    /// As [`Self::up`].
    pub fn scene_graph(&self) -> Result<SceneGraph, PoseSourceError> {
        let (mut list, up) = (self.object_list(), self.up()?);
        if let Some(up) = up {
            list.set_relations(&relations(&self.memory.map(), up));
        }
        let mut graph = SceneGraph::new(&list, up, self.memory.frame_count(), &self.memory.last_seen());
        // A map that shows no floor is one room.
        if let Ok(plan) = self.floor_plan(PlanSettings::default())
            && !plan.rooms().is_empty()
        {
            let room = |room: &Room| SceneRoom {
                id: room.id,
                name: room.name.clone(),
                name_source: room.name_source,
                objects: Vec::new(),
            };
            let room_of = |object: &SceneObject| Some((object.id, plan.room_of(object.id)?.id));
            let rooms = graph.objects.iter().filter_map(room_of).collect();
            graph.set_rooms(plan.rooms().iter().map(room).collect(), &rooms);
        }
        Ok(graph)
    }
}
