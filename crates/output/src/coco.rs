//! All masks of a run as one COCO file: <https://cocodataset.org/#format-data>, with the `track_id` and `video_id` of
//! video data sets.

use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
use serde::Serialize;
use splatseg_atomic_file::AtomicFile;
use splatseg_geometry::{RunLengths, SegmentId};
use splatseg_objects::BoundingBox;
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Ids count from 1, and there is one video and one category.
const ONLY: u32 = 1;

/// The COCO file. Annotations are written as frames come; the list of images, which is short, follows them.
#[derive(Debug)]
pub struct CocoFile {
    path: PathBuf,
    /// `None` after the run.
    file: Option<AtomicFile>,
    /// JSON texts.
    images: Vec<String>,
    annotations: usize,
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

    /// Starts a file that will be at `path` when the run has ended, in place of what is there. Its folder must exist.
    ///
    /// # Errors
    /// If no file can be created there.
    pub fn create(path: &Path) -> Result<Self, OutputError> {
        let start = || {
            let mut file = AtomicFile::create(path)?;
            let info = Info { description: "splatseg", version: env!("CARGO_PKG_VERSION") };
            let category = Category { id: ONLY, name: "object", supercategory: "object" };
            writeln!(file, "{{\"info\": {},", serde_json::to_string(&info)?)?;
            writeln!(file, "\"categories\": [{}],", serde_json::to_string(&category)?)?;
            write!(file, "\"annotations\": [")?;
            Ok(file)
        };
        let file = start().map_err(|source| OutputError::Io { path: path.to_owned(), source })?;
        Ok(Self { path: path.to_owned(), file: Some(file), images: Vec::new(), annotations: 0 })
    }

    fn add(&mut self, record: &FrameRecord) -> io::Result<()> {
        let Some(file) = &mut self.file else { return Ok(()) };
        let (width, height) = record.segments.size();
        let image = CocoImage {
            id: record.number + 1,
            file_name: format!("{}.jpg", record.file_name),
            width,
            height,
            video_id: ONLY,
            frame_index: record.number,
            name: record.frame.name(),
        };
        let scores: BTreeMap<SegmentId, f32> =
            record.objects.iter().map(|object| (object.id, object.confidence)).collect();
        for (id, runs) in RunLengths::of_segments(&record.segments) {
            self.annotations += 1;
            let (inner, area) = extent(&runs);
            let annotation = Annotation {
                id: self.annotations,
                image_id: image.id,
                video_id: ONLY,
                category_id: ONLY,
                track_id: id,
                segmentation: Segmentation { size: [height, width], counts: runs.to_compressed() },
                area,
                bbox: [inner.x, inner.y, inner.width, inner.height],
                iscrowd: 0,
                score: scores.get(&id).copied().unwrap_or(0.0),
            };
            let separator = if self.annotations == 1 { "" } else { "," };
            write!(file, "{separator}\n{}", serde_json::to_string(&annotation)?)?;
        }
        self.images.push(serde_json::to_string(&image)?);
        Ok(())
    }

    fn end(&mut self, scene: &str) -> io::Result<()> {
        let Some(mut file) = self.file.take() else { return Ok(()) };
        let video = serde_json::to_string(&Video { id: ONLY, name: scene })?;
        writeln!(file, "\n],\n\"videos\": [{video}],\n\"images\": [\n{}\n]}}", self.images.join(",\n"))?;
        file.commit()
    }

    fn error(&self, source: io::Error) -> OutputError {
        OutputError::Io { path: self.path.clone(), source }
    }
}

impl RunOutput for CocoFile {
    fn add_frame(&mut self, record: &FrameRecord, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.add(record).map_err(|source| self.error(source))
    }

    fn finish(&mut self, end: &RunEnd<'_>, _: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.end(end.scene).map_err(|source| self.error(source))
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
