//! All masks of a run as one COCO file: <https://cocodataset.org/#format-data>, with the `track_id` and `video_id` of
//! video data sets.

use crate::error::saved_state;
use crate::segments::written_ids;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
use serde::{Deserialize, Serialize};
use splatseg_atomic_file::AtomicFile;
use splatseg_geometry::{RunLengths, SegmentId, SegmentMap};
use splatseg_objects::BoundingBox;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::PathBuf;

/// Ids count from 1, and there is one video and one category.
const ONLY: u32 = 1;

/// The COCO file. It is written at the end, from the id images in the folder, so that little is kept of each frame.
#[derive(Debug)]
pub struct CocoFile {
    path: PathBuf,
    frames: Vec<CocoFrame>,
}

/// What is kept of a frame.
#[derive(Debug, Serialize, Deserialize)]
struct CocoFrame {
    /// Its name in its scene.
    name: String,
    /// The name of its result files.
    file_name: String,
    /// The confidence of each object.
    scores: BTreeMap<SegmentId, f32>,
}

/// What the file is.
#[derive(Serialize)]
struct Info<'a> {
    description: &'a str,
    version: &'a str,
}

#[derive(Serialize)]
struct Category<'a> {
    id: u32,
    name: &'a str,
    supercategory: &'a str,
}

#[derive(Serialize)]
struct Video<'a> {
    id: u32,
    name: &'a str,
}

/// A frame.
#[derive(Serialize)]
struct CocoImage<'a> {
    id: usize,
    file_name: String,
    width: usize,
    height: usize,
    video_id: u32,
    /// Position in the run, from 0.
    frame_index: usize,
    /// The frame's name in its scene.
    name: &'a str,
}

/// The mask of an object in a frame.
#[derive(Serialize)]
struct Annotation {
    id: usize,
    image_id: usize,
    video_id: u32,
    category_id: u32,
    track_id: SegmentId,
    segmentation: Segmentation,
    area: usize,
    bbox: [usize; 4],
    iscrowd: u32,
    score: f32,
}

/// A compressed RLE.
#[derive(Serialize)]
struct Segmentation {
    size: [usize; 2],
    counts: String,
}

impl CocoFile {
    /// How every file starts that this writes.
    pub const START: &'static str = "{\"info\": {\"description\":\"splatseg\"";

    /// A file that will be at `path` when the run has ended, in place of what is there. Its folder must exist.
    pub fn new(path: PathBuf) -> Self {
        Self { path, frames: Vec::new() }
    }

    fn write(&self, scene: &str, folder: &dyn ResultFolder) -> Result<(), OutputError> {
        let error = |source| OutputError::Io { path: self.path.clone(), source };
        let mut file = AtomicFile::create(&self.path).map_err(error)?;
        write_start(&mut file).map_err(error)?;
        let (mut images, mut annotations) = (Vec::new(), 0);
        for (number, frame) in self.frames.iter().enumerate() {
            let segments = written_ids(folder, &frame.file_name)?;
            annotations = write_annotations(&mut file, number, frame, &segments, annotations).map_err(error)?;
            images.push(frame.image(number, segments.size()).map_err(error)?);
        }
        write_end(&mut file, scene, &images).and_then(|()| file.commit()).map_err(error)
    }
}

impl CocoFrame {
    /// The JSON text of its image.
    fn image(&self, number: usize, (width, height): (usize, usize)) -> io::Result<String> {
        let file_name = format!("{}.jpg", self.file_name);
        let (id, video_id, frame_index, name) = (number + 1, ONLY, number, self.name.as_str());
        Ok(serde_json::to_string(&CocoImage { id, file_name, width, height, video_id, frame_index, name })?)
    }
}

fn write_start(file: &mut impl Write) -> io::Result<()> {
    let info = Info { description: "splatseg", version: env!("CARGO_PKG_VERSION") };
    let category = Category { id: ONLY, name: "object", supercategory: "object" };
    writeln!(file, "{{\"info\": {},", serde_json::to_string(&info)?)?;
    writeln!(file, "\"categories\": [{}],", serde_json::to_string(&category)?)?;
    write!(file, "\"annotations\": [")
}

/// Writes the masks of a frame after `annotations` others; returns how many there are then.
fn write_annotations(
    file: &mut impl Write,
    number: usize,
    frame: &CocoFrame,
    segments: &SegmentMap,
    mut annotations: usize,
) -> io::Result<usize> {
    let (width, height) = segments.size();
    for (id, runs) in RunLengths::of_segments(segments) {
        annotations += 1;
        let (inner, area) = extent(&runs);
        let annotation = Annotation {
            id: annotations,
            image_id: number + 1,
            video_id: ONLY,
            category_id: ONLY,
            track_id: id,
            segmentation: Segmentation { size: [height, width], counts: runs.to_compressed() },
            area,
            bbox: [inner.x, inner.y, inner.width, inner.height],
            iscrowd: 0,
            score: frame.scores.get(&id).copied().unwrap_or(0.0),
        };
        let separator = if annotations == 1 { "" } else { "," };
        write!(file, "{separator}\n{}", serde_json::to_string(&annotation)?)?;
    }
    Ok(annotations)
}

fn write_end(file: &mut impl Write, scene: &str, images: &[String]) -> io::Result<()> {
    let video = serde_json::to_string(&Video { id: ONLY, name: scene })?;
    writeln!(file, "\n],\n\"videos\": [{video}],\n\"images\": [\n{}\n]}}", images.join(",\n"))
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

/// The smallest box around a mask that is not empty, and its area.
fn extent(runs: &RunLengths) -> (BoundingBox, usize) {
    let height = runs.height;
    let (mut columns, mut rows, mut area) = ((usize::MAX, 0), (usize::MAX, 0), 0);
    let mut start = 0;
    for (index, count) in runs.counts.iter().enumerate() {
        let count = *count as usize;
        if index % 2 == 1 && count > 0 {
            let end = start + count - 1;
            columns = (columns.0.min(start / height), columns.1.max(end / height));
            // A run that goes on in the next column touches the bottom and the top.
            let goes_on = start / height < end / height;
            let (first, last) = if goes_on { (0, height - 1) } else { (start % height, end % height) };
            rows = (rows.0.min(first), rows.1.max(last));
            area += count;
        }
        start += count;
    }
    let size = |(first, last): (usize, usize)| (last + 1).saturating_sub(first);
    (BoundingBox { x: columns.0, y: rows.0, width: size(columns), height: size(rows) }, area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Mask;

    #[test]
    fn extents_are_those_of_the_pixels() {
        let extent_of = |inside: fn(usize, usize) -> bool| extent(&RunLengths::encode(&Mask::from_fn(6, 5, inside)));
        let found = |x, y, width, height, area| (BoundingBox { x, y, width, height }, area);
        assert_eq!(extent_of(|x, y| (2..4).contains(&x) && (1..4).contains(&y)), found(2, 1, 2, 3, 6));
        // The last pixel of one column and the first of the next are one run.
        assert_eq!(extent_of(|x, y| (x, y) == (1, 4) || (x, y) == (2, 0)), found(1, 0, 2, 5, 2));
        assert_eq!(extent_of(|_, _| true), found(0, 0, 6, 5, 30));
    }
}
