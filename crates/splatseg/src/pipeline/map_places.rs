//! The plan of a map.

use super::{NamedMap, Pipeline, depth_views};
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
