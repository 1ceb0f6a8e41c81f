//! The page's data about a run, read by `viewer/src/run.js`.

use super::changes::ChangesData;
use super::map::MapData;
use super::plan::PlanData;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Intrinsics, SegmentId};
use splatseg_objects::{ObjectState, OrientedBox};

/// All data of a run except the ids of its frames' pixels.
#[derive(Debug, Serialize)]
pub struct RunData<'a> {
    /// Version of splatseg.
    pub version: &'static str,
    /// The scene as given by the user.
    pub scene: &'a str,
    /// Number of frames in each file with ids, except the last.
    pub frames_per_chunk: usize,
    /// Names of the frames' files, without folder and extension.
    pub frames: &'a [String],
    /// Timestamps of the frames, seconds; null for a frame without one, missing if no frame has one.
    #[serde(skip_serializing_if = "no_stamps")]
    pub stamps: &'a [Option<f64>],
    /// Ids that turned out to be the same object: the index of a frame, an id in the frames before it, and the id that it
    /// turned out to be. In order. The files with ids have those of their time.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub remapped: Vec<(usize, SegmentId, SegmentId)>,
    /// Origin of the coordinates of `poses` and `map`: world coordinates, metres.
    pub origin: DVec3,
    /// For each frame, the camera's final pose: its centre, relative to `origin`, and rotation from camera to world as a quaternion
    /// x, y, z, w: seven 32-bit floats, little-endian, in base64.
    pub poses: String,
    /// The cameras, in the order of their first frames.
    pub cameras: &'a [CameraData],
    /// Unit vector pointing up, in world coordinates.
    pub up: Vec3,
    /// The objects: those that count first, then those that most frames show, then by id.
    pub objects: Vec<ObjectData>,
    /// Changes since the loaded map; missing if none was loaded.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub changes: Option<ChangesData>,
    /// The map; missing if the method has no memory.
    pub map: Option<MapData>,
    /// The floor plan; missing if the map shows no floor.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plan: Option<PlanData>,
}

fn no_stamps(stamps: &&[Option<f64>]) -> bool {
    stamps.iter().all(Option::is_none)
}

/// A camera's intrinsics.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct CameraData {
    /// Index of the first frame taken with it.
    pub from: usize,
    /// The intrinsics.
    #[serde(flatten)]
    pub intrinsics: Intrinsics,
}

/// An object. Frames are given by their index.
#[derive(Debug, Serialize)]
pub struct ObjectData {
    /// Its id.
    pub id: SegmentId,
    /// Its colour on the page, sRGB.
    pub color: [u8; 3],
    /// Number of frames that show it.
    pub frames: usize,
    /// First and last frame of each stretch of frames that show it.
    pub seen: Vec<(usize, usize)>,
    /// Its largest area in a frame, pixels.
    pub area: usize,
    /// The frame in which its area is largest.
    pub best: usize,
    /// The mean of its confidence over its frames, from 0 to 1; missing if no frame shows it.
    pub confidence: Option<f32>,
    /// Its label, if one was assigned.
    pub label: Option<String>,
    /// Its state in the memory; missing if the method has no memory.
    pub state: Option<ObjectState>,
    /// Number of its Gaussians; missing if there are none.
    pub gaussians: Option<usize>,
    /// Mean of its surface, world, metres; missing if it has no Gaussians.
    pub centroid: Option<DVec3>,
    /// The tightest box around it; missing if it has no Gaussians.
    #[serde(rename = "box")]
    pub oriented_box: Option<OrientedBox>,
    /// Path of its crop in the folder of the run; missing if no frame shows it.
    pub crop: Option<String>,
}
