//! What the page knows of a run, as its scripts read it: `viewer/src/run.js`.

use super::map::MapData;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Intrinsics, SegmentId};
use splatseg_objects::{ObjectState, OrientedBox};

/// All of a run but the ids of its frames.
#[derive(Debug, Serialize)]
pub struct RunData<'a> {
    /// Version of splatseg.
    pub version: &'static str,
    /// The scene as it was given.
    pub scene: &'a str,
    /// Frames in each of the files with ids but the last.
    pub frames_per_chunk: usize,
    /// The names of the frames' files, without folder and extension.
    pub frames: &'a [String],
    /// Origin of the coordinates of `poses` and `map`: world coordinates, metres.
    pub origin: DVec3,
    /// For each frame the camera's centre, relative to `origin`, and its rotation as a quaternion x, y, z, w, from camera to world: seven 32-bit
    /// floats, low byte first, in base64.
    pub poses: String,
    /// The cameras, in the order of their first frames.
    pub cameras: &'a [CameraData],
    /// Up in world coordinates, of length 1.
    pub up: Vec3,
    /// By increasing id.
    pub objects: Vec<ObjectData>,
    /// Missing if the method has no memory.
    pub map: Option<MapData>,
}

/// A camera's intrinsics.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct CameraData {
    /// The first frame that it took, by its place on the page.
    pub from: usize,
    /// What they are.
    #[serde(flatten)]
    pub intrinsics: Intrinsics,
}

/// An object. Frames are given by their place on the page.
#[derive(Debug, Serialize)]
pub struct ObjectData {
    /// Its id.
    pub id: SegmentId,
    /// The colour in which it is drawn, sRGB.
    pub color: [u8; 3],
    /// How many frames show it.
    pub frames: usize,
    /// First and last frame of each stretch of frames that show it.
    pub seen: Vec<(usize, usize)>,
    /// Its largest area in a frame, pixels.
    pub area: usize,
    /// The frame in which its area is largest.
    pub best: usize,
    /// The mean of its confidence over its frames, from 0 to 1; missing if no frame shows it.
    pub confidence: Option<f32>,
    /// What it is, if anyone has said so.
    pub label: Option<String>,
    /// What the memory makes of it; missing if the method has no memory.
    pub state: Option<ObjectState>,
    /// Gaussians that show it; missing if there are none.
    pub gaussians: Option<usize>,
    /// Mean of its surface, world, metres; missing if no Gaussian shows it.
    pub centroid: Option<DVec3>,
    /// The tightest box around it; missing if no Gaussian shows it.
    #[serde(rename = "box")]
    pub oriented_box: Option<OrientedBox>,
    /// The place of its picture in the folder of the run; missing if no frame shows it.
    pub crop: Option<String>,
}
