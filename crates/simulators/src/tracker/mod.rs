//! A tracker that knows the ground truth and makes errors at set rates, to measure re-prompting without a network
//! (`docs/SIM_TRACKER.md`).
//!
//! A track follows true objects with their exact masks until one of the errors in [`faults`] occurs. It reacts to
//! prompts as a perfect promptable model would ([`prompting`]).

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
use splatseg_geometry::{Mask, RgbdFrame, SegmentId};
use splatseg_models::sam2::Prompt;
use splatseg_settings::SettingError;
use splatseg_tracking::{Tracker, TrackerError};
use std::collections::{BTreeMap, BTreeSet};

/// A simulated tracker: true masks with errors of known kinds and rates.
///
/// The masks depend on the seed, the names and true segments of the frames, and the prompts, not on the number of
/// threads. Errors are drawn for the followed object rather than for the id of the track, so methods that number their
/// tracks differently see the same errors.
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

/// What a track follows.
#[derive(Clone, Debug, Default)]
struct Target {
    /// Ids of the true objects; if empty, the track follows nothing.
    objects: BTreeSet<SegmentId>,
    /// Their largest visible area so far, pixels.
    largest_area: usize,
    /// Whether they were hidden in the previous frame.
    hidden: bool,
}

/// The track has lost its objects.
#[derive(Clone, Copy, Debug)]
enum Loss {
    /// For this many more frames in which they are visible.
    Frames(usize),
    /// Until it is prompted.
    Lasting,
}

/// The track's mask grows.
#[derive(Clone, Copy, Debug)]
struct Drift {
    /// The object that it grows into.
    into: SegmentId,
    /// The number of frames so far.
    frames: usize,
}

impl SimTracker {
    /// A tracker that knows `truth` and makes the errors that `settings` describe, drawn from `seed`.
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

    /// The true objects that a track follows, whether or not they are in view; `None` if there is no such track.
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

    fn track(&mut self, frame: &RgbdFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
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
                // No object to follow, but the prompt is the mask of this frame.
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
