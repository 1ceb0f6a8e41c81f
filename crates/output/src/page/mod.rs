//! `index.html`: a page to view a run's results, opened from disk in any browser.
//!
//! The page's sources are in `viewer/` of this crate; this module writes its data. A browser lets a page from disk load
//! scripts and images, but no other files, so all data are scripts:
//!
//! | file | contents |
//! | --- | --- |
//! | `index.html` | the page itself, the same for every run, but for what [`ComparedIds`] adds |
//! | `viewer/viewer.js` | its script, with three.js |
//! | `viewer/run.js` | cameras, objects, map and floor plan: [`data::RunData`] as JSON |
//! | `pictures/*.jpg` | the frames' pictures without overlay, at most 640 pixels wide |
//! | `viewer/frames-000.js` … | ids of the pixels ([`ids`]) of 64 frames each, loaded on demand |
//!
//! `viewer/viewer.min.js` has three.js and the sources in `viewer/src/`. It is committed, so that neither building nor
//! running splatseg needs npm; `tools/build_viewer.sh` bundles it, and `tools/build_viewer.sh --check` compares it with
//! its sources.

mod changes;
mod compared;
mod data;
mod ids;
mod map;
mod picture;
mod plan;
mod sightings;

pub use compared::ComparedIds;
pub use ids::encode_ids;
pub use map::{MapData, map_data};
pub use plan::PlanData;

use crate::crops::WaitingCrops;
use crate::error::saved_state;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput, UpdatedFrame, segment_color};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use changes::ChangesData;
use data::{CameraData, ObjectData, RunData};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use sightings::{Sightings, larger};
use splatseg_geometry::{Pose, RemappedId, SegmentId, UpEstimate};
use splatseg_objects::{Object, ObjectSighting};
use std::collections::BTreeMap;
use std::path::PathBuf;

const HTML: &str = include_str!("../../viewer/page.html");
const STYLE: &str = include_str!("../../viewer/page.css");
/// Script of the page of a run and of the page that watches one, with three.js.
pub const VIEWER_SCRIPT: &str = include_str!("../../viewer/viewer.min.js");
/// The elements that load the data and the script of a finished run.
const RUN_SCRIPTS: &str = "<script src=\"viewer/run.js\"></script>\n<script src=\"viewer/viewer.js\"></script>";

/// Numbers per pose: position, then rotation as a quaternion.
const POSE_NUMBERS: usize = 7;
/// Frames per file of ids, which then has a few hundred kilobytes.
const FRAMES_PER_CHUNK: usize = 64;

/// A page to view a run's results: the map in 3D, the video, and the list of objects.
///
/// It stores the name and pose of every frame, and the ids of up to 64 frames until they are written, so that memory
/// grows by some hundred bytes per frame.
#[derive(Debug, Default)]
pub struct Page {
    names: Vec<String>,
    /// Timestamps of the frames, seconds.
    stamps: Vec<Option<f64>>,
    /// [`POSE_NUMBERS`] per frame.
    poses: Vec<f64>,
    cameras: Vec<CameraData>,
    up: UpEstimate,
    objects: BTreeMap<SegmentId, Sightings>,
    /// Width, height and encoded ids of the frames not yet written.
    chunk: Vec<(usize, usize, String)>,
    chunks: usize,
    /// True if the folder may have the frames' pictures already.
    has_pictures: bool,
}

/// Saved state of a frame: its name, timestamp (seconds), pose and objects, and its camera if it is a new one.
#[derive(Serialize, Deserialize)]
struct SavedFrame {
    name: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    stamp: Option<f64>,
    pose: Vec<f64>,
    camera: Option<CameraData>,
    objects: Vec<ObjectSighting>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    remapped: Vec<RemappedId>,
}

/// Saved state that does not belong to single frames.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedPage {
    up: UpEstimate,
    chunk: Vec<(usize, usize, String)>,
    chunks: usize,
}

impl Page {
    /// Name of the page in the folder of results.
    pub const FILE: &'static str = "index.html";

    /// A page without frames.
    pub fn new() -> Self {
        Self::default()
    }

    /// A page without frames, of a run that has made one for the same frames before: their pictures stay as they are.
    pub fn again() -> Self {
        Self { has_pictures: true, ..Self::default() }
    }

    fn add_pose(&mut self, record: &FrameRecord) {
        let (frame, pose) = (self.names.len(), record.frame.world_from_camera());
        self.poses.extend(pose.translation().to_array());
        self.poses.extend(DQuat::from_mat3(&pose.rotation()).normalize().to_array());
        self.up.add(pose);
        let intrinsics = *record.frame.intrinsics();
        if self.cameras.last().is_none_or(|camera| camera.intrinsics != intrinsics) {
            self.cameras.push(CameraData { from: frame, intrinsics });
        }
    }

    /// Adds the objects of a frame, before which some ids turned out to be the same object.
    fn add_sightings(&mut self, frame: usize, sightings: &[ObjectSighting], remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped.iter().filter(|remapped| remapped.from != remapped.into) {
            if let Some(other) = self.objects.remove(from) {
                self.objects.entry(*into).or_default().merge(other);
            }
        }
        for sighting in sightings {
            let object = self.objects.entry(sighting.id).or_default();
            if sighting.is_new() {
                *object = Sightings::default();
            }
            object.add(frame, sighting);
        }
    }

    /// Writes the ids of the frames not yet written.
    fn write_chunk(&mut self, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        if self.chunk.is_empty() {
            return Ok(());
        }
        let file = format!("viewer/frames-{:03}.js", self.chunks);
        let text = format!("splatsegFrames({},{});\n", self.chunks, json(&file, &self.chunk)?);
        folder.write(&file, text.as_bytes())?;
        self.chunk.clear();
        self.chunks += 1;
        Ok(())
    }

    /// The final poses as 32-bit floats in base64, positions relative to an origin.
    fn encoded_poses(&self, origin: DVec3, corrections: &[Option<Pose>]) -> String {
        let relative = self.poses.as_chunks::<POSE_NUMBERS>().0.iter().enumerate().flat_map(|(frame, pose)| {
            let [x, y, z, turn @ ..] =
                corrections.get(frame).and_then(Option::as_ref).map_or(*pose, |motion| moved(pose, motion));
            let position = DVec3::new(x, y, z) - origin;
            position.to_array().into_iter().chain(turn)
        });
        STANDARD.encode(relative.flat_map(|number| (number as f32).to_le_bytes()).collect::<Vec<u8>>())
    }

    /// The page's data about an object.
    fn object(&self, object: &Object) -> ObjectData {
        let nothing = Sightings::default();
        let sightings = self.objects.get(&object.id).unwrap_or(&nothing);
        let (area, best) = sightings.largest;
        let frames = sightings.frames();
        let is_seen = frames > 0;
        ObjectData {
            id: object.id,
            color: segment_color(object.id),
            frames,
            seen: sightings.stretches.clone(),
            area,
            best,
            confidence: is_seen.then(|| sightings.mean_confidence()),
            label: object.label.clone(),
            state: object.state,
            gaussians: object.shape.as_ref().map(|shape| shape.points),
            centroid: object.shape.as_ref().map(|shape| shape.centroid),
            oriented_box: object.shape.as_ref().map(|shape| shape.oriented_box),
            crop: is_seen.then(|| WaitingCrops::file(object.id)),
        }
    }
}

/// Timestamp of a frame, seconds.
fn stamp(record: &FrameRecord) -> Option<f64> {
    record.frame.timestamp().map(|stamp| stamp.as_secs_f64())
}

/// A pose of [`POSE_NUMBERS`] after a motion: new world coordinates from old ones.
fn moved([x, y, z, turn @ ..]: &[f64; POSE_NUMBERS], motion: &Pose) -> [f64; POSE_NUMBERS] {
    let [x, y, z] = (motion.rotation() * DVec3::new(*x, *y, *z) + motion.translation()).to_array();
    let [a, b, c, d] = (DQuat::from_mat3(&motion.rotation()) * DQuat::from_array(*turn)).normalize().to_array();
    [x, y, z, a, b, c, d]
}

impl RunOutput for Page {
    fn name(&self) -> &'static str {
        "page"
    }

    fn add_frame(&mut self, record: &FrameRecord, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        let frame = self.names.len();
        self.add_pose(record);
        self.names.push(record.file_name.clone());
        self.stamps.push(stamp(record));
        let file = format!("pictures/{}.jpg", record.file_name);
        let path = folder.path_of(&file);
        if !(self.has_pictures && path.is_file()) {
            folder.write(&file, &picture::small_jpeg(&path, record.frame.color())?)?;
        }
        self.add_sightings(frame, &record.objects, &record.remapped);
        let small = ids::reduce_ids(&record.segments);
        self.chunk.push((small.width(), small.height(), STANDARD.encode(ids::encode_ids(&small))));
        if self.chunk.len() == FRAMES_PER_CHUNK { self.write_chunk(folder) } else { Ok(()) }
    }

    fn frame_state(&self, record: &FrameRecord) -> Result<Vec<u8>, OutputError> {
        let frame = self.names.len().saturating_sub(1);
        let pose = self.poses.get(POSE_NUMBERS * frame..).unwrap_or_default().to_vec();
        let camera = self.cameras.last().filter(|camera| camera.from == frame).copied();
        let (objects, remapped) = (record.objects.clone(), record.remapped.clone());
        let (name, stamp) = (record.file_name.clone(), stamp(record));
        let saved = SavedFrame { name, stamp, pose, camera, objects, remapped };
        saved_state("index.html", &saved)
    }

    fn save(&mut self, _: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError> {
        saved_state("index.html", &SavedPage { up: self.up, chunk: self.chunk.clone(), chunks: self.chunks })
    }

    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()> {
        let SavedPage { up, chunk, chunks } = serde_json::from_slice(saved)?;
        let mut page = Self { up, chunk, chunks, ..Self::default() };
        for (number, frame) in frames.iter().enumerate() {
            let SavedFrame { name, stamp, pose, camera, objects, remapped } = serde_json::from_str(frame)?;
            page.names.push(name);
            page.stamps.push(stamp);
            page.poses.extend(pose);
            page.cameras.extend(camera);
            page.add_sightings(number, &objects, &remapped);
        }
        *self = page;
        Ok(())
    }

    fn update_frame(&mut self, frame: &UpdatedFrame<'_>, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        let areas = frame.segments.areas();
        for id in frame.remapped {
            if let (Some(object), Some(area)) = (self.objects.get_mut(id), areas.get(id)) {
                object.largest = larger(object.largest, (*area, frame.position));
            }
        }
        Ok(())
    }

    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.write_chunk(folder)?;
        let origin = end.map.map_or(DVec3::ZERO, |map| map.origin);
        let data = RunData {
            version: env!("CARGO_PKG_VERSION"),
            scene: end.scene,
            frames_per_chunk: FRAMES_PER_CHUNK,
            frames: &self.names,
            stamps: &self.stamps,
            remapped: end
                .remaps
                .entries()
                .iter()
                .map(|(frame, RemappedId { from, into })| (*frame, *from, *into))
                .collect(),
            origin,
            poses: self.encoded_poses(origin, end.pose_corrections),
            cameras: &self.cameras,
            up: self.up.direction(),
            objects: end.objects.all().map(|object| self.object(object)).collect(),
            changes: end.changes.map(|changes| ChangesData::new(&changes, origin)),
            map: end.map.map(|map| map::map_data(&map, origin, |_| true)),
            plan: end.plan.map(|plan| PlanData::new(plan, origin)),
        };
        let file = "viewer/run.js";
        folder.write(file, format!("var splatsegRun={};\n", json(file, &data)?).as_bytes())?;
        folder.write("viewer/viewer.js", VIEWER_SCRIPT.as_bytes())?;
        // Written last, so that an existing page has everything it needs.
        folder.write(Self::FILE, HTML.replace("{{style}}", STYLE).as_bytes())
    }
}

/// Returns the page for watching a run while it goes on: without data, it gets them from its server. `script` is the URL
/// of [`VIEWER_SCRIPT`], in characters that need no escape in HTML.
pub fn live_page(script: &str) -> String {
    HTML.replace(RUN_SCRIPTS, &format!("<script src=\"{script}\"></script>")).replace("{{style}}", STYLE)
}

/// A value as JSON, which is JavaScript; `file` is named in errors.
fn json(file: &str, value: &impl Serialize) -> Result<String, OutputError> {
    serde_json::to_string(value).map_err(|error| OutputError::Io { path: PathBuf::from(file), source: error.into() })
}
