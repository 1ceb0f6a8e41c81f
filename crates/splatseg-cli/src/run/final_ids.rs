//! Writes the images of earlier frames again if ids in them turned out to be the same object.

use super::frame_history::{FrameHistory, WrittenFrame};
use super::result_writer::WriterOutcome;
use crate::output_folder::result_files;
use splatseg::summary::RunCounts;
use splatseg_dataset::{DatasetError, Framing, Scene, read_segments_png};
use splatseg_geometry::{CameraFrame, MAX_16_BIT_ID, SegmentId, SegmentMap};
use splatseg_output::{OutputError, ResultFolder, UpdatedFrame};
use std::collections::{BTreeMap, BTreeSet};

/// Where the colour images of the frames come from.
#[derive(Debug)]
pub struct FrameImages<'a> {
    /// The scene.
    pub scene: &'a dyn Scene,
    /// How its frames are resized and cropped.
    pub framing: Framing,
}

/// Writes id image and overlay of each frame with a changed id, and passes it to the outputs. Returns the number of frames.
///
/// An earlier end of the run may have done the same for some of the changes; then they are not in the images any more.
/// Errors are added to `written`: after the first id image that cannot be written, the others stay as they are.
pub fn update_frames(
    written: &mut WriterOutcome,
    history: &FrameHistory,
    images: &FrameImages<'_>,
    counts: &mut RunCounts,
) -> usize {
    let mut frames = 0;
    let mut unread = None;
    for (position, frame, ids) in history.changed() {
        let segments = match updated_segments(written, frame, &ids) {
            Ok((before, after)) => {
                counts.rgb_id_images -= usize::from(needs_rgb(&before));
                counts.rgb_id_images += usize::from(needs_rgb(&after));
                after
            }
            Err(error) => {
                written.output_errors.push(error);
                break;
            }
        };
        frames += 1;
        match images.read(frame.index) {
            Ok(image) => {
                let remapped: BTreeSet<SegmentId> = ids.into_values().collect();
                let (number, color, segments) = (frame.number, image.color(), &segments);
                let [_, overlay] = result_files(&frame.file_name);
                if let Err(error) = written.folder.write_overlay(&overlay, color, segments) {
                    written.output_errors.push(error);
                    break;
                }
                let updated = UpdatedFrame { position, number, color, segments, remapped: &remapped };
                written.for_each_output(|output, folder| output.update_frame(&updated, folder));
            }
            Err(error) => drop(unread.get_or_insert(error)),
        }
    }
    written.output_errors.extend(unread.map(OutputError::from));
    frames
}

impl FrameImages<'_> {
    fn read(&self, index: usize) -> Result<CameraFrame<'static>, DatasetError> {
        self.framing.apply(self.scene.read_recorded(index)?.frame)
    }
}

/// Replaces the ids in a frame's id image. Returns the segments before and after.
fn updated_segments(
    written: &mut WriterOutcome,
    frame: &WrittenFrame,
    ids: &BTreeMap<SegmentId, SegmentId>,
) -> Result<(SegmentMap, SegmentMap), OutputError> {
    let [file, _] = result_files(&frame.file_name);
    let before = read_segments_png(&written.folder.path_of(&file))?;
    let after = SegmentMap::from_fn(before.width(), before.height(), |column, row| {
        let id = before[(column, row)];
        *ids.get(&id).unwrap_or(&id)
    });
    if after != before {
        written.folder.write_segments(&file, &after)?;
    }
    Ok((before, after))
}

fn needs_rgb(segments: &SegmentMap) -> bool {
    segments.pixels().iter().any(|id| *id > MAX_16_BIT_ID)
}
