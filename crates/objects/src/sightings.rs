//! The objects of a frame, and a log of all objects so far.

use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, RemappedId, SegmentId};
use splatseg_tracking::FrameOutput;
use std::collections::BTreeMap;

/// An object in one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ObjectSighting {
    /// Its id, the same in every frame.
    pub id: SegmentId,
    /// Number of pixels that show it.
    pub area: usize,
    /// The smallest box around these pixels.
    pub bounding_box: BoundingBox,
    /// Confidence of the id, from 0 to 1: the mean of [`FrameOutput::confidence`] over these pixels.
    pub confidence: f32,
    /// The first frame that showed it. 0 is the first frame that the pipeline processed.
    pub first_frame: usize,
    /// The last frame that showed it: this one.
    pub last_frame: usize,
}

impl ObjectSighting {
    /// True if no earlier frame showed the object. If an earlier frame showed another object with the same id, the id
    /// was reassigned to this object.
    pub fn is_new(&self) -> bool {
        self.first_frame == self.last_frame
    }
}

/// A bounding box as in COCO: top left corner and size, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BoundingBox {
    /// First column, from 0.
    pub x: usize,
    /// First row, from 0.
    pub y: usize,
    /// Number of columns.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
}

/// An object over all frames so far.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct ObjectRecord {
    /// The first frame that showed it.
    pub first_frame: usize,
    /// The last frame that showed it.
    pub last_frame: usize,
    /// Number of frames that showed it.
    pub frames: usize,
}

/// The log keeps the records of at least this many objects. Beyond twice as many, only the most recently seen stay.
const KEPT_RECORDS: usize = 1 << 16;

/// Every object seen so far. With more than 65,536 objects, the ones unseen longest may be missing, so that memory
/// stays bounded for endless streams.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObjectLog {
    frames: usize,
    records: BTreeMap<SegmentId, ObjectRecord>,
}

impl ObjectLog {
    /// Number of frames so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// All objects, by id.
    pub fn records(&self) -> &BTreeMap<SegmentId, ObjectRecord> {
        &self.records
    }

    /// Records the next frame from the sightings of an earlier run that this one resumes.
    pub fn repeat(&mut self, sightings: &[ObjectSighting]) {
        let frame = self.frames;
        self.frames += 1;
        for sighting in sightings {
            if sighting.is_new() {
                self.records.remove(&sighting.id);
            }
            self.add(sighting.id, frame);
        }
        self.drop_longest_unseen();
    }

    /// Forgets an object: its id stands for another one from the next frame on.
    pub fn forget(&mut self, id: SegmentId) {
        self.records.remove(&id);
    }

    /// Adds the records of ids that turned out to be other ids' objects to those. Frames that showed both count twice.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped {
            let Some(record) = self.records.remove(from) else { continue };
            let kept = self.records.entry(*into).or_insert(ObjectRecord { frames: 0, ..record });
            kept.first_frame = kept.first_frame.min(record.first_frame);
            kept.last_frame = kept.last_frame.max(record.last_frame);
            kept.frames += record.frames;
        }
    }

    /// Drops the records of the objects unseen longest if there are too many. Depends only on the sightings so far.
    fn drop_longest_unseen(&mut self) {
        if self.records.len() <= 2 * KEPT_RECORDS {
            return;
        }
        let mut order: Vec<(usize, SegmentId)> =
            self.records.iter().map(|(id, record)| (record.last_frame, *id)).collect();
        order.sort_unstable();
        for (_, id) in order.iter().take(order.len() - KEPT_RECORDS) {
            self.records.remove(id);
        }
    }

    /// Records that a frame shows an object.
    fn add(&mut self, id: SegmentId, frame: usize) -> ObjectRecord {
        let new = ObjectRecord { first_frame: frame, last_frame: frame, frames: 0 };
        let record = self.records.entry(id).or_insert(new);
        record.last_frame = frame;
        record.frames += 1;
        *record
    }

    /// Records the next frame; returns its objects by increasing id.
    pub fn record(&mut self, output: &FrameOutput) -> Vec<ObjectSighting> {
        let frame = self.frames;
        self.frames += 1;
        for id in &output.update.new_segments {
            self.records.remove(id);
        }
        let extents = extents(output);
        let sightings: Vec<ObjectSighting> = extents
            .into_iter()
            .map(|(id, extent)| {
                let record = self.add(id, frame);
                ObjectSighting {
                    id,
                    area: extent.area,
                    bounding_box: extent.bounding_box(),
                    confidence: (extent.confidence / extent.area as f64) as f32,
                    first_frame: record.first_frame,
                    last_frame: frame,
                }
            })
            .collect();
        self.drop_longest_unseen();
        sightings
    }
}

/// Area, confidence and bounds of the pixels of an object added so far.
#[derive(Clone, Copy, Debug)]
struct Extent {
    area: usize,
    confidence: f64,
    columns: (usize, usize),
    rows: (usize, usize),
}

impl Extent {
    const NOTHING: Self = Self { area: 0, confidence: 0.0, columns: (usize::MAX, 0), rows: (usize::MAX, 0) };

    /// Adds pixels of a row, side by side from `column` on, with their confidences.
    fn add(&mut self, column: usize, row: usize, confidences: &[f32]) {
        self.area += confidences.len();
        self.confidence = confidences.iter().fold(self.confidence, |sum, confidence| sum + f64::from(*confidence));
        self.columns = (self.columns.0.min(column), self.columns.1.max(column + confidences.len() - 1));
        self.rows = (self.rows.0.min(row), self.rows.1.max(row));
    }

    fn bounding_box(&self) -> BoundingBox {
        BoundingBox {
            x: self.columns.0,
            y: self.rows.0,
            width: self.columns.1 + 1 - self.columns.0,
            height: self.rows.1 + 1 - self.rows.0,
        }
    }
}

/// The objects of a frame: its masks if they may overlap, otherwise the pixels of each id.
fn extents(output: &FrameOutput) -> BTreeMap<SegmentId, Extent> {
    let mut extents: BTreeMap<SegmentId, Extent> = BTreeMap::new();
    let (width, confidence) = (output.segments.width(), output.confidence.pixels());
    if output.masks.is_empty() {
        // Neighbouring pixels mostly show one object, so it is looked up once per run of pixels.
        for (row, ids) in output.segments.pixels().chunks_exact(width.max(1)).enumerate() {
            let mut column = 0;
            for run in ids.chunk_by(|a, b| a == b) {
                if run[0] != 0 {
                    let first = row * width + column;
                    let extent = extents.entry(run[0]).or_insert(Extent::NOTHING);
                    extent.add(column, row, &confidence[first..first + run.len()]);
                }
                column += run.len();
            }
        }
        return extents;
    }
    for (id, mask) in &output.masks {
        let extent = extents.entry(*id).or_insert(Extent::NOTHING);
        pixels(mask).for_each(|(column, row)| extent.add(column, row, &confidence[row * width + column..][..1]));
    }
    extents.retain(|_, extent| extent.area > 0);
    extents
}

fn pixels(mask: &Mask) -> impl Iterator<Item = (usize, usize)> + '_ {
    mask.pixel_indices().map(|index| (index % mask.width(), index / mask.width()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::SegmentMap;

    fn output(ids: [u32; 8]) -> FrameOutput {
        FrameOutput::from_segments(SegmentMap::from_pixels(4, 2, ids.to_vec()).unwrap())
    }

    #[test]
    fn objects_have_area_box_and_first_and_last_frame() {
        let mut log = ObjectLog::default();
        log.record(&output([0, 7, 7, 0, 0, 7, 0, 0]));
        log.record(&output([0; 8]));
        let found = log.record(&output([0, 0, 3, 3, 0, 0, 7, 7]));
        assert_eq!(found.iter().map(|object| object.id).collect::<Vec<_>>(), [3, 7]);
        assert_eq!(found[1].bounding_box, BoundingBox { x: 2, y: 1, width: 2, height: 1 });
        assert_eq!((found[1].area, found[1].first_frame, found[1].last_frame), (2, 0, 2));
        assert_eq!((found[0].first_frame, found[0].confidence), (2, 1.0));
        assert_eq!(log.records()[&7], ObjectRecord { first_frame: 0, last_frame: 2, frames: 2 });
        assert_eq!(log.frames(), 3);
    }

    #[test]
    fn an_id_that_is_given_again_stands_for_a_new_object() {
        let mut log = ObjectLog::default();
        let mut shown = vec![log.record(&output([7; 8])), log.record(&output([0; 8]))];
        let mut again = output([0, 0, 0, 0, 0, 0, 0, 7]);
        again.update.new_segments = vec![7];
        shown.push(log.record(&again));
        assert_eq!((shown[2][0].first_frame, shown[2][0].last_frame), (2, 2));
        assert_eq!(log.records()[&7], ObjectRecord { first_frame: 2, last_frame: 2, frames: 1 });
        let mut repeated = ObjectLog::default();
        shown.iter().for_each(|sightings| repeated.repeat(sightings));
        assert_eq!(repeated, log);
    }

    #[test]
    fn a_stream_without_an_end_has_a_bounded_log() {
        let mut log = ObjectLog::default();
        let per_frame = 1 << 13;
        for frame in 0..40 {
            let first = 1 + frame * per_frame;
            let pixels = (first..first + per_frame).chain([1]).collect();
            log.record(&FrameOutput::from_segments(
                SegmentMap::from_pixels(1, per_frame as usize + 1, pixels).unwrap(),
            ));
            assert!(log.records().len() <= 2 * KEPT_RECORDS + per_frame as usize);
        }
        assert_eq!(log.records()[&1].first_frame, 0, "it was seen all the time");
        assert!(!log.records().contains_key(&2) && log.records().contains_key(&(40 * per_frame)));
    }

    #[test]
    fn overlapping_masks_count_in_full() {
        let mut output = output([1, 1, 2, 2, 1, 1, 1, 1]);
        output.masks = vec![(1, Mask::from_fn(4, 2, |_, _| true)), (2, Mask::from_fn(4, 2, |x, y| x > 1 && y == 0))];
        let found = ObjectLog::default().record(&output);
        assert_eq!((found[0].area, found[1].area), (8, 2));
    }
}
