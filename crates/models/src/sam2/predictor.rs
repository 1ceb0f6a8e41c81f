//! Streaming prediction: frames arrive one at a time, objects appear and disappear, and clicks correct their masks.
//!
//! The network processes `objects_per_chunk` objects at a time, so its intermediate values do not grow with the number
//! of objects; the stored state does. So an object that was absent from `max_absent_frames` frames in a row rests: it
//! skips the network and keeps only its conditioning frames until it is prompted. This is the default in `sam2-splat`,
//! whose memory prompts an object where it is expected again. `sam2` cannot prompt a lost object, so there objects rest
//! only on demand, and `absent_check_interval` looks for them again. `tools/measure_many_objects.py` measures both with
//! 300 objects.

use super::heads::{MaskChoice, fill_holes};
use super::memory::{AssembledMemory, MaskForMemory, RememberedMap};
use super::video_state::{Prediction, TrackedObject, VideoState};
use super::{ObjectMask, Sam2Error, Sam2Network, Sam2PredictorSettings};
use crate::device::is_cpu;
use crate::transfer::upload;
use burn::tensor::Tensor;
use splatseg_geometry::{CowImage, Image};
use std::sync::Arc;

/// Tracks objects through a stream of frames.
#[derive(Debug)]
pub struct Sam2Predictor {
    pub(super) network: Arc<Sam2Network>,
    pub(super) settings: Sam2PredictorSettings,
    pub(super) state: VideoState,
}

impl Sam2Predictor {
    /// Creates a predictor for a new video.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(network: impl Into<Arc<Sam2Network>>, settings: Sam2PredictorSettings) -> Result<Self, Sam2Error> {
        Self::resume(network, settings, VideoState::default())
    }

    /// Creates a predictor that continues from a state.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn resume(
        network: impl Into<Arc<Sam2Network>>,
        settings: Sam2PredictorSettings,
        state: VideoState,
    ) -> Result<Self, Sam2Error> {
        Ok(Self { network: network.into(), settings: settings.validated()?, state })
    }

    /// The state of the video so far.
    pub fn state(&self) -> &VideoState {
        &self.state
    }

    /// Tracks every object into the next frame and returns their masks by increasing id. Resting objects have no mask
    /// unless they are checked in this frame.
    ///
    /// # Errors
    /// If the frame's size differs from the first frame's, or the device fails.
    pub fn track(&mut self, frame: &CowImage<'_, [u8; 3]>) -> Result<Vec<ObjectMask>, Sam2Error> {
        self.check_size(frame.size())?;
        let input = self.network.input(frame);
        self.advance(input, frame.size())
    }

    /// Like [`Self::track`], for a frame already converted to the network's input, `[1, 3, side, side]` (see
    /// [`Sam2Network::input`]), from a video of `size` (width, height).
    ///
    /// # Errors
    /// If `size` differs from the first frame's, or the device fails.
    pub fn track_input(&mut self, input: Tensor<4>, size: (usize, usize)) -> Result<Vec<ObjectMask>, Sam2Error> {
        self.check_size(size)?;
        self.advance(input, size)
    }

    fn check_size(&self, found: (usize, usize)) -> Result<(), Sam2Error> {
        let expected = self.state.size;
        if found.0 == 0 || found.1 == 0 || (self.state.frames > 0 && found != expected) {
            return Err(Sam2Error::FrameSize { found, expected });
        }
        Ok(())
    }

    fn advance(&mut self, input: Tensor<4>, size: (usize, usize)) -> Result<Vec<ObjectMask>, Sam2Error> {
        self.remember_frame();
        let features = self.network.encode_image(input);
        self.state.size = size;
        self.state.frames += 1;
        for object in self.state.objects.values_mut() {
            object.tracked = None;
            object.prompted = None;
            object.points.clear();
        }
        let ids = self.objects_to_track();
        let attention = &self.network.clone().memory_attention;
        let prepared = (!ids.is_empty()).then(|| attention.prepare(features.embedding.clone()));
        let mut masks = Vec::with_capacity(ids.len());
        for ids in ids.chunks(self.settings.objects_per_chunk) {
            let memories = ids.iter().map(|id| self.assemble(*id)).collect::<Vec<_>>();
            let Some(prepared) = &prepared else { break };
            let embeddings = attention.forward(prepared, &memories, |_, _| {});
            let points = vec![Vec::new(); ids.len()];
            let out = self.network.heads.forward(embeddings, &features, &points, None, MaskChoice::BestOfThree);
            self.state.object_passes += ids.len();
            for (id, prediction) in ids.iter().zip(Prediction::from_outputs(out)?) {
                masks.push(self.object_mask(*id, &prediction));
                self.record_tracked(*id, prediction);
            }
        }
        self.state.features = Some(features);
        self.forget_longest_resting();
        Ok(masks)
    }

    /// Objects to process in the current frame: all that do not rest, and the resting ones due for a check. Checks of
    /// different objects are spread over the frames.
    fn objects_to_track(&self) -> Vec<u64> {
        let (settings, now) = (&self.settings, self.state.index() as u64);
        let is_checked = |id: u64| match settings.absent_check_interval as u64 {
            0 => false,
            interval => now.wrapping_add(id).is_multiple_of(interval),
        };
        let objects = self.state.objects.iter();
        objects.filter(|(id, object)| !object.is_resting(settings) || is_checked(**id)).map(|(id, _)| *id).collect()
    }

    /// Records the network's output for an object in the current frame. A resting object counts as not tracked, so a
    /// prompt on this frame conditions the tracking.
    fn record_tracked(&mut self, id: u64, prediction: Prediction) {
        let (settings, now) = (self.settings, self.state.index());
        let object = self.object_mut(id);
        object.absent_frames = if prediction.is_absent() { object.absent_frames + 1 } else { 0 };
        object.tracked = Some(prediction).filter(|_| !object.is_resting(&settings));
        object.resting_since = object.is_resting(&settings).then(|| object.resting_since.unwrap_or(now));
    }

    /// Forgets the objects that have rested longest if too many rest.
    fn forget_longest_resting(&mut self) {
        let objects = self.state.objects.iter();
        let mut resting: Vec<(usize, u64)> =
            objects.filter_map(|(id, object)| Some((object.resting_since?, *id))).collect();
        let max = self.settings.max_resting_objects;
        if max > 0 && resting.len() > max {
            resting.sort_unstable();
            for (_, id) in resting.iter().take(resting.len() - max) {
                self.state.objects.remove(id);
            }
        }
    }

    pub(super) fn object_mut(&mut self, id: u64) -> &mut TrackedObject {
        self.state.objects.entry(id).or_default()
    }

    pub(super) fn assemble(&self, id: u64) -> AssembledMemory {
        let bank = &self.state.objects[&id].bank;
        bank.assemble(self.state.index(), &self.network.assembly, &self.settings)
    }

    /// Stops tracking an object and forgets it.
    ///
    /// # Errors
    /// If there is no such object.
    pub fn remove(&mut self, object: u64) -> Result<(), Sam2Error> {
        self.state.objects.remove(&object).map(|_| ()).ok_or(Sam2Error::UnknownObject { object })
    }

    /// Adds the current frame to memory. The next frame does this automatically.
    pub fn remember_frame(&mut self) {
        let Some(features) = self.state.features.take() else { return };
        let now = self.state.index();
        let projected = self.network.memory_encoder.project_features(features.embedding.clone());
        let (mut prompted, mut tracked) = (Vec::new(), Vec::new());
        for (id, object) in &self.state.objects {
            if object.prompted.is_some() && !self.is_tracked_again(object) {
                prompted.push(*id);
            } else if object.tracked.is_some() {
                tracked.push(*id);
            }
        }
        for (ids, kind) in [(prompted, MaskForMemory::Binary), (tracked, MaskForMemory::Soft)] {
            for ids in ids.chunks(self.settings.objects_per_chunk) {
                self.remember_chunk(ids, kind, now, &projected);
            }
        }
        for object in self.state.objects.values_mut() {
            if object.is_resting(&self.settings) {
                object.bank.keep_conditioning(&self.settings);
            } else {
                object.bank.forget(now, &self.settings);
            }
        }
        self.state.features = Some(features);
    }

    /// True if a prompt on the current frame conditions the tracking of an object.
    fn conditions(&self, object: &TrackedObject) -> bool {
        object.prompted.is_some() && (object.tracked.is_none() || self.settings.add_all_frames_to_correct_as_cond)
    }

    fn is_tracked_again(&self, object: &TrackedObject) -> bool {
        self.settings.track_corrected_frames_again && !self.conditions(object)
    }

    /// Adds the current frame to the memory of some objects, which were all prompted (`Binary`) or all tracked
    /// (`Soft`).
    fn remember_chunk(&mut self, ids: &[u64], kind: MaskForMemory, now: usize, projected: &Tensor<4>) {
        let objects = ids.iter().filter_map(|id| {
            let object = &self.state.objects[id];
            match kind {
                MaskForMemory::Soft => object.tracked.clone(),
                // A prompted mask is remembered as displayed, with holes filled; a tracked mask as the network outputs
                // it.
                MaskForMemory::Binary => object.prompted.clone().map(|prediction| Prediction {
                    logits: self.without_holes(&prediction),
                    device_logits: None,
                    ..prediction
                }),
            }
        });
        let chosen: Vec<Prediction> = objects.collect();
        let masks = self.masks_for_memory(&chosen, kind);
        let scores: Vec<f32> = chosen.iter().map(|prediction| prediction.object_score).collect();
        let memories = self.network.memory_encoder.forward(projected.clone(), masks, &scores);
        self.state.object_passes += ids.len();
        for (number, (id, prediction)) in ids.iter().zip(chosen).enumerate() {
            let conditioning = self.conditions(&self.state.objects[id]);
            let memory = RememberedMap::new(memories.clone().narrow(0, number, 1).squeeze_dim(0));
            self.object_mut(*id).bank.remember(now, conditioning, memory, prediction.remembered_pointer);
        }
    }

    /// Converts the masks of objects to the memory encoder's input, `[objects, side, side]` at the network's
    /// resolution.
    fn masks_for_memory(&self, chosen: &[Prediction], kind: MaskForMemory) -> Tensor<3> {
        let (side, device) = (self.network.image_size(), self.network.device());
        let low = [1, side / 4, side / 4];
        if is_cpu(device) {
            return kind.masks_on_host(chosen.iter().map(|prediction| prediction.logits.as_slice()), side);
        }
        let logits = |prediction: &Prediction| match &prediction.device_logits {
            Some(logits) => logits.clone(),
            None => upload(prediction.logits.clone(), low, device),
        };
        kind.masks_on_device(Tensor::cat(chosen.iter().map(logits).collect(), 0), side)
    }

    /// Returns the logits as displayed: with small holes filled.
    pub(super) fn without_holes(&self, prediction: &Prediction) -> Vec<f32> {
        let mut logits = prediction.logits.clone();
        fill_holes(&mut logits, self.network.image_size() / 4, self.settings.fill_hole_area);
        logits
    }

    pub(super) fn object_mask(&self, object: u64, prediction: &Prediction) -> ObjectMask {
        let side = self.network.image_size() / 4;
        ObjectMask {
            object,
            // The decoder returns a mask of a quarter of the image's side, and filling holes keeps its size.
            low_res_logits: Image::from_pixels(side, side, self.without_holes(prediction)).expect("a square of logits"),
            object_score: prediction.object_score,
            predicted_iou: prediction.predicted_iou,
            pointer: prediction.pointer.clone(),
            frame_size: self.state.size,
        }
    }
}
