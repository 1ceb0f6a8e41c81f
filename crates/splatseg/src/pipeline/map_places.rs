//! The plan of a map.

use super::{NamedMap, Pipeline, depth_views};
use splatseg_objects::NameError;
use splatseg_odometry::{PoseSourceError, StateScope};
use splatseg_places::{FloorPlan, PlanError, PlanSettings};
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
    #[error("room {number}: found no such room, expected 1 to {count}")]
    NoRoom {
        /// The number.
        number: u32,
        /// Number of rooms.
        count: usize,
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

impl NamedMap {
    /// The plan of the map: its floor, free space, rooms with their names, and the objects in them.
    ///
    /// # Errors
    /// If the map has no keyframes or they are damaged, and as [`FloorPlan::new`].
    pub fn floor_plan(&self, settings: PlanSettings) -> Result<FloorPlan, MapPlanError> {
        let keyframes =
            self.keyframes.as_deref().map_or_else(|| Ok(Vec::new()), |keyframes| depth_views(keyframes, None))?;
        let mut plan = FloorPlan::new(&self.memory.map(), &keyframes, settings)?;
        plan.name_rooms(&self.names);
        Ok(plan)
    }

    /// Gives a room of a plan of this map the name of a person, or takes such a name away with `None`. The plan gets its new
    /// names. The name belongs to the place where the room is widest.
    ///
    /// # Errors
    /// [`RoomNameError`] if there is no such room, or the name cannot be used; then nothing has changed.
    pub fn name_room(&mut self, plan: &mut FloorPlan, number: u32, name: Option<&str>) -> Result<(), RoomNameError> {
        let count = plan.rooms().len();
        let room = plan.rooms().iter().find(|room| room.id == number);
        let place = plan.place_of(room.ok_or(RoomNameError::NoRoom { number, count })?);
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

impl Pipeline {
    /// The plan of the map as it is now, as [`NamedMap::floor_plan`].
    ///
    /// # Errors
    /// As [`NamedMap::floor_plan`]. A method without a map has no keyframes.
    pub fn floor_plan(&self, settings: PlanSettings) -> Result<FloorPlan, MapPlanError> {
        let (Some(map), Some(keyframes)) = (self.map(), self.saved_poses(StateScope::Map)) else {
            return Err(PlanError::NoKeyframes.into());
        };
        let mut plan = FloorPlan::new(&map, &depth_views(&keyframes, None)?, settings)?;
        plan.name_rooms(self.names());
        Ok(plan)
    }
}
