//! Writes all masks of a run as one COCO file, with the `track_id` and `video_id` of video data sets.

use super::segmentation::Segmentation;
use serde::Serialize;
use splatseg_geometry::{RunLengths, SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Result, Write};

/// Ids count from 1, and there is one video.
const ONLY: u32 = 1;
/// The category of objects without a label. Labels have those after it.
const OBJECT: u32 = 1;

/// The header of the file.
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

/// The label of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct CocoLabel {
    /// Name of its category.
    pub name: String,
    /// How clearly that fits, 0 to 1, if it is known.
    pub score: Option<f32>,
}

#[derive(Serialize)]
struct Video<'a> {
    id: u32,
    name: &'a str,
}

/// A frame.
#[derive(Clone, Copy, Debug)]
pub struct CocoImage<'a> {
    /// Name of the frame's image.
    pub file_name: &'a str,
    /// The frame's name in its scene.
    pub name: &'a str,
    /// Confidence of each segment; 0 for those that are not listed.
    pub scores: &'a BTreeMap<SegmentId, f32>,
}

/// A frame as it is written.
#[derive(Serialize)]
struct Image<'a> {
    id: usize,
    file_name: &'a str,
    width: usize,
    height: usize,
    video_id: u32,
    /// Position in the run, from 0.
    frame_index: usize,
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
    #[serde(skip_serializing_if = "Option::is_none")]
    category_score: Option<f32>,
}

/// Writes a COCO file, frame by frame.
#[derive(Debug)]
pub struct CocoWriter<W> {
    file: W,
    annotations: usize,
    /// Category of each object that has a label, and how clearly it fits.
    categories: BTreeMap<SegmentId, (u32, Option<f32>)>,
    /// The frames so far, as JSON.
    images: Vec<String>,
}

impl<W: Write> CocoWriter<W> {
    /// Writes the start of the file. `program` and `version` are stored in its header. Each label is a category, in
    /// alphabetical order; objects without one are of the first category, `object`.
    ///
    /// # Errors
    /// If the file cannot be written, here and below.
    pub fn start(
        mut file: W,
        (program, version): (&str, &str),
        labels: &BTreeMap<SegmentId, CocoLabel>,
    ) -> Result<Self> {
        let info = Info { description: program, version };
        let names: BTreeSet<&str> = labels.values().map(|label| label.name.as_str()).collect();
        let numbers: BTreeMap<&str, u32> = names.into_iter().zip(OBJECT + 1..).collect();
        let all = std::iter::once((&"object", &OBJECT)).chain(&numbers);
        let all: Vec<Category<'_>> =
            all.map(|(name, id)| Category { id: *id, name, supercategory: "object" }).collect();
        writeln!(file, "{{\"info\": {},", serde_json::to_string(&info)?)?;
        writeln!(file, "\"categories\": {},", serde_json::to_string(&all)?)?;
        write!(file, "\"annotations\": [")?;
        let number = |label: &CocoLabel| numbers.get(label.name.as_str()).copied().unwrap_or(OBJECT);
        let categories = labels.iter().map(|(id, label)| (*id, (number(label), label.score))).collect();
        Ok(Self { file, annotations: 0, categories, images: Vec::new() })
    }

    /// Writes the masks of the next frame.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn frame(&mut self, image: &CocoImage<'_>, segments: &SegmentMap) -> Result<()> {
        let (frame_index, (width, height)) = (self.images.len(), segments.size());
        for (id, runs) in RunLengths::of_segments(segments) {
            self.annotations += 1;
            let (bbox, area) = extent(&runs);
            let (category_id, category_score) = self.categories.get(&id).copied().unwrap_or((OBJECT, None));
            let annotation = Annotation {
                id: self.annotations,
                image_id: frame_index + 1,
                video_id: ONLY,
                category_id,
                track_id: id,
                segmentation: Segmentation::compressed(&runs),
                area,
                bbox,
                iscrowd: 0,
                score: image.scores.get(&id).copied().unwrap_or(0.0),
                category_score,
            };
            let separator = if self.annotations == 1 { "" } else { "," };
            write!(self.file, "{separator}\n{}", serde_json::to_string(&annotation)?)?;
        }
        let CocoImage { file_name, name, .. } = *image;
        let image = Image { id: frame_index + 1, file_name, width, height, video_id: ONLY, frame_index, name };
        self.images.push(serde_json::to_string(&image)?);
        Ok(())
    }

    /// Writes the end of the file, with the name of the video. Returns the file.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn finish(mut self, video: &str) -> Result<W> {
        let video = serde_json::to_string(&Video { id: ONLY, name: video })?;
        writeln!(self.file, "\n],\n\"videos\": [{video}],\n\"images\": [\n{}\n]}}", self.images.join(",\n"))?;
        Ok(self.file)
    }
}

/// The bounding box of a non-empty mask, `[x, y, width, height]`, and its area.
fn extent(runs: &RunLengths) -> ([usize; 4], usize) {
    let height = runs.height;
    let (mut columns, mut rows, mut area) = ((usize::MAX, 0), (usize::MAX, 0), 0);
    let mut start = 0;
    for (index, count) in runs.counts.iter().enumerate() {
        let count = *count as usize;
        if index % 2 == 1 && count > 0 {
            let end = start + count - 1;
            columns = (columns.0.min(start / height), columns.1.max(end / height));
            // A run that continues in the next column touches the bottom and the top.
            let spans_columns = start / height < end / height;
            let (first, last) = if spans_columns { (0, height - 1) } else { (start % height, end % height) };
            rows = (rows.0.min(first), rows.1.max(last));
            area += count;
        }
        start += count;
    }
    let size = |(first, last): (usize, usize)| (last + 1).saturating_sub(first);
    ([columns.0, rows.0, size(columns), size(rows)], area)
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Mask};

    #[test]
    fn each_label_is_a_category() {
        let label = |name: &str, score| CocoLabel { name: name.to_owned(), score };
        let labels = BTreeMap::from([(3, label("mug", Some(0.5))), (4, label("chair", None)), (5, label("mug", None))]);
        let mut writer = CocoWriter::start(Vec::new(), ("program", "1"), &labels).unwrap();
        let image = CocoImage { file_name: "0.jpg", name: "0", scores: &BTreeMap::new() };
        writer.frame(&image, &Image::from_fn(4, 1, |column, _| column as u32 + 2)).unwrap();
        let file: serde_json::Value = serde_json::from_slice(&writer.finish("video").unwrap()).unwrap();
        let categories = file["categories"].as_array().unwrap().iter();
        let categories: Vec<_> = categories.map(|category| (category["id"].as_u64(), &category["name"])).collect();
        let [object, chair, mug] = ["object", "chair", "mug"].map(serde_json::Value::from);
        assert_eq!(categories, [(Some(1), &object), (Some(2), &chair), (Some(3), &mug)]);
        let of = |track: u64| {
            let annotations = file["annotations"].as_array().unwrap();
            let found = annotations.iter().find(|annotation| annotation["track_id"] == track).unwrap();
            (found["category_id"].as_u64().unwrap(), found["category_score"].as_f64())
        };
        assert_eq!([2, 3, 4, 5].map(of), [(1, None), (3, Some(0.5)), (2, None), (3, None)]);
    }

    #[test]
    fn extents_are_those_of_the_pixels() {
        let extent_of = |inside: fn(usize, usize) -> bool| extent(&RunLengths::encode(&Mask::from_fn(6, 5, inside)));
        let found = |x, y, width, height, area| ([x, y, width, height], area);
        assert_eq!(extent_of(|x, y| (2..4).contains(&x) && (1..4).contains(&y)), found(2, 1, 2, 3, 6));
        // The last pixel of one column and the first of the next are one run.
        assert_eq!(extent_of(|x, y| (x, y) == (1, 4) || (x, y) == (2, 0)), found(1, 0, 2, 5, 2));
        assert_eq!(extent_of(|_, _| true), found(0, 0, 6, 5, 30));
    }
}
