//! All masks of a run as one COCO file: <https://cocodataset.org/#format-data>, with the `track_id` and `video_id` of
//! video data sets.

use crate::error::saved_state;
use crate::run_output::written_ids;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
use serde::{Deserialize, Serialize};
use splatseg_annotations::{CocoImage, CocoWriter};
use splatseg_files::AtomicFile;
use splatseg_geometry::SegmentId;
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
    /// Confidence of each object.
    scores: BTreeMap<SegmentId, f32>,
}

impl CocoFile {
    /// The first bytes of every file written here.
    pub const START: &'static str = "{\"info\": {\"description\":\"splatseg\"";

    /// A file to be written to `path` at the end of the run, replacing any existing file. Its folder must exist.
    pub fn new(path: PathBuf) -> Self {
        Self { path, frames: Vec::new() }
    }

    fn write(&self, scene: &str, folder: &dyn ResultFolder) -> Result<(), OutputError> {
        let error = |source| OutputError::Io { path: self.path.clone(), source };
        let file = AtomicFile::create(&self.path).map_err(error)?;
        let mut file = CocoWriter::start(file, "splatseg", env!("CARGO_PKG_VERSION")).map_err(error)?;
        for frame in &self.frames {
            let segments = written_ids(folder, &frame.file_name)?;
            let image =
                CocoImage { file_name: &format!("{}.jpg", frame.file_name), name: &frame.name, scores: &frame.scores };
            file.frame(&image, &segments).map_err(error)?;
        }
        file.finish(scene).and_then(AtomicFile::commit).map_err(error)
    }
}

impl RunOutput for CocoFile {
    fn name(&self) -> &'static str {
        "coco"
    }

    fn add_frame(&mut self, record: &FrameRecord, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.frames.push(CocoFrame {
            name: record.frame.name().to_owned(),
            file_name: record.file_name.clone(),
            scores: record.objects.iter().map(|object| (object.id, object.confidence)).collect(),
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
        self.write(end.scene, folder)
    }
}
