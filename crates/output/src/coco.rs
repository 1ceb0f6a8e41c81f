//! All masks of a run as one COCO file: <https://cocodataset.org/#format-data>, with the `track_id` and `video_id` of
//! video data sets.

use crate::error::saved_state;
use crate::run_output::written_ids;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
use serde::{Deserialize, Serialize};
use splatseg_annotations::{CocoImage, CocoLabel, CocoWriter};
use splatseg_files::AtomicFile;
use splatseg_geometry::SegmentId;
use splatseg_objects::Object;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The COCO file. It is written at the end, from the id images in the folder, so that little is stored per frame.
#[derive(Debug)]
pub struct CocoFile {
    path: PathBuf,
    frames: Vec<CocoFrame>,
}

/// Data stored per frame.
#[derive(Debug, Serialize, Deserialize)]
struct CocoFrame {
    /// The frame's name in its scene.
    name: String,
    /// Name of the frame's result files, without folder and extension.
    file_name: String,
    /// Area, pixels, and confidence of each object.
    objects: BTreeMap<SegmentId, (usize, f32)>,
}

impl CocoFrame {
    /// The confidence of each object after ids changed as `final_ids` says: the mean over its pixels.
    fn scores(&self, final_ids: &BTreeMap<SegmentId, SegmentId>) -> BTreeMap<SegmentId, f32> {
        if final_ids.is_empty() {
            return self.objects.iter().map(|(id, (_, score))| (*id, *score)).collect();
        }
        let mut parts: BTreeMap<SegmentId, Vec<(usize, f32)>> = BTreeMap::new();
        for (id, part) in &self.objects {
            parts.entry(*final_ids.get(id).unwrap_or(id)).or_default().push(*part);
        }
        let mean = |parts: &[(usize, f32)]| match parts {
            [(_, score)] => *score,
            parts => {
                let area: usize = parts.iter().map(|(area, _)| area).sum();
                let sum: f64 = parts.iter().map(|(area, score)| *area as f64 * f64::from(*score)).sum();
                (sum / area.max(1) as f64) as f32
            }
        };
        parts.into_iter().map(|(id, parts)| (id, mean(&parts))).collect()
    }
}

impl CocoFile {
    /// The first bytes of every file written here.
    pub const START: &'static str = "{\"info\": {\"description\":\"splatseg\"";

    /// A file to be written to `path` at the end of the run, replacing any existing file. Its folder must exist.
    pub fn new(path: PathBuf) -> Self {
        Self { path, frames: Vec::new() }
    }

    fn write(&self, end: &RunEnd<'_>, folder: &dyn ResultFolder) -> Result<(), OutputError> {
        let error = |source| OutputError::Io { path: self.path.clone(), source };
        let file = AtomicFile::create(&self.path).map_err(error)?;
        let mut file = CocoWriter::start(file, ("splatseg", env!("CARGO_PKG_VERSION")), &labels(end)).map_err(error)?;
        for (position, frame) in self.frames.iter().enumerate() {
            let segments = written_ids(folder, &frame.file_name)?;
            let scores = frame.scores(&end.remaps.final_ids(position));
            let image =
                CocoImage { file_name: &format!("{}.jpg", frame.file_name), name: &frame.name, scores: &scores };
            file.frame(&image, &segments).map_err(error)?;
        }
        file.finish(end.scene).and_then(AtomicFile::commit).map_err(error)
    }
}

/// The label of each object that has one.
fn labels(end: &RunEnd<'_>) -> BTreeMap<SegmentId, CocoLabel> {
    let label =
        |object: &Object| Some((object.id, CocoLabel { name: object.label.clone()?, score: object.label_score }));
    end.objects.objects.iter().filter_map(label).collect()
}

impl RunOutput for CocoFile {
    fn name(&self) -> &'static str {
        "coco"
    }

    fn add_frame(&mut self, record: &FrameRecord, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.frames.push(CocoFrame {
            name: record.frame.name().to_owned(),
            file_name: record.file_name.clone(),
            objects: record.objects.iter().map(|object| (object.id, (object.area, object.confidence))).collect(),
        });
        Ok(())
    }

    fn frame_state(&self, _: &FrameRecord) -> Result<Vec<u8>, OutputError> {
        saved_state("COCO file", &self.frames.last())
    }

    fn save(&mut self, _: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError> {
        saved_state("COCO file", &())
    }

    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()> {
        let () = serde_json::from_slice(saved)?;
        self.frames = frames.iter().map(|frame| serde_json::from_str(frame)).collect::<serde_json::Result<_>>()?;
        Ok(())
    }

    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.write(end, folder)
    }
}
