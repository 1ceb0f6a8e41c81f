//! Streaming prediction: frames come one at a time, objects come and go, and clicks correct their masks.

use super::encoder::ImageFeatures;
use super::heads::{HeadOutputs, MaskChoice};
use super::layers::host::host;
use super::memory::{AssembledMemory, MaskForMemory};
use super::prompt::CheckedPrompt;
use super::resize::{Size, resize_bilinear};
use super::video_state::{Prediction, TrackedObject, VideoState};
use super::{ObjectMask, Prompt, Sam2Error, Sam2Network, Sam2PredictorSettings};
use burn::tensor::{Tensor, TensorData};
use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image};
use std::sync::Arc;

/// Earlier logits are clamped to this when they go along with new clicks.
const LOGIT_LIMIT: f32 = 32.0;

/// Follows objects through a stream of frames.
#[derive(Debug)]
pub struct Sam2Predictor {
    network: Arc<Sam2Network>,
    settings: Sam2PredictorSettings,
    state: VideoState,
}

impl Sam2Predictor {
    /// A predictor before its first frame.
    ///
    /// # Errors
    /// If a setting is out of range.
    pub fn new(network: impl Into<Arc<Sam2Network>>, settings: Sam2PredictorSettings) -> Result<Self, Sam2Error> {
        Self::resume(network, settings, VideoState::default())
    }

    /// A predictor that continues from a state.
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

    /// Takes the next frame and follows every object into it; masks come by increasing id.
    ///
    /// # Errors
    /// If the frame's size is not that of the first.
    pub fn track(&mut self, frame: &CowImage<'_, [u8; 3]>) -> Result<Vec<ObjectMask>, Sam2Error> {
        self.check_size(frame.size())?;
        let input = self.network.input(frame);
        Ok(self.advance(input, frame.size()))
    }

    /// [`Self::track`] for a frame that is already the network's input, `[1, 3, side, side]` (see [`Sam2Network::input`]), of a
    /// video of `size` (width, height).
    ///
    /// # Errors
    /// If `size` is not that of the first frame.
    pub fn track_input(&mut self, input: Tensor<4>, size: (usize, usize)) -> Result<Vec<ObjectMask>, Sam2Error> {
        self.check_size(size)?;
        Ok(self.advance(input, size))
    }

    fn check_size(&self, found: (usize, usize)) -> Result<(), Sam2Error> {
        let expected = self.state.size;
        if found.0 == 0 || found.1 == 0 || (self.state.frames > 0 && found != expected) {
            return Err(Sam2Error::FrameSize { found, expected });
        }
        Ok(())
    }

    fn advance(&mut self, input: Tensor<4>, size: (usize, usize)) -> Vec<ObjectMask> {
        self.remember_frame();
        let features = self.network.encode_image(input);
        self.state.size = size;
        self.state.frames += 1;
        for object in self.state.objects.values_mut() {
            (object.tracked, object.prompted) = (None, None);
            object.points.clear();
        }
        let ids: Vec<u64> = self.state.objects.keys().copied().collect();
        let mut masks = Vec::with_capacity(ids.len());
        for ids in ids.chunks(self.settings.objects_per_chunk) {
            let memories = ids.iter().map(|id| self.assemble(*id)).collect::<Vec<_>>();
            let embeddings = self.network.memory_attention.forward(features.embedding.clone(), &memories, |_, _| {});
            let points = vec![Vec::new(); ids.len()];
            let out = self.network.heads.forward(embeddings, &features, &points, None, MaskChoice::BestOfThree);
            for (id, prediction) in ids.iter().zip(Prediction::from_outputs(out)) {
                masks.push(self.object_mask(*id, &prediction));
                self.object_mut(*id).tracked = Some(prediction);
            }
        }
        self.state.features = Some(features);
        masks
    }

    fn object_mut(&mut self, id: u64) -> &mut TrackedObject {
        self.state.objects.entry(id).or_default()
    }

    fn assemble(&self, id: u64) -> AssembledMemory {
        let bank = &self.state.objects[&id].bank;
        bank.assemble(self.state.index(), &self.network.memory_attention, &self.settings)
    }

    /// Prompts one object on the current frame; an unknown id becomes a new object. On a frame where the object was
    /// tracked, the prompt corrects it.
    ///
    /// # Errors
    /// If there is no frame yet, or the prompt is empty, not finite or outside the frame. Nothing is changed then.
    pub fn prompt(&mut self, object: u64, prompt: &Prompt) -> Result<ObjectMask, Sam2Error> {
        Ok(self.prompt_all(&[(object, prompt.clone())])?.remove(0))
    }

    /// Prompts many objects at once, with the same results as one after another; masks come in the order of the prompts.
    ///
    /// # Errors
    /// As [`Self::prompt`]; if one prompt is bad, none takes effect.
    pub fn prompt_all(&mut self, prompts: &[(u64, Prompt)]) -> Result<Vec<ObjectMask>, Sam2Error> {
        let Some(features) = self.state.features.clone() else { return Err(Sam2Error::NoFrame) };
        let size = self.network.image_size();
        let checked = prompts
            .iter()
            .map(|(object, prompt)| Ok((*object, CheckedPrompt::new(*object, prompt, self.state.size, size)?)))
            .collect::<Result<Vec<_>, Sam2Error>>()?;

        let mut masks: Vec<Option<ObjectMask>> = vec![None; checked.len()];
        let mut waiting: Vec<usize> = (0..checked.len()).collect();
        while !waiting.is_empty() {
            // Prompts that can go through the network together: of the same kind, and one per object.
            let kind = self.kind(&checked[waiting[0]]);
            let mut chunk: Vec<usize> = Vec::new();
            for index in &waiting {
                let id = checked[*index].0;
                let first_of_object = waiting.iter().find(|other| checked[**other].0 == id) == Some(index);
                if chunk.len() < self.settings.objects_per_chunk
                    && first_of_object
                    && self.kind(&checked[*index]) == kind
                {
                    chunk.push(*index);
                }
            }
            waiting.retain(|index| !chunk.contains(index));
            let prompts: Vec<&(u64, CheckedPrompt)> = chunk.iter().map(|index| &checked[*index]).collect();
            let out = self.prompt_chunk(&prompts, kind, &features);
            for ((index, (id, _)), prediction) in chunk.iter().zip(prompts).zip(Prediction::from_outputs(out)) {
                masks[*index] = Some(self.object_mask(*id, &prediction));
                self.object_mut(*id).prompted = Some(prediction);
            }
        }
        Ok(masks.into_iter().flatten().collect())
    }

    /// What prompts must have in common to go through the network together.
    fn kind(&self, (id, prompt): &(u64, CheckedPrompt)) -> PromptKind {
        let object = self.state.objects.get(id);
        match prompt {
            CheckedPrompt::Mask(_) => PromptKind::Mask,
            CheckedPrompt::Points { points, replace } => PromptKind::Points {
                count: points.len() + if *replace { 0 } else { object.map_or(0, |object| object.points.len()) },
                has_memory: object.is_some_and(|object| object.tracked.is_some()),
                has_logits: object.is_some_and(|object| object.tracked.is_some() || object.prompted.is_some()),
            },
        }
    }

    fn prompt_chunk(
        &mut self,
        prompts: &[&(u64, CheckedPrompt)],
        kind: PromptKind,
        features: &ImageFeatures,
    ) -> HeadOutputs {
        let PromptKind::Points { count, has_memory, has_logits } = kind else {
            let masks: Vec<Vec<f32>> = prompts
                .iter()
                .filter_map(|(_, prompt)| match prompt {
                    CheckedPrompt::Mask(mask) => Some(mask.clone()),
                    CheckedPrompt::Points { .. } => None,
                })
                .collect();
            prompts.iter().for_each(|(id, _)| self.object_mut(*id).points.clear());
            return self.network.heads.use_masks_as_output(features, &masks, self.network.image_size());
        };
        let mut all_points = Vec::with_capacity(prompts.len());
        for (id, prompt) in prompts {
            let object = self.object_mut(*id);
            if let CheckedPrompt::Points { points, replace } = prompt {
                if *replace {
                    object.points.clear();
                }
                object.points.extend(points);
            }
            all_points.push(object.points.clone());
        }
        let embeddings = if has_memory {
            let memories = prompts.iter().map(|(id, _)| self.assemble(*id)).collect::<Vec<_>>();
            self.network.memory_attention.forward(features.embedding.clone(), &memories, |_, _| {})
        } else {
            features.embedding.clone() + self.network.no_memory.clone()
        };
        let masks = has_logits.then(|| self.earlier_logits(prompts));
        let choice = if count <= 1 { MaskChoice::BestOfThree } else { MaskChoice::Single };
        self.network.heads.forward(embeddings, features, &all_points, masks, choice)
    }

    /// The logits that the objects have on this frame so far, `[objects, side, side]`.
    fn earlier_logits(&self, prompts: &[&(u64, CheckedPrompt)]) -> Tensor<3> {
        let side = self.network.image_size() / 4;
        let logits: Vec<f32> = prompts
            .iter()
            .filter_map(|(id, _)| self.state.objects[id].prompted.as_ref().or(self.state.objects[id].tracked.as_ref()))
            .flat_map(|prediction| prediction.logits.iter().map(|logit| logit.clamp(-LOGIT_LIMIT, LOGIT_LIMIT)))
            .collect();
        Tensor::from_data(TensorData::new(logits, [prompts.len(), side, side]), self.network.device())
    }

    /// Stops following an object and forgets it.
    ///
    /// # Errors
    /// If there is no such object.
    pub fn remove(&mut self, object: u64) -> Result<(), Sam2Error> {
        self.state.objects.remove(&object).map(|_| ()).ok_or(Sam2Error::UnknownObject { object })
    }

    /// Puts the current frame into memory. The next frame does this by itself.
    pub fn remember_frame(&mut self) {
        let Some(features) = self.state.features.take() else { return };
        let now = self.state.index();
        let projected = self.network.memory_encoder.project_features(features.embedding.clone());
        let conditions = |object: &TrackedObject| {
            object.prompted.is_some() && (object.tracked.is_none() || self.settings.corrections_condition)
        };
        let (prompted, tracked): (Vec<u64>, Vec<u64>) =
            self.state.objects.keys().partition(|id| conditions(&self.state.objects[*id]));
        for (ids, prompted) in [(prompted, true), (tracked, false)] {
            for ids in ids.chunks(self.settings.objects_per_chunk) {
                self.remember_chunk(ids, prompted, now, &projected);
            }
        }
        for object in self.state.objects.values_mut() {
            object.bank.forget(now, &self.settings);
        }
        self.state.features = Some(features);
    }

    fn remember_chunk(&mut self, ids: &[u64], prompted: bool, now: usize, projected: &Tensor<4>) {
        let kind = if prompted { MaskForMemory::Binary } else { MaskForMemory::Soft };
        let chosen: Vec<Prediction> = ids
            .iter()
            .filter_map(|id| {
                let object = &self.state.objects[id];
                if prompted { object.prompted.clone() } else { object.tracked.clone() }
            })
            .collect();
        let side = self.network.image_size();
        let (low, high) = (Size { width: side / 4, height: side / 4 }, Size { width: side, height: side });
        let masks: Vec<Vec<f32>> = chosen
            .par_iter()
            .map(|prediction| {
                let mut mask = resize_bilinear(&prediction.logits, low, high);
                mask.iter_mut().for_each(|logit| *logit = kind.apply(*logit));
                mask
            })
            .collect();
        let masks = TensorData::new(masks.concat(), [ids.len(), side, side]);
        let masks = Tensor::from_data(masks, self.network.device());
        let scores: Vec<f32> = chosen.iter().map(|prediction| prediction.object_score).collect();
        let memories = host(self.network.memory_encoder.forward(projected.clone(), masks, &scores));
        let length = memories.len() / ids.len();
        for ((id, memory), prediction) in ids.iter().zip(memories.chunks_exact(length)).zip(chosen) {
            self.object_mut(*id).bank.remember(now, prompted, memory, prediction.pointer);
        }
    }

    fn object_mask(&self, object: u64, prediction: &Prediction) -> ObjectMask {
        let side = self.network.image_size() / 4;
        ObjectMask {
            object,
            low_res_logits: Image::from_pixels(side, side, prediction.logits.clone()).expect("a square of logits"),
            object_score: prediction.object_score,
            predicted_iou: prediction.predicted_iou,
            pointer: prediction.pointer.clone(),
            frame_size: self.state.size,
        }
    }
}

/// What prompts must have in common to go through the network together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PromptKind {
    Mask,
    Points { count: usize, has_memory: bool, has_logits: bool },
}
