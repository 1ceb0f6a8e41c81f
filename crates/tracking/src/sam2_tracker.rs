//! SAM 2.1 as a tracker.

use crate::{Tracker, TrackerError};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Mask, RgbdFrame, SegmentId};
use splatseg_models::sam2::{ObjectMask, Prompt, Sam2Error, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use std::sync::Arc;

/// Settings of SAM 2.1 and of [`Sam2Tracker`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Sam2TrackerSettings {
    /// Side of the square that frames are resized to, pixels, a multiple of 32; left out: as published, 1024.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_size: Option<usize>,
    /// How many objects go through the network together, at least 1. More takes more memory; results are the same.
    pub objects_per_chunk: usize,
    /// How many prompted frames of an object are attended to, the latest ones; 0: all of them, as in the official code,
    /// whose memory grows with every correction.
    pub max_prompted_frames: usize,
}

impl Default for Sam2TrackerSettings {
    fn default() -> Self {
        let predictor = Sam2PredictorSettings::default();
        Self {
            image_size: None,
            objects_per_chunk: predictor.objects_per_chunk,
            max_prompted_frames: predictor.max_prompted_frames.unwrap_or(0),
        }
    }
}

impl Sam2TrackerSettings {
    /// The predictor's settings. A correction on a tracked frame conditions the frames after it: without that it would
    /// be gone in the next frame.
    fn predictor(self) -> Sam2PredictorSettings {
        Sam2PredictorSettings {
            objects_per_chunk: self.objects_per_chunk,
            max_prompted_frames: (self.max_prompted_frames > 0).then_some(self.max_prompted_frames),
            corrections_condition: true,
            video_length: None,
        }
    }
}

/// SAM 2.1 on the frames' colour images; depth is not looked at.
///
/// A mask prompt too thin for the network's resolution is left out: its mask is empty.
#[derive(Debug)]
pub struct Sam2Tracker {
    predictor: Sam2Predictor,
    /// `(width, height)` of the current frame.
    size: (usize, usize),
}

impl Sam2Tracker {
    /// A tracker before its first frame. The network, made with [`Sam2TrackerSettings::image_size`], may be shared.
    ///
    /// # Errors
    /// [`TrackerError::Sam2`] if a setting is out of range.
    pub fn new(network: impl Into<Arc<Sam2Network>>, settings: Sam2TrackerSettings) -> Result<Self, TrackerError> {
        Ok(Self { predictor: Sam2Predictor::new(network, settings.predictor())?, size: (0, 0) })
    }
}

impl Tracker for Sam2Tracker {
    fn name(&self) -> &str {
        "sam2"
    }

    fn track(&mut self, frame: &RgbdFrame) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let tracked = self.predictor.track(frame.color())?;
        self.size = (frame.width(), frame.height());
        Ok(tracked.par_iter().map(|found| (found.object as SegmentId, shown(found))).collect())
    }

    fn prompt(&mut self, prompts: &[(SegmentId, Prompt)]) -> Result<Vec<(SegmentId, Mask)>, TrackerError> {
        let mut usable: Vec<usize> = (0..prompts.len()).collect();
        let prompted = loop {
            let chosen = usable.iter().map(|place| (u64::from(prompts[*place].0), prompts[*place].1.clone()));
            match self.predictor.prompt_all(&chosen.collect::<Vec<_>>()) {
                Ok(prompted) => break prompted,
                Err(Sam2Error::EmptyMask { object }) => {
                    let is_thin = |(id, prompt): &(SegmentId, Prompt)| {
                        u64::from(*id) == object && matches!(prompt, Prompt::Mask(_))
                    };
                    usable.retain(|place| !is_thin(&prompts[*place]));
                }
                Err(error) => return Err(error.into()),
            }
        };
        let (width, height) = self.size;
        let mut masks: Vec<(SegmentId, Mask)> =
            prompts.iter().map(|(id, _)| (*id, Mask::empty(width, height))).collect();
        let found: Vec<Mask> = prompted.par_iter().map(shown).collect();
        usable.into_iter().zip(found).for_each(|(place, mask)| masks[place].1 = mask);
        Ok(masks)
    }

    fn remove(&mut self, track: SegmentId) {
        // That there is no such track is no error here.
        let _ = self.predictor.remove(u64::from(track));
    }
}

/// The object's pixels; none if the network says that it is not in the frame.
fn shown(found: &ObjectMask) -> Mask {
    if found.is_present() { found.mask() } else { Mask::empty(found.frame_size.0, found.frame_size.1) }
}
