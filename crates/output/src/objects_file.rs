//! `objects.json` and `objects.csv`: every object of the run; crops are in `objects/`.

use crate::crops::{Crop, WaitingCrops, mean_color};
use crate::error::saved_state;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput, UpdatedFrame};
use splatseg_geometry::{RemappedId, SegmentId, SegmentMap};
use splatseg_objects::{BoundingBox, FrameStamp, SeenObjects};
use std::path::PathBuf;

/// Writes the list of objects and their crops.
#[derive(Debug, Default)]
pub struct ObjectsFile {
    seen: SeenObjects,
    crops: WaitingCrops,
}

impl ObjectsFile {
    /// Name of the JSON file.
    pub const JSON: &'static str = "objects.json";
    /// Name of the CSV file, which has the same data as a table.
    pub const CSV: &'static str = "objects.csv";

    /// Path of an object's picture in the folder of results.
    pub fn crop(id: SegmentId) -> String {
        WaitingCrops::file(id)
    }
}

impl ObjectsFile {
    /// Joins objects, and removes the crops of ids that are no longer used.
    fn remap(&mut self, remapped: &[RemappedId], folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        for RemappedId { from, .. } in remapped {
            self.crops.discard(*from);
            folder.remove(&WaitingCrops::file(*from))?;
        }
        self.join(remapped);
        Ok(())
    }

    /// Joins the sightings of objects. The crop of a remapped object is cut again at the end, from the frame of its best
    /// view.
    fn join(&mut self, remapped: &[RemappedId]) {
        self.seen.remap(remapped);
        for RemappedId { into, .. } in remapped {
            if let Some(view) = self.seen.best_view_mut(*into) {
                view.crop = view.crop.take().map(|_| WaitingCrops::file(*into));
            }
        }
    }
}

impl RunOutput for ObjectsFile {
    fn name(&self) -> &'static str {
        "objects"
    }

    fn add_frame(&mut self, record: &FrameRecord, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.remap(&record.remapped, folder)?;
        let color = record.frame.color();
        let stamp = frame_stamp(record);
        for id in self.seen.record(&stamp, color.size(), &record.objects) {
            let Some(view) = self.seen.best_view_mut(id) else { continue };
            view.color = mean_color(color, &record.segments, id, &view.bounding_box);
            if let Some(crop) = Crop::of(color, &record.segments, id, &view.bounding_box) {
                view.crop = Some(WaitingCrops::file(id));
                self.crops.add(id, record.number, crop);
            }
        }
        self.crops.write_settled(record.number, folder)
    }

    fn frame_state(&self, record: &FrameRecord) -> Result<Vec<u8>, OutputError> {
        let objects = self.seen.objects();
        let changed: Vec<_> = record.objects.iter().filter_map(|object| objects.get_key_value(&object.id)).collect();
        saved_state(Self::JSON, &(&record.remapped, changed))
    }

    fn save(&mut self, folder: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError> {
        // The state then needs no pending crops. A better crop replaces the file later.
        self.crops.write_all(folder)?;
        saved_state(Self::JSON, &())
    }

    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()> {
        let () = serde_json::from_slice(saved)?;
        for frame in frames {
            let (remapped, changed): (Vec<RemappedId>, _) = serde_json::from_str(frame)?;
            self.join(&remapped);
            self.seen.replace(changed);
        }
        Ok(())
    }

    fn update_frame(&mut self, frame: &UpdatedFrame<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.crops.write_all(folder)?;
        for id in frame.remapped {
            let Some(view) = self.seen.best_view_mut(*id).filter(|view| view.frame.number == frame.number) else {
                continue;
            };
            let Some((area, bounding_box)) = extent_of(frame.segments, *id) else { continue };
            view.area_px = area;
            view.bounding_box = bounding_box;
            view.color = mean_color(frame.color, frame.segments, *id, &bounding_box);
            if let Some(crop) = Crop::of(frame.color, frame.segments, *id, &bounding_box) {
                self.crops.add(*id, frame.number, crop);
            }
        }
        self.crops.write_all(folder)
    }

    fn finish(&mut self, end: &RunEnd<'_>, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
        self.crops.write_all(folder)?;
        let mut list = end.objects.clone();
        list.scene = Some(end.scene.to_owned());
        list.add_sightings(&self.seen);
        let json = list
            .to_json()
            .map_err(|error| OutputError::Io { path: PathBuf::from(Self::JSON), source: error.into() })?;
        folder.write(Self::JSON, json.as_bytes())?;
        folder.write(Self::CSV, list.to_csv().as_bytes())
    }
}

/// Number of an id's pixels and the smallest box around them; `None` if there are none.
fn extent_of(segments: &SegmentMap, id: SegmentId) -> Option<(usize, BoundingBox)> {
    let (mut area, mut columns, mut rows) = (0, (usize::MAX, 0), (usize::MAX, 0));
    for row in 0..segments.height() {
        for (column, _) in segments.row(row).iter().enumerate().filter(|(_, found)| **found == id) {
            area += 1;
            columns = (columns.0.min(column), columns.1.max(column));
            rows = (rows.0.min(row), rows.1.max(row));
        }
    }
    let side = |(first, last): (usize, usize)| last + 1 - first;
    (area > 0).then(|| (area, BoundingBox { x: columns.0, y: rows.0, width: side(columns), height: side(rows) }))
}

fn frame_stamp(record: &FrameRecord) -> FrameStamp {
    FrameStamp {
        number: record.number,
        name: Some(record.frame.name().to_owned()),
        file: Some(record.file_name.clone()),
        time_s: record.frame.timestamp().map(|time| time.as_secs_f64()),
    }
}
