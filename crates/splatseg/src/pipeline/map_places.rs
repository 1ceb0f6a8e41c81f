//! The plan of a map: of a saved one, of a pipeline's, and beside the frames.

use super::relations::graph_of;
use super::stages::in_thread_pool;
use super::{NamedMap, Pipeline, depth_views};
use glam::{DVec2, DVec3};
use splatseg_geometry::{MapCopy, MapView, SegmentId, UpEstimate};
use splatseg_objects::{
    ListedRoom, NameError, ObjectList, ObjectNames, ObjectSurfaces, Relation, SceneGraph, relations_of,
};
use splatseg_odometry::{PoseSourceError, StateScope};
use splatseg_places::{FloorPlan, KnownRooms, PlanError, PlanSettings, Room};
use std::collections::BTreeMap;
use thiserror::Error;

/// Why a map has no plan.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MapPlanError {
    /// Its keyframes are damaged, or take more than the memory limit.
    #[error(transparent)]
    Keyframes(#[from] PoseSourceError),
    /// It does not show a floor, for example.
    #[error(transparent)]
    Plan(#[from] PlanError),
}

/// Why a room was not named.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RoomNameError {
    /// The plan has no room of this number.
    #[error("room {number}: found no such room, expected one of {rooms:?}")]
    NoRoom {
        /// The number.
        number: u32,
        /// The numbers of the rooms.
        rooms: Vec<u32>,
    },
    /// The name cannot be used.
    #[error("room {number}: {source}")]
    Name {
        /// The number.
        number: u32,
        /// The problem.
        source: NameError,
    },
}

/// Input of the plan of a pipeline's map at one moment, for another thread.
#[derive(Clone, Debug)]
pub struct MapPlanInput {
    map: MapCopy,
    keyframes: Vec<u8>,
    rooms: KnownRooms,
    names: ObjectNames,
}

/// The plan of a map, and the relations between its objects.
#[derive(Clone, Debug)]
pub struct MapPlaces {
    /// The plan, whose rooms have the numbers of [`Self::rooms`], or why there is none.
    pub plan: Result<FloorPlan, PlanError>,
    /// The rooms so far: for [`Pipeline::set_rooms`].
    pub rooms: KnownRooms,
    listed: Option<ListedRooms>,
    relations: Vec<Relation>,
}

impl MapPlaces {
    /// Adds rooms and relations to a list of the same map's objects.
    pub fn add_to(&self, list: &mut ObjectList) {
        list.set_relations(&self.relations);
        if let Some(listed) = self.listed.clone() {
            listed.add_to(list);
        }
    }
}

/// The rooms of a plan as a list of objects has them.
#[derive(Clone, Debug)]
struct ListedRooms {
    rooms: Vec<ListedRoom>,
    of_objects: BTreeMap<SegmentId, u32>,
}

impl MapPlanInput {
    /// Makes the plan, on the threads of the caller's pool.
    ///
    /// # Errors
    /// If the keyframes take more than the memory limit.
    pub fn places(self, settings: PlanSettings) -> Result<MapPlaces, PoseSourceError> {
        let Self { map, keyframes, mut rooms, names } = self;
        let views = depth_views(&keyframes, None)?;
        let map = map.view();
        let surfaces = ObjectSurfaces::of(&map);
        let mut plan = FloorPlan::without_objects(&map, &views, settings);
        if let Ok(plan) = &mut plan {
            plan.look_for_objects(&map, &surfaces);
            plan.keep_room_ids(&mut rooms);
            plan.name_rooms(&names);
        }
        let up = UpEstimate::of(views.iter().map(|view| &view.world_from_camera));
        let relations = up.map_or_else(Vec::new, |up| relations_of(&map, &surfaces, up));
        Ok(MapPlaces { listed: plan.as_ref().ok().map(ListedRooms::of), plan, rooms, relations })
    }
}

impl Pipeline {
    /// The plan of the map as it is now. Rooms keep the numbers that they had in earlier plans.
    ///
    /// # Errors
    /// If there is no map, it has no keyframes, and as [`FloorPlan::new`].
    pub fn floor_plan(&mut self, settings: PlanSettings) -> Result<FloorPlan, MapPlanError> {
        let mut rooms = self.history.rooms.clone();
        let map = self.map().ok_or(PlanError::NoKeyframes)?;
        let mut plan = plan_of(&map, self.saved_poses(StateScope::Map).as_deref(), &mut rooms, settings)?;
        plan.name_rooms(self.names());
        self.history.rooms = rooms;
        Ok(plan)
    }

    /// The plan of the map as it is now, as [`Self::floor_plan`], and the objects with their relations and rooms, as
    /// [`Self::objects_with_places`]: both at the same time. There is no plan where [`Self::floor_plan`] fails: many maps show no
    /// floor.
    pub fn objects_and_plan(&mut self, settings: PlanSettings) -> (ObjectList, Option<FloorPlan>) {
        let Some(map) = self.map() else { return (self.object_list(), None) };
        let (keyframes, up) = (self.saved_poses(StateScope::Map), self.up());
        let space = || {
            let views = depth_views(&keyframes?, None).ok()?;
            FloorPlan::without_objects(&map, &views, settings).ok()
        };
        let measured = || {
            let surfaces = ObjectSurfaces::of(&map);
            let relations = up.map_or_else(Vec::new, |up| relations_of(&map, &surfaces, up));
            (surfaces, relations)
        };
        let (mut plan, (surfaces, relations)) = in_thread_pool(|| rayon::join(space, measured));
        let mut list = self.list_with(&map, &surfaces, &relations);
        if let Some(plan) = &mut plan {
            plan.look_for_objects(&map, &surfaces);
            let mut rooms = self.history.rooms.clone();
            plan.keep_room_ids(&mut rooms);
            plan.name_rooms(self.names());
            self.history.rooms = rooms;
            add_rooms(&mut list, plan);
        }
        (list, plan)
    }

    /// The input of [`Self::floor_plan`], for another thread; `None` without a map with keyframes.
    pub fn plan_input(&self) -> Option<MapPlanInput> {
        let keyframes = self.saved_poses(StateScope::Map)?;
        let (rooms, names) = (self.history.rooms.clone(), self.names().clone());
        Some(MapPlanInput { map: MapCopy::of(&self.map()?), keyframes, rooms, names })
    }

    /// Rooms, objects and relations of a list of this pipeline's objects.
    pub fn scene_graph(&self, list: &ObjectList) -> SceneGraph {
        let seen = self.memory().map(|memory| (memory.frame_count(), memory.last_seen())).unwrap_or_default();
        graph_of(list, self.up(), seen)
    }

    /// Sets the rooms so far, after a plan of [`Self::plan_input`].
    pub fn set_rooms(&mut self, rooms: KnownRooms) {
        self.history.rooms = rooms;
    }
}

impl NamedMap {
    /// The plan of the map: its floor, free space, rooms with their names, and the objects in them. Rooms have the numbers that they had in the
    /// session that saved the map.
    ///
    /// # Errors
    /// If the map has no keyframes or they are damaged, and as [`FloorPlan::new`].
    pub fn floor_plan(&self, settings: PlanSettings) -> Result<FloorPlan, MapPlanError> {
        let mut rooms = self.history.rooms.clone();
        let mut plan = plan_of(&self.memory.map(), self.keyframes.as_deref(), &mut rooms, settings)?;
        plan.name_rooms(&self.names);
        Ok(plan)
    }

    /// Gives a room of a plan of this map the name of a person, or takes such a name away with `None`. The plan gets its new
    /// names. The name belongs to the place where the room is widest.
    ///
    /// # Errors
    /// [`RoomNameError`] if there is no such room, or the name cannot be used; then nothing has changed.
    pub fn name_room(&mut self, plan: &mut FloorPlan, number: u32, name: Option<&str>) -> Result<(), RoomNameError> {
        let room = plan.rooms().iter().find(|room| room.id == number);
        let rooms = || plan.rooms().iter().map(|room| room.id).collect();
        let place = plan.place_of(room.ok_or_else(|| RoomNameError::NoRoom { number, rooms: rooms() })?);
        let mut rooms = self.names.rooms().clone();
        rooms.remove(|place| plan.room_around(place).is_some_and(|other| other.id == number));
        if let Some(name) = name {
            rooms.add(place, name).map_err(|source| RoomNameError::Name { number, source })?;
        }
        *self.names.rooms_mut() = rooms;
        plan.name_rooms(&self.names);
        Ok(())
    }
}

fn plan_of(
    map: &MapView<'_>,
    keyframes: Option<&[u8]>,
    rooms: &mut KnownRooms,
    settings: PlanSettings,
) -> Result<FloorPlan, MapPlanError> {
    let views = keyframes.map_or_else(|| Ok(Vec::new()), |keyframes| depth_views(keyframes, None))?;
    let mut plan = FloorPlan::new(map, &views, settings)?;
    plan.keep_room_ids(rooms);
    Ok(plan)
}

/// Adds the rooms of a plan to a list of the same map's objects.
pub(super) fn add_rooms(list: &mut ObjectList, plan: &FloorPlan) {
    ListedRooms::of(plan).add_to(list);
}

impl ListedRooms {
    fn of(plan: &FloorPlan) -> Self {
        let frame = plan.frame();
        let place = |place: DVec2| millimetres(frame.to_world(place));
        let room = |room: &Room| ListedRoom {
            id: room.id,
            name: room.name.clone(),
            name_source: room.name_source,
            area_m2: (room.area_m2 * 1e4).round() / 1e4,
            middle: place(room.middle),
            outlines: plan.room_outlines(room.id).into_iter().map(|one| one.into_iter().map(place).collect()).collect(),
            objects: Vec::new(),
        };
        Self { rooms: plan.rooms().iter().map(room).collect(), of_objects: plan.rooms_of_objects() }
    }

    fn add_to(self, list: &mut ObjectList) {
        list.set_rooms(self.rooms, &self.of_objects);
    }
}

/// Rounds a place, and leaves no zero with a sign.
fn millimetres(place: DVec3) -> DVec3 {
    (place * 1e3).round() / 1e3 + 0.0
}
