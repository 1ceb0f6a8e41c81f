//! Settings of a plan: the size of its cells, and the heights at which a robot would hit something.

use crate::PlanError;
use serde::{Deserialize, Serialize};

/// Settings of a [`FloorPlan`](crate::FloorPlan).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PlanSettings {
    /// Side of a cell, metres, 0.01 to 1.
    pub resolution: f64,
    /// Height above the floor, metres, from which things are obstacles; the floor may be this uneven. 0.03 to 1.
    pub min_height: f64,
    /// Height above the floor, metres, up to which things are obstacles: that of the robot. Above `min_height`, at most 5.
    pub max_height: f64,
    /// Depth beyond this is not used, metres, 0.5 to 20: depth cameras are less exact farther away.
    pub max_range: f64,
    /// Cells at most this far from the path of the camera, metres, 0 to 1, are free if nothing was seen there: who held the
    /// camera, or the robot that carried it, has been there. It is an assumption, not a measurement: the camera may have been
    /// held over a table. 0 for none.
    #[serde(skip_serializing_if = "is_zero")]
    pub free_path: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Default for PlanSettings {
    fn default() -> Self {
        Self { resolution: 0.05, min_height: 0.1, max_height: 1.8, max_range: 5.0, free_path: 0.0 }
    }
}

impl PlanSettings {
    /// Checks that each setting is in its range.
    ///
    /// # Errors
    /// [`PlanError::Setting`] names the one that is not.
    pub fn validated(self) -> Result<Self, PlanError> {
        let ranges = [
            ("resolution", self.resolution, 0.01, 1.0),
            ("min_height", self.min_height, 0.03, 1.0),
            ("max_height", self.max_height, self.min_height + 0.05, 5.0),
            ("max_range", self.max_range, 0.5, 20.0),
            ("free_path", self.free_path, 0.0, 1.0),
        ];
        match ranges.into_iter().find(|(_, found, least, most)| !(least..=most).contains(&found)) {
            Some((name, found, least, most)) => Err(PlanError::Setting { name, found, least, most }),
            None => Ok(self),
        }
    }
}
