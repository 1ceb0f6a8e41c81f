//! A simulated tracker in the synthetic room, observed while it makes errors: the object that each track should follow,
//! and for how long it does not.

use splatseg_geometry::{CameraFrame, Mask, Prompt, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{MemoryKind, MemorySettings};
use splatseg_segmenter::Segmenter;
use splatseg_simulators::{GroundTruthPrompts, GroundTruthSource, SimTracker, SimTrackerSettings};
use splatseg_test_scenes::recording;
use splatseg_tracking::{
    Method, PromptSource, RepromptSettings, Sam2Baseline, Sam2BaselineSettings, Sam2Splat, Sam2SplatSettings,
    TrackErrorCounts, Tracker, TrackerError,
};
use std::collections::BTreeMap;
use std::sync::{Arc, LazyLock, Mutex};

/// Minimum area of checked objects in a frame, pixels. Expected segments smaller than half this area are not trusted.
pub const MIN_AREA: usize = 60;

/// A tracker that the test can inspect while a method uses it.
#[derive(Clone)]
pub struct Shared(pub Arc<Mutex<SimTracker>>);

impl Tracker for Shared {
    fn name(&self) -> &str {
        "shared"
    }
    fn track(&mut self, frame: &CameraFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        self.0.lock().unwrap().track(frame)
    }
    fn prompt(&mut self, prompts: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        self.0.lock().unwrap().prompt(prompts)
    }
    fn remove(&mut self, track: SegmentId) {
        self.0.lock().unwrap().remove(track);
    }
}

/// A frame of the room and its ground truth.
pub struct RoomFrame {
    frame: RgbdFrame<'static>,
    truth: SegmentMap,
}

/// A small room, rendered once. 48 of its 56 frames are one revolution of the camera, so objects leave the view and
/// return.
pub static ROOM: LazyLock<Vec<RoomFrame>> = LazyLock::new(|| {
    let frames = recording("synthetic:width=112,height=84,frames=56,objects=12,seed=5");
    frames.into_iter().map(|(frame, truth)| RoomFrame { frame, truth }).collect()
});

fn truth() -> impl GroundTruthSource + 'static {
    let of_frame =
        |frame: &CameraFrame| ROOM.iter().find(|room| room.frame.name() == frame.name()).unwrap().truth.clone();
    move |frame: &CameraFrame| Ok(of_frame(frame))
}

/// Minimum area of prompted objects in a frame, pixels.
const MIN_PROMPTED_AREA: usize = 12;

/// A tracker in the room that the test can inspect.
pub fn tracker(errors: SimTrackerSettings) -> Shared {
    Shared(Arc::new(Mutex::new(SimTracker::new(truth(), errors, 3).unwrap())))
}

/// SAM2 with ground-truth prompts.
pub fn baseline(tracker: Shared) -> Sam2Baseline {
    let settings = Sam2BaselineSettings::default().with(|settings| {
        settings.prompts = PromptSource::GroundTruth;
        settings.min_area = MIN_PROMPTED_AREA;
    });
    Sam2Baseline::new(Box::new(tracker), settings).unwrap()
}

/// SAM2-Splat with ground-truth prompts.
pub fn splat(tracker: Shared, kind: MemoryKind, reprompt: RepromptSettings) -> Sam2Splat {
    let settings = Sam2SplatSettings::default().with(|settings| {
        settings.prompts = PromptSource::GroundTruth;
        settings.min_area = MIN_PROMPTED_AREA;
        settings.reprompt = reprompt.with(|reprompt| reprompt.min_expected_area = MIN_AREA / 2);
        settings.memory = MemorySettings::default().with(|memory| {
            memory.kind = kind;
            memory.num_codes = 64;
            memory.feature_dim = 14;
        });
    });
    Sam2Splat::new(Box::new(tracker), settings, 0, &mut |_| {}).unwrap()
}

/// Observations of a method over a video.
#[derive(Debug, Default)]
pub struct Report {
    /// Errors that the method found.
    pub found: TrackErrorCounts,
    /// Number of frames, summed over tracks, in which a track does not show its object although the object is in view.
    pub wrong: usize,
    /// Largest number of frames that a track was wrong in a row, counting frames in which the memory expects most of
    /// its object.
    pub longest: usize,
    /// Output masks of each frame.
    pub masks: Vec<Vec<(SegmentId, Mask)>>,
}

/// Runs a method with ground-truth prompts over frames of the room and checks its tracks. A track is right if its IoU
/// with the object that it followed first is at least `min_iou`.
pub fn watch(room: &[RoomFrame], tracker: &Shared, method: &mut dyn Method, min_iou: f64) -> Report {
    let mut prompts = GroundTruthPrompts::new(truth(), MIN_PROMPTED_AREA);
    let mut report = Report::default();
    let mut owner: BTreeMap<SegmentId, SegmentId> = BTreeMap::new();
    let mut streaks: BTreeMap<SegmentId, usize> = BTreeMap::new();
    for RoomFrame { frame, truth } in room {
        let expected = method.memory().map(|memory| memory.recall(frame).expected().segments.clone());
        let output = method.process_masks(frame, &prompts.segment(frame).unwrap().masks).unwrap();
        report.found += output.track_errors;
        for (id, _) in &output.masks {
            let first =
                || *tracker.0.lock().unwrap().followed(*id).unwrap().first().expect("a new track has an object");
            owner.entry(*id).or_insert_with(first);
        }
        for (id, object) in &owner {
            let mask = truth.mask_of(*object);
            if mask.area() < MIN_AREA {
                continue;
            }
            let shown = output.masks.iter().find(|(shown, _)| shown == id);
            let is_wrong = shown.map_or(0.0, |(_, shown)| shown.iou(&mask)) < min_iou;
            let knows = |map: &SegmentMap| 2 * map.mask_of(*id).intersection_area(&mask) >= mask.area();
            let is_known = expected.as_ref().is_some_and(knows);
            let streak = streaks.entry(*id).or_insert(0);
            *streak = if is_wrong { *streak + usize::from(is_known) } else { 0 };
            report.wrong += usize::from(is_wrong);
            report.longest = report.longest.max(*streak);
        }
        report.masks.push(output.masks);
    }
    report
}
