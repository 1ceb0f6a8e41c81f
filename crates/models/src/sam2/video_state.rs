//! The state of a video: the memory and current outputs of every object.

use super::encoder::ImageFeatures;
use super::heads::HeadOutputs;
use super::memory::{MemoryBank, RememberedMap, RememberedPointer};
use super::prompt::InputPoint;
use super::{Sam2Error, Sam2PredictorSettings};
use crate::device::is_cpu;
use crate::transfer::download;
use burn::tensor::Tensor;
use std::collections::BTreeMap;

/// The output of the network for one object in the current frame.
#[derive(Clone, Debug)]
pub(super) struct Prediction {
    /// `[side, side]` at a quarter of the input's resolution.
    pub(super) logits: Vec<f32>,
    pub(super) predicted_iou: f32,
    pub(super) pointer: Vec<f32>,
    pub(super) object_score: f32,
    /// The object pointer in the form stored in memory.
    pub(super) remembered_pointer: RememberedPointer,
    /// The logits on the device, `[1, side, side]`; `None` on the CPU.
    pub(super) device_logits: Option<Tensor<3>>,
}

/// State of one object.
#[derive(Clone, Debug, Default)]
pub(super) struct TrackedObject {
    pub(super) bank: MemoryBank,
    /// Output of tracking from memory in the current frame.
    pub(super) tracked: Option<Prediction>,
    /// Output of prompting on the current frame.
    pub(super) prompted: Option<Prediction>,
    /// Points given on the current frame.
    pub(super) points: Vec<InputPoint>,
    /// Number of consecutive frames without the object, up to the current one, since it was last prompted.
    pub(super) absent_frames: usize,
    /// The frame since which it has been resting.
    pub(super) resting_since: Option<usize>,
}

impl TrackedObject {
    /// True if the object has been absent for so long that it is not tracked for now.
    pub(super) fn is_resting(&self, settings: &Sam2PredictorSettings) -> bool {
        settings.max_absent_frames > 0 && self.absent_frames >= settings.max_absent_frames
    }
}

/// State of a video. Its size grows with the number of objects, not of frames, unless
/// [`max_cond_frames_in_attn`](Sam2PredictorSettings::max_cond_frames_in_attn) is `None`: then all frames with prompts are kept.
#[derive(Clone, Debug, Default)]
pub struct VideoState {
    /// Number of frames so far.
    pub(super) frames: usize,
    /// `(width, height)` of the frames.
    pub(super) size: (usize, usize),
    pub(super) features: Option<ImageFeatures>,
    pub(super) objects: BTreeMap<u64, TrackedObject>,
    pub(super) object_passes: usize,
}

impl VideoState {
    /// Ids of the objects, increasing.
    pub fn objects(&self) -> impl Iterator<Item = u64> + '_ {
        self.objects.keys().copied()
    }

    /// Number of frames so far.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Number of passes of an object through the per-object parts of the network: one per tracked or prompted mask, and
    /// one per memory of a frame.
    pub fn object_passes(&self) -> usize {
        self.object_passes
    }

    /// Size of all objects' memories in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.objects.values().map(|object| object.bank.bytes()).sum()
    }

    /// Returns an object's memory of a frame, `[tokens, channels]`, while attention can still see it. The current frame
    /// is added by [`Sam2Predictor::remember_frame`](super::Sam2Predictor::remember_frame).
    ///
    /// # Errors
    /// [`Sam2Error::Device`] if the device fails.
    pub fn memory(&self, object: u64, frame: usize) -> Result<Option<Vec<f32>>, Sam2Error> {
        let map = self.objects.get(&object).and_then(|object| object.bank.features(frame));
        map.map(RememberedMap::values).transpose().map_err(|message| Sam2Error::Device { message })
    }

    /// Index of the current frame.
    pub(super) fn index(&self) -> usize {
        self.frames - 1
    }
}

impl Prediction {
    /// True if the object is not in the frame.
    pub(super) fn is_absent(&self) -> bool {
        self.object_score <= 0.0 || self.logits.iter().all(|logit| *logit <= 0.0)
    }

    /// Downloads the outputs of a chunk and splits them, one per object.
    ///
    /// # Errors
    /// [`Sam2Error::Device`] if the device fails.
    pub(super) fn from_outputs(out: HeadOutputs) -> Result<Vec<Self>, Sam2Error> {
        let [_, height, width] = out.masks.dims();
        let [_, hidden] = out.pointers.dims();
        let device_logits = (!is_cpu(&out.masks.device())).then(|| out.masks.clone());
        let outputs = vec![out.masks.flatten(0, 2), out.pointers.clone().flatten(0, 1), out.ious, out.object_scores];
        let values = download(outputs).map_err(|message| Sam2Error::Device { message })?;
        let [masks, pointers, ious, object_scores] = &values[..] else { unreachable!("one list per tensor") };
        let logits = masks.chunks_exact(height * width);
        let rows = logits.zip(pointers.chunks_exact(hidden)).zip(ious.iter().zip(object_scores));
        let predictions = rows.enumerate().map(|(object, ((logits, pointer), (predicted_iou, object_score)))| Self {
            logits: logits.to_vec(),
            predicted_iou: *predicted_iou,
            pointer: pointer.to_vec(),
            object_score: *object_score,
            remembered_pointer: RememberedPointer::new(out.pointers.clone().narrow(0, object, 1)),
            device_logits: device_logits.as_ref().map(|logits| logits.clone().narrow(0, object, 1)),
        });
        Ok(predictions.collect())
    }
}
