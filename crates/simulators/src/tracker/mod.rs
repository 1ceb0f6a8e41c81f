//! A tracker that follows the ground truth with errors at given rates, for evaluating re-prompting without a network
//! (`docs/dev/SIM_TRACKER.md`).
//!
//! A track follows true objects with their exact masks until one of the errors in [`faults`] occurs. It responds to
//! prompts like a perfect promptable model ([`prompting`]).

mod faults;
mod prompting;
mod scene;
mod settings;

pub use settings::SimTrackerSettings;

use crate::{Chance, FrameChance, GroundTruthSource, SimulatorError};
use faults::FrameFaults;
use prompting::{answered, checked};
use rayon::prelude::*;
use scene::TrueFrame;
use splatseg_geometry::{CameraFrame, Mask, Prompt, SegmentId};
use splatseg_settings::SettingError;
use splatseg_tracking::{Tracker, TrackerError};
use std::collections::{BTreeMap, BTreeSet};

/// A simulated tracker: true masks with errors of known kinds and rates.
///
/// The masks depend on the seed, the names and true segments of the frames, and the prompts, not on the number of
/// threads. Errors are drawn for the followed object rather than for the id of the track, so methods that number their
/// tracks differently get the same errors.
pub struct SimTracker {
    truth: Box<dyn GroundTruthSource>,
    model: SimTrackerSettings,
    chance: Chance,
    tracks: BTreeMap<SegmentId, SimTrack>,
    frame: Option<TrueFrame>,
}

/// A track.
#[derive(Clone, Debug, Default)]
struct SimTrack {
    target: Target,
    loss: Option<Loss>,
    drift: Option<Drift>,
}

/// The objects that a track follows.
#[derive(Clone, Debug, Default)]
struct Target {
    /// Ids of the true objects. If empty, the track follows nothing.
    objects: BTreeSet<SegmentId>,
    /// Maximum visible area of the objects so far, pixels.
    largest_area: usize,
    /// True if the objects were hidden in the last frame.
    hidden: bool,
}

/// Remaining duration for which a track has lost its objects.
#[derive(Clone, Copy, Debug)]
enum Loss {
    /// Number of remaining frames in which the objects are visible.
    Frames(usize),
    /// Until the track is prompted.
    Lasting,
}

/// Growth of a track's mask into a neighbouring object.
#[derive(Clone, Copy, Debug)]
struct Drift {
    /// The neighbouring object.
    into: SegmentId,
    /// Number of frames so far.
    frames: usize,
}

impl SimTracker {
    /// Creates a tracker for `truth` with the errors described by `settings`, drawn from `seed`.
    ///
    /// # Errors
    /// [`SettingError`] if a setting is out of range.
    pub fn new(
        truth: impl GroundTruthSource + 'static,
        settings: SimTrackerSettings,
        seed: u64,
    ) -> Result<Self, SettingError> {
        let (model, chance) = (settings.validated()?, Chance { seed });
        Ok(Self { truth: Box::new(truth), model, chance, tracks: BTreeMap::new(), frame: None })
    }

    /// Returns the true objects that a track follows, visible or not. `None` if there is no such track.
    pub fn followed(&self, track: SegmentId) -> Option<&BTreeSet<SegmentId>> {
        self.tracks.get(&track).map(|track| &track.target.objects)
    }
}

impl SimTrack {
    /// The track's mask in a frame.
    fn mask(&self, frame: &TrueFrame, model: &SimTrackerSettings) -> Mask {
        if self.loss.is_some() {
            return frame.nothing();
        }
        let mut mask = frame.union(&self.target.objects);
        if let Some(drift) = self.drift {
            mask.unite(&frame.within_reach(&mask, drift.into, drift.frames as f64 * model.drift_px_per_frame));
        }
        mask
    }
}

impl Tracker for SimTracker {
    fn name(&self) -> &str {
        "sim"
    }

    fn track(&mut self, frame: &CameraFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let truth = self.truth.ground_truth(frame)?;
        SimulatorError::check_size(frame, truth.size())?;
        let chance = FrameChance { run: self.chance, frame: frame.name() };
        let frame = TrueFrame::new(truth);
        FrameFaults { frame: &frame, model: &self.model, chance }.apply(&mut self.tracks);
        let tracks: Vec<(&SegmentId, &SimTrack)> = self.tracks.iter().collect();
        let masks = tracks.into_par_iter().map(|(id, track)| (*id, track.mask(&frame, &self.model))).collect();
        self.frame = Some(frame);
        Ok(masks)
    }

    fn prompt(&mut self, prompts: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let frame = self.frame.as_ref().ok_or(TrackerError::NoFrame)?;
        for (track, prompt) in prompts {
            checked(*track, prompt, frame.size())?;
        }
        let mut masks = Vec::with_capacity(prompts.len());
        for (id, prompt) in prompts {
            let before = self.tracks.get(id).filter(|track| !track.mask(frame, &self.model).is_empty());
            let objects = answered(prompt, frame, before.map(|track| &track.target.objects));
            let shown = frame.union(&objects);
            let mask = match prompt {
                // The track follows nothing, but the prompt is its mask in this frame.
                Prompt::Mask(mask) if objects.is_empty() => mask.clone(),
                _ => shown.clone(),
            };
            let target = Target { objects, largest_area: shown.area(), hidden: false };
            self.tracks.insert(*id, SimTrack { target, loss: None, drift: None });
            masks.push((*id, mask));
        }
        Ok(masks)
    }

    fn remove(&mut self, track: SegmentId) {
        self.tracks.remove(&track);
    }
}
