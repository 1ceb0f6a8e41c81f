//! `objects.json` and `objects.csv`: every object of the run; crops are in `objects/`.

use crate::crops::{Crop, WaitingCrops, mean_color};
use crate::error::saved_state;
use crate::{FrameRecord, OutputError, ResultFolder, RunEnd, RunOutput};
use splatseg_objects::{FrameStamp, SeenObjects};
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
}

impl RunOutput for ObjectsFile {
    fn name(&self) -> &'static str {
        "objects"
    }

    fn add_frame(&mut self, record: &FrameRecord, folder: &mut dyn ResultFolder) -> Result<(), OutputError> {
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
        saved_state(Self::JSON, &changed)
    }

    fn save(&mut self, folder: &mut dyn ResultFolder) -> Result<Vec<u8>, OutputError> {
        // The state then needs no pending crops. A better crop replaces the file later.
        self.crops.write_all(folder)?;
        saved_state(Self::JSON, &())
    }

    fn restore(&mut self, frames: &[String], saved: &[u8]) -> serde_json::Result<()> {
        let () = serde_json::from_slice(saved)?;
        for frame in frames {
            self.seen.replace(serde_json::from_str(frame)?);
        }
        Ok(())
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

fn frame_stamp(record: &FrameRecord) -> FrameStamp {
    FrameStamp {
        number: record.number,
        name: Some(record.frame.name().to_owned()),
        file: Some(record.file_name.clone()),
        time_s: record.frame.timestamp().map(|time| time.as_secs_f64()),
    }
}
