//! `index.html`: a page to look at a run's result, opened from disk in any browser.
//!
//! The page is in `viewer/` of this crate; here is what it shows. A browser lets a page from disk load scripts and
//! images, but no other files. So all data are scripts:
//!
//! | file | what it is |
//! | --- | --- |
//! | `index.html` | the page itself, the same for every run |
//! | `viewer/viewer.js` | its script, with three.js |
//! | `viewer/run.js` | cameras, objects and map: [`data::RunData`] as JSON |
//! | `viewer/frames-000.js` … | ids of the pixels ([`ids`]) of 64 frames each, loaded when they are needed |

mod data;
mod ids;
mod map;
mod up;

use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput, segment_color};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use data::{CameraData, ObjectData, RunData};
use glam::Quat;
use serde::Serialize;
use splatseg_geometry::SegmentId;
use splatseg_memory::SplatMemory;
use splatseg_objects::ObjectSighting;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use up::UpEstimate;

const HTML: &str = include_str!("../../viewer/page.html");
const STYLE: &str = include_str!("../../viewer/page.css");
const SCRIPT: &str = include_str!("../../viewer/viewer.min.js");

/// Ids of so many frames are in one file, a few hundred kilobytes.
const FRAMES_PER_CHUNK: usize = 64;

/// A page to look at the run's result: the map in 3D, the video, and the list of objects.
///
/// Of each frame it keeps the name, the pose and the ids until 64 frames are together, so that memory grows by some
/// hundred bytes per frame.
#[derive(Debug, Default)]
pub struct Page {
    names: Vec<String>,
    /// Seven numbers per frame.
    poses: Vec<f32>,
    cameras: Vec<CameraData>,
    up: UpEstimate,
    objects: BTreeMap<SegmentId, Sightings>,
    /// Width, height and ids of the frames that no file has yet.
    chunk: Vec<(usize, usize, String)>,
    chunks: usize,
}

/// Where an object was seen.
#[derive(Debug, Default)]
struct Sightings {
    frames: usize,
    /// First and last frame of each stretch.
    stretches: Vec<(usize, usize)>,
    /// The largest area, pixels, and its frame.
    largest: (usize, usize),
    /// Sum over the frames.
    confidence: f64,
}

impl Page {
    /// A page without frames.
    pub fn new() -> Self {
        Self::default()
    }

    fn add_pose(&mut self, record: &FrameRecord) {
        let (frame, pose) = (self.names.len(), record.frame.world_from_camera());
        self.poses.extend(pose.translation().to_array());
        self.poses.extend(Quat::from_mat3(&pose.rotation()).normalize().to_array());
        self.up.add(pose);
        let intrinsics = *record.frame.intrinsics();
        if self.cameras.last().is_none_or(|camera| camera.intrinsics != intrinsics) {
            self.cameras.push(CameraData { from: frame, intrinsics });
        }
    }

    /// Writes the ids of the frames that no file has yet.
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

    /// All objects: those that frames have shown, and those that are only in the map, because an earlier run saw them.
    fn objects(&self, memory: Option<&SplatMemory>, in_map: &BTreeMap<SegmentId, usize>) -> Vec<ObjectData> {
        let nothing = Sightings::default();
        let ids: BTreeSet<SegmentId> = self.objects.keys().chain(in_map.keys()).copied().collect();
        let object = |id: SegmentId| {
            let sightings = self.objects.get(&id).unwrap_or(&nothing);
            let (area, best) = sightings.largest;
            ObjectData {
                id,
                color: segment_color(id),
                frames: sightings.frames,
                seen: sightings.stretches.clone(),
                area,
                best,
                confidence: (sightings.frames > 0).then(|| (sightings.confidence / sightings.frames as f64) as f32),
                state: memory.map(|memory| if memory.is_tentative(id) { "tentative" } else { "remembered" }),
                gaussians: memory.map(|_| in_map.get(&id).copied().unwrap_or(0)),
            }
        };
        ids.into_iter().map(object).collect()
    }
}

impl Sightings {
    fn add(&mut self, frame: usize, sighting: &ObjectSighting) {
        self.frames += 1;
        self.confidence += f64::from(sighting.confidence);
        if sighting.area > self.largest.0 {
            self.largest = (sighting.area, frame);
        }
        match self.stretches.last_mut() {
            Some((_, last)) if *last + 1 == frame => *last = frame,
            _ => self.stretches.push((frame, frame)),
        }
    }
}

impl RunOutput for Page {
    fn add_frame(&mut self, record: &FrameRecord, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        let frame = self.names.len();
        self.add_pose(record);
        self.names.push(record.file_name.clone());
        for sighting in &record.objects {
            self.objects.entry(sighting.id).or_default().add(frame, sighting);
        }
        let small = ids::reduced(&record.segments);
        self.chunk.push((small.width(), small.height(), STANDARD.encode(ids::encoded(&small))));
        if self.chunk.len() == FRAMES_PER_CHUNK { self.write_chunk(folder) } else { Ok(()) }
    }

    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.write_chunk(folder)?;
        let (map, in_map) = end.memory.map(map::map_data).unzip();
        let data = RunData {
            version: env!("CARGO_PKG_VERSION"),
            scene: end.scene,
            frames_per_chunk: FRAMES_PER_CHUNK,
            frames: &self.names,
            poses: STANDARD.encode(self.poses.iter().flat_map(|number| number.to_le_bytes()).collect::<Vec<u8>>()),
            cameras: &self.cameras,
            up: self.up.direction(),
            objects: self.objects(end.memory, &in_map.unwrap_or_default()),
            map,
        };
        let file = "viewer/run.js";
        folder.write(file, format!("var splatsegRun={};\n", json(file, &data)?).as_bytes())?;
        folder.write("viewer/viewer.js", SCRIPT.as_bytes())?;
        // Last: where there is a page, everything that it needs is there.
        folder.write("index.html", HTML.replace("{{style}}", STYLE).as_bytes())
    }
}

/// A value for a script of this name. JSON is JavaScript.
fn json(file: &str, value: &impl Serialize) -> Result<String, OutputError> {
    serde_json::to_string(value).map_err(|error| OutputError::Io { path: PathBuf::from(file), source: error.into() })
}
