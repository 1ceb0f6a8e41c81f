//! The methods. Each `process` follows the paper's list of steps.

mod fastsam;
mod fastsam_splat;
mod fastspam;
mod hindsight;
mod output;
mod sam2;
mod sam2_splat;

pub use fastsam::{FastSamBaseline, FastSamBaselineSettings};
pub use fastsam_splat::{FastSamSplat, FastSamSplatSettings};
pub use fastspam::{FastSpamBaseline, FastSpamBaselineSettings};
pub use hindsight::{Hindsight, ShownFrame};
pub use output::FrameOutput;
pub use sam2::{Sam2Baseline, Sam2BaselineSettings};
pub use sam2_splat::{Sam2Splat, Sam2SplatSettings};

use crate::TrackingError;
use splatseg_geometry::{
    FrameAnchor, MAX_SEGMENT_ID, MapCorrection, MapView, RemappedId, RgbdFrame, ScoredMask, SegmentId, SegmentMap,
    Segmentation,
};
use splatseg_memory::SplatMemory;
use std::collections::BTreeSet;

/// Assigns ids to the segments of an RGB-D video, one frame at a time.
///
/// Methods are online: the result for a frame depends only on that frame and earlier ones. [`Method::hindsight`] decides
/// frames again afterwards.
pub trait Method: Send {
    /// Name in tables and on the command line, e.g. `fastsam-splat`.
    fn name(&self) -> &str;

    /// Processes the next frame and what a segmenter found in it, and returns the object that each pixel shows. Masks have
    /// the frame's size and may overlap.
    ///
    /// # Errors
    /// E.g. [`TrackingError::MaskSize`] if a mask does not have the frame's size.
    fn process(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError>;

    /// As [`Self::process`], with masks from a segmenter that knows no regions.
    ///
    /// # Errors
    /// As [`Self::process`].
    fn process_masks(&mut self, frame: &RgbdFrame, masks: &[ScoredMask]) -> Result<FrameOutput, TrackingError> {
        self.process(frame, &masks.to_vec().into())
    }

    /// Processes a frame whose pose is unknown, because tracking of the camera is lost; the frame has the last known pose.
    /// Ids are linked in the image, and a memory learns nothing. By default the frame is processed like any other.
    ///
    /// # Errors
    /// As [`Self::process`].
    fn process_without_pose(&mut self, frame: &RgbdFrame, found: &Segmentation) -> Result<FrameOutput, TrackingError> {
        self.process(frame, found)
    }

    /// Sets how much smaller than the camera's the next frames are, as a factor of width and height; 1 if they are not
    /// reduced. Areas in pixels, which are settings, then refer to fewer pixels.
    fn set_reduction(&mut self, _factor: f64) {}

    /// Sets the keyframe to which the surfaces of the next frame are attached.
    fn set_anchor(&mut self, _anchor: &FrameAnchor) {}

    /// Corrects the map before the next frame. Returns the ids that turn out to be the same object.
    fn correct_map(&mut self, _correction: &MapCorrection) -> Vec<RemappedId> {
        Vec::new()
    }

    /// Makes the first of each of these ids' objects part of the second's, as a person says; see
    /// [`SplatMemory::merge_objects`]. By default nothing happens.
    fn merge_objects(&mut self, _remapped: &[RemappedId]) {}

    /// Decides earlier frames again, from all that the method knows now; `None` if it cannot.
    fn hindsight(&self) -> Option<&dyn Hindsight> {
        None
    }

    /// Decides from all frames so far which parts of the map are one object; see [`SplatMemory::settle`]. Returns false if
    /// the method or the segmenter has no evidence for that: then nothing changes.
    fn settle(&mut self) -> bool {
        false
    }

    /// Decides the same about what the last `frames` frames have seen, for [`Self::hindsight`] and [`Self::map`] alone; see
    /// [`SplatMemory::decide_objects`]. Frames are processed as if this had not been called.
    fn decide_objects(&mut self, _frames: u32) {}

    /// Counts what was decided for good; see [`SplatMemory::keep_verdicts`].
    fn keep_verdicts(&mut self) {}

    /// Counts the frames that show an id again; see [`SplatMemory::recount_sightings`].
    fn recount_sightings(&mut self, _id: SegmentId, _before: u32, _after: u32) {}

    /// The map, if the method has one.
    fn map(&self) -> Option<MapView<'_>> {
        self.memory().map(SplatMemory::map)
    }

    /// The splat memory, if the method has one. It is what is saved; to read the map use [`Self::map`].
    fn memory(&self) -> Option<&SplatMemory> {
        None
    }
}

/// Maximum number of masks of a frame that are compared with each other or with the masks of the previous frame. This
/// takes time proportional to the square of their number, and a file of a few megabytes can contain 65,535 masks.
const MAX_COMPARED_MASKS: usize = 2048;

/// As [`check_sizes`], for methods that compare masks with each other.
fn check_comparable(frame: &RgbdFrame, found: &Segmentation) -> Result<(), TrackingError> {
    if found.masks.len() > MAX_COMPARED_MASKS {
        return Err(TrackingError::TooManyMasks { found: found.masks.len(), limit: MAX_COMPARED_MASKS });
    }
    check_sizes(frame, found)
}

/// Checks that every mask, and the map of regions, has the frame's size.
fn check_sizes(frame: &RgbdFrame, found: &Segmentation) -> Result<(), TrackingError> {
    let expected = (frame.width(), frame.height());
    let sizes = found.masks.iter().map(|mask| (mask.mask.width(), mask.mask.height()));
    match sizes.chain(found.regions.as_ref().map(SegmentMap::size)).find(|found| *found != expected) {
        Some(found) => Err(TrackingError::MaskSize { found, expected }),
        None => Ok(()),
    }
}

/// Gives out ids 1, 2, 3, … in the order in which segments appear; after [`MAX_SEGMENT_ID`] from 1 again.
#[derive(Clone, Debug, Default)]
struct SegmentIds {
    last: SegmentId,
}

impl SegmentIds {
    /// Releases unused ids, if they were given out last.
    fn release(&mut self, ids: &BTreeSet<SegmentId>) {
        while self.last > 0 && ids.contains(&self.last) {
            self.last -= 1;
        }
    }

    /// Returns the next id that is not live.
    fn new_segment(&mut self, is_live: impl Fn(SegmentId) -> bool) -> SegmentId {
        loop {
            self.last = self.last % MAX_SEGMENT_ID + 1;
            if !is_live(self.last) {
                return self.last;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Sam2BaselineSettings, Sam2SplatSettings, Tracker, TrackerError};
    use splatseg_geometry::{CameraFrame, Mask, Prompt};

    /// A tracker that finds nothing.
    struct Blind;

    impl Tracker for Blind {
        fn name(&self) -> &str {
            "blind"
        }

        fn track(&mut self, _: &CameraFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
            Ok(Vec::new())
        }

        fn prompt(&mut self, _: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
            Ok(Vec::new())
        }

        fn remove(&mut self, _: SegmentId) {}
    }

    #[test]
    fn ids_start_again_from_1_without_those_that_are_live() {
        let mut ids = SegmentIds { last: MAX_SEGMENT_ID - 1 };
        let mut next = || ids.new_segment(|id| [1, 3].contains(&id));
        assert_eq!([next(), next(), next()], [MAX_SEGMENT_ID, 2, 4]);
    }

    #[test]
    fn methods_with_a_tracker_have_the_names_of_the_command_line() {
        assert_eq!(Sam2Baseline::new(Box::new(Blind), Sam2BaselineSettings::default()).unwrap().name(), "sam2");
        let settings = Sam2SplatSettings::default();
        assert_eq!(Sam2Splat::new(Box::new(Blind), settings, 0, &mut |_| {}).unwrap().name(), "sam2-splat");
    }
}
