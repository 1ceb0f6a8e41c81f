//! The plan of a saved map.

use super::NamedMap;
use splatseg_objects::DepthView;
use splatseg_odometry::{KeyframeView, PoseSourceError, keyframe_views};
use splatseg_places::{FloorPlan, PlanError, PlanSettings};
use thiserror::Error;

/// Why a saved map has no plan.
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

/// The depth of a map's keyframes; none if it has no keyframes. `keyframes` are the bytes that the map was saved with.
///
/// # Errors
/// If they are damaged, or take more than the memory limit.
pub fn keyframe_depth(keyframes: Option<&[u8]>) -> Result<Vec<DepthView>, PoseSourceError> {
    let view = |view: KeyframeView| DepthView {
        world_from_camera: view.world_from_camera,
        intrinsics: view.intrinsics,
        depth: view.depth,
    };
    let Some(keyframes) = keyframes else { return Ok(Vec::new()) };
    Ok(keyframe_views(keyframes, None)?.into_iter().map(view).collect())
}

impl NamedMap {
    /// The plan of the map: its floor, free space, rooms and the objects in them.
    ///
    /// # Errors
    /// If the map has no keyframes or they are damaged, and as [`FloorPlan::new`].
    pub fn floor_plan(&self, settings: PlanSettings) -> Result<FloorPlan, MapPlanError> {
        let keyframes = keyframe_depth(self.keyframes.as_deref())?;
        Ok(FloorPlan::new(&self.memory.map(), &keyframes, settings)?)
    }
}
