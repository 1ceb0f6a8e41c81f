//! An endless wall with two new objects in each frame, and a tracker without errors.

#![allow(dead_code)] // The test and the example use a part each.

use glam::DVec3;
use splatseg_geometry::{CameraFrame, Intrinsics, Mask, Pose, Prompt, RgbdFrame, ScoredMask, SegmentId, SegmentMap};
use splatseg_memory::MemorySettings;
use splatseg_test_scenes::wall;
use splatseg_tracking::{Method, Sam2Splat, Sam2SplatSettings, Tracker, TrackerError};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

const CAMERA: Intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 19.5, cy: 14.5, width: 40, height: 30 };
/// Number of new objects in each frame.
pub const THINGS_PER_FRAME: usize = 2;
/// A tracker without errors, which finds nothing in masks of one column.
#[derive(Clone, Default)]
struct Perfect(Arc<Mutex<Followed>>);

/// State of the tracker.
#[derive(Default)]
pub struct Followed {
    truth: Option<SegmentMap>,
    /// Object of each track.
    pub things: BTreeMap<SegmentId, SegmentId>,
    /// Maximum number of tracks at once.
    pub most: usize,
}

impl Tracker for Perfect {
    fn name(&self) -> &str {
        "perfect"
    }

    fn track(&mut self, frame: &CameraFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let mut followed = self.0.lock().unwrap();
        let truth = truth(frame.name().parse().unwrap());
        let masks = followed.things.iter().map(|(track, thing)| (*track, truth.mask_of(*thing))).collect();
        followed.truth = Some(truth);
        followed.most = followed.most.max(followed.things.len());
        Ok(masks)
    }

    fn prompt(&mut self, prompts: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let mut followed = self.0.lock().unwrap();
        let truth = followed.truth.clone().ok_or(TrackerError::NoFrame)?;
        let mut answer = |(track, prompt): &(SegmentId, Prompt)| {
            let Prompt::Mask(mask) = prompt else { return (*track, Mask::empty(CAMERA.width, CAMERA.height)) };
            let overlap = |thing: &SegmentId| truth.mask_of(*thing).intersection_area(mask);
            let thing = truth.areas().into_keys().filter(|id| *id != 0).max_by_key(overlap);
            match thing.filter(|thing| overlap(thing) > CAMERA.height) {
                Some(thing) => {
                    followed.things.insert(*track, thing);
                    (*track, truth.mask_of(thing))
                }
                None => (*track, Mask::empty(CAMERA.width, CAMERA.height)),
            }
        };
        Ok(prompts.iter().map(&mut answer).collect())
    }

    fn remove(&mut self, track: SegmentId) {
        self.0.lock().unwrap().things.remove(&track);
    }
}

/// True ids of a frame with two objects that no other frame shows.
fn truth(frame: usize) -> SegmentMap {
    SegmentMap::from_fn(CAMERA.width, CAMERA.height, |column, row| match column {
        3..=15 if row > 4 => (1 + THINGS_PER_FRAME * frame) as SegmentId,
        22..=36 if row > 4 => (2 + THINGS_PER_FRAME * frame) as SegmentId,
        _ => 0,
    })
}

/// A frame of the endless wall. Neighbouring frames do not overlap.
fn frame(number: usize) -> RgbdFrame<'static> {
    wall(number.to_string(), CAMERA, 2.0, Pose::from_translation(DVec3::X * 5.0 * number as f64))
}

/// Masks of the objects, and a mask that is too thin for the tracker.
fn detections(frame: usize) -> Vec<ScoredMask> {
    let truth = truth(frame);
    let things = truth.areas().into_keys().filter(|id| *id != 0).map(|id| truth.mask_of(id));
    let thin = Mask::from_fn(CAMERA.width, CAMERA.height, |column, _| column == 18);
    things.chain([thin]).map(|mask| ScoredMask { mask, score: 1.0 }).collect()
}

/// Shows a number of frames and calls `after` after each, with its number and the state of the tracker. Returns the
/// method.
pub fn show(frames: usize, mut after: impl FnMut(usize, &Followed)) -> Sam2Splat {
    let settings = Sam2SplatSettings::default().with(|settings| {
        settings.min_area = 10;
        settings.memory = MemorySettings::default().with(|memory| memory.max_gaussians = 6000);
    });
    let tracker = Perfect::default();
    let mut method = Sam2Splat::new(Box::new(tracker.clone()), settings, 0, &mut |_| {}).unwrap();
    for number in 0..frames {
        let output = method.process_masks(&frame(number), &detections(number)).unwrap();
        assert_eq!(output.masks.len(), THINGS_PER_FRAME, "frame {number}");
        after(number, &tracker.0.lock().unwrap());
    }
    method
}
