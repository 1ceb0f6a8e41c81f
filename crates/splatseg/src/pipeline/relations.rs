//! Relations between the objects of a map, and its scene graph.

use super::{NamedMap, Pipeline};
use glam::Vec3;
use splatseg_geometry::UpEstimate;
use splatseg_objects::{ObjectList, SceneGraph, SceneObject, SceneRoom, relations};
use splatseg_odometry::{PoseSourceError, keyframe_views};
use splatseg_places::{PlanSettings, Room};

impl Pipeline {
    /// Adds the relations between objects that are certain to a list of this pipeline. None without keyframes, since they
    /// tell where up is.
    pub fn add_relations(&self, list: &mut ObjectList) {
        let keyframes = self.keyframes();
        let up = UpEstimate::of(keyframes.values().map(|keyframe| &keyframe.world_from_keyframe));
        if let Some((map, up)) = self.map().zip(up) {
            list.set_relations(&relations(&map, up));
        }
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
