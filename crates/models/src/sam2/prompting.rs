//! Prompting: new objects, and corrections of tracked ones.

use super::encoder::ImageFeatures;
use super::heads::{HeadOutputs, MaskChoice};
use super::prompt::{CheckedPrompt, zeros_and_ones};
use super::video_state::Prediction;
use super::{ObjectMask, Sam2Error, Sam2Predictor};
use crate::transfer::upload;
use burn::tensor::Tensor;
use rayon::prelude::*;
use splatseg_geometry::Prompt;

/// Earlier logits are clamped to ± this value when they accompany new clicks.
const LOGIT_LIMIT: f32 = 32.0;

impl Sam2Predictor {
    /// Prompts one object on the current frame; an unknown id becomes a new object. If the object was tracked in this
    /// frame, the prompt corrects it. A resting object is tracked again.
    ///
    /// # Errors
    /// If there is no frame yet, or the prompt is empty, not finite or outside the frame; nothing changes in these
    /// cases. Also if the device fails.
    pub fn prompt(&mut self, object: u64, prompt: &Prompt) -> Result<ObjectMask, Sam2Error> {
        Ok(self.prompt_all(&[(object, prompt.clone())])?.remove(0))
    }

    /// Prompts many objects at once, with the same results as one after another. Masks are in the order of the prompts.
    ///
    /// # Errors
    /// As for [`Self::prompt`]; if one prompt is invalid, none takes effect.
    pub fn prompt_all(&mut self, prompts: &[(u64, Prompt)]) -> Result<Vec<ObjectMask>, Sam2Error> {
        let features = self.state.features.clone().ok_or(Sam2Error::NoFrame)?;
        let checked = self.checked(prompts).into_iter().collect::<Result<Vec<_>, Sam2Error>>()?;
        self.prompt_checked(&checked, &features)
    }

    /// Like [`Self::prompt_all`], but skips masks that are empty at the network's resolution and returns `None` for
    /// them.
    ///
    /// # Errors
    /// As for [`Self::prompt_all`], except for empty masks.
    pub fn prompt_unless_empty(&mut self, prompts: &[(u64, Prompt)]) -> Result<Vec<Option<ObjectMask>>, Sam2Error> {
        let features = self.state.features.clone().ok_or(Sam2Error::NoFrame)?;
        let (mut places, mut usable) = (Vec::new(), Vec::new());
        for (place, checked) in self.checked(prompts).into_iter().enumerate() {
            match checked {
                Err(Sam2Error::EmptyMask { .. }) => {}
                checked => {
                    places.push(place);
                    usable.push(checked?);
                }
            }
        }
        let mut masks = vec![None; prompts.len()];
        let found = self.prompt_checked(&usable, &features)?;
        places.into_iter().zip(found).for_each(|(place, mask)| masks[place] = Some(mask));
        Ok(masks)
    }

    fn checked(&self, prompts: &[(u64, Prompt)]) -> Vec<Result<(u64, CheckedPrompt), Sam2Error>> {
        let (frame, side) = (self.state.size, self.network.image_size());
        let check = |(object, prompt): &(u64, Prompt)| Ok((*object, CheckedPrompt::new(*object, prompt, frame, side)?));
        prompts.par_iter().map(check).collect()
    }

    fn prompt_checked(
        &mut self,
        checked: &[(u64, CheckedPrompt)],
        features: &ImageFeatures,
    ) -> Result<Vec<ObjectMask>, Sam2Error> {
        let mut masks: Vec<Option<ObjectMask>> = vec![None; checked.len()];
        let mut waiting: Vec<usize> = (0..checked.len()).collect();
        while !waiting.is_empty() {
            // Prompts that the network can process together: of the same kind, and one per object.
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
            let out = self.prompt_chunk(&prompts, kind, features);
            self.state.object_passes += chunk.len();
            for ((index, (id, _)), prediction) in chunk.iter().zip(prompts).zip(Prediction::from_outputs(out)?) {
                masks[*index] = Some(self.object_mask(*id, &prediction));
                let object = self.object_mut(*id);
                object.prompted = Some(prediction);
                object.absent_frames = 0;
                object.resting_since = None;
            }
        }
        Ok(masks.into_iter().flatten().collect())
    }

    /// Kind of a prompt; prompts of the same kind can be processed together.
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
                    CheckedPrompt::Mask(mask) => Some(zeros_and_ones(mask)),
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
            let attention = &self.network.memory_attention;
            attention.forward(&attention.prepare(features.embedding.clone()), &memories, |_, _| {})
        } else {
            features.embedding.clone() + self.network.no_memory.clone()
        };
        let masks = has_logits.then(|| self.earlier_logits(prompts));
        let choice = if count <= 1 { MaskChoice::BestOfThree } else { MaskChoice::Single };
        self.network.heads.forward(embeddings, features, &all_points, masks, choice)
    }

    /// Current logits of the objects in this frame, `[objects, side, side]`.
    fn earlier_logits(&self, prompts: &[&(u64, CheckedPrompt)]) -> Tensor<3> {
        let side = self.network.image_size() / 4;
        let earlier = |id: &u64| {
            let object = &self.state.objects[id];
            object.prompted.as_ref().or(object.tracked.as_ref())
        };
        let logits: Vec<f32> = prompts
            .iter()
            .filter_map(|(id, _)| Some(self.without_holes(earlier(id)?)))
            .flat_map(|logits| logits.into_iter().map(|logit| logit.clamp(-LOGIT_LIMIT, LOGIT_LIMIT)))
            .collect();
        upload(logits, [prompts.len(), side, side], self.network.device())
    }
}

/// Kind of a prompt. The network processes only prompts of the same kind together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PromptKind {
    Mask,
    Points { count: usize, has_memory: bool, has_logits: bool },
}
