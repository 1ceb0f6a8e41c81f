//! SAM 2.1 as a tracker.

use crate::{Tracker, TrackerError};
use rayon::prelude::*;
use splatseg_geometry::{Mask, RgbdFrame, SegmentId};
use splatseg_models::sam2::{ObjectMask, Prompt, Sam2Error, Sam2Network, Sam2Predictor, Sam2PredictorSettings};
use splatseg_settings::{Allowed, settings};
use std::sync::Arc;

settings! {
    /// Settings of SAM 2.1 and of [`Sam2Tracker`].
    #[derive(Copy)]
    pub struct Sam2TrackerSettings in "sam2" {
        /// Side of the square to which frames are resized, pixels. The published 1024 if left out.
        image_size: Option<usize> = None, Allowed::Multiple { of: 32, min: 32, max: 2048 };
        /// How many objects go through the network together. More objects need more memory; results are the same.
        objects_per_chunk: usize = 4, Allowed::between(1.0, 256.0);
        /// How many of an object's latest prompted frames the network attends to. 0: all of them, as in the official
        /// code, whose memory use grows with every correction.
        max_prompted_frames: usize = 4, Allowed::between(0.0, 1000.0);
    }
}

impl Sam2TrackerSettings {
    /// The predictor's settings. A correction conditions the frames after it; otherwise it would be lost in the next
    /// frame.
    fn predictor(self) -> Sam2PredictorSettings {
        Sam2PredictorSettings {
            objects_per_chunk: self.objects_per_chunk,
            max_prompted_frames: (self.max_prompted_frames > 0).then_some(self.max_prompted_frames),
            corrections_condition: true,
            video_length: None,
        }
    }
}

/// SAM 2.1 on the frames' colour images; depth is not used.
///
/// A mask prompt that is too thin for the network's resolution is skipped, and its mask is empty.
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
        // An unknown track is not an error here.
        let _ = self.predictor.remove(u64::from(track));
    }
}

/// The object's pixels; none if the network says that it is not in the frame.
fn shown(found: &ObjectMask) -> Mask {
    if found.is_present() { found.mask() } else { Mask::empty(found.frame_size.0, found.frame_size.1) }
}
