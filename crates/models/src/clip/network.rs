//! A CLIP network with both towers.

use super::image_tower::ImageTower;
use super::pacing::{Pace, Pacer};
use super::text_tower::TextTower;
use super::{ClipConfig, ClipError, ClipTokenizer};
use crate::checkpoint::{Checkpoint, Format};
use crate::transformer::LayerReader;
use splatseg_geometry::CowImage;
use std::path::{Path, PathBuf};

/// Images that pass through the network at once, and texts: enough for all threads, without much memory.
const IMAGES_AT_ONCE: usize = 4;
const TEXTS_AT_ONCE: usize = 64;
/// The same in steps.
const IMAGES_IN_STEPS: usize = 1;
const TEXTS_IN_STEPS: usize = 4;

/// Factor of similarities in a checkpoint that does not tell it, and the largest one.
const USUAL_SCALE: f32 = 100.0;
const MAX_SCALE: f32 = 200.0;

/// ε of every layer norm.
const EPSILON: f32 = 1e-5;

/// A CLIP network on the CPU.
#[derive(Clone, Debug)]
pub struct ClipNetwork {
    path: PathBuf,
    config: ClipConfig,
    image: ImageTower,
    text: TextTower,
    scale: f32,
    tokenizer: ClipTokenizer,
}

impl ClipNetwork {
    /// Loads the network of a `.safetensors` file: CLIP in the layouts of OpenCLIP and Hugging Face, or a Perception
    /// Encoder Core.
    ///
    /// # Errors
    /// [`ClipError`]: the file cannot be read, is not of such a network, or has sizes that are not supported.
    pub fn open(path: &Path) -> Result<Self, ClipError> {
        Self::load(&Checkpoint::open(path)?)
    }

    /// Loads the network of an open checkpoint, as [`Self::open`].
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn load(checkpoint: &Checkpoint) -> Result<Self, ClipError> {
        let path = checkpoint.path().to_owned();
        // Tensors of other files may share data, so that a small one could take all memory.
        if checkpoint.format() != Format::Safetensors {
            return Err(ClipError::NotSafetensors { path });
        }
        let config = ClipConfig::of(checkpoint)?;
        let reader = LayerReader { checkpoint, epsilon: EPSILON };
        let (image, text) = (ImageTower::load(reader, &config)?, TextTower::load(reader, &config)?);
        let scale = match checkpoint.info("logit_scale") {
            Some(_) => reader.tensor("logit_scale", &[])?[0].exp(),
            None => USUAL_SCALE,
        };
        let scale = if scale.is_finite() { scale.clamp(1.0, MAX_SCALE) } else { USUAL_SCALE };
        Ok(Self { path, config, image, text, scale, tokenizer: ClipTokenizer::built_in() })
    }

    /// The sizes of the network.
    pub const fn config(&self) -> &ClipConfig {
        &self.config
    }

    /// The factor by which similarities are multiplied before a softmax, as in training; 1 to 200.
    pub const fn scale(&self) -> f32 {
        self.scale
    }

    /// The file that the network was loaded from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Embeds images: one vector of length 1 for each. Results do not depend on the number of threads, nor on the other
    /// images.
    ///
    /// # Errors
    /// [`ClipError::Size`] if an image does not have the network's size, [`ClipError::NotFinite`].
    pub fn embed_images(&self, images: &[CowImage<'_, [u8; 3]>]) -> Result<Vec<Vec<f32>>, ClipError> {
        self.images(images, Pace::AtOnce)
    }

    /// [`Self::embed_images`] in steps, with the same results.
    ///
    /// # Errors
    /// As [`Self::embed_images`].
    pub fn embed_images_in_steps(
        &self,
        images: &[CowImage<'_, [u8; 3]>],
        pacer: &dyn Pacer,
    ) -> Result<Vec<Vec<f32>>, ClipError> {
        self.images(images, Pace::InSteps(pacer))
    }

    fn images(&self, images: &[CowImage<'_, [u8; 3]>], pace: Pace<'_>) -> Result<Vec<Vec<f32>>, ClipError> {
        let side = self.config.image_size;
        if let Some(other) = images.iter().find(|image| image.size() != (side, side)) {
            return Err(ClipError::Size {
                path: self.path.clone(),
                what: "an image for this network".to_owned(),
                found: format!("{} x {} pixels", other.width(), other.height()),
                expected: format!("{side} x {side}"),
            });
        }
        let mut embeddings = Vec::with_capacity(images.len());
        for images in images.chunks(pace.together(IMAGES_AT_ONCE, IMAGES_IN_STEPS)) {
            embeddings.extend(self.normalised(&self.image.forward(images, &self.config, pace), "an image")?);
        }
        Ok(embeddings)
    }

    /// Embeds texts: one vector of length 1 for each. Long texts are cut to the context.
    ///
    /// # Errors
    /// [`ClipError::NotFinite`].
    pub fn embed_texts<T: AsRef<str>>(&self, texts: &[T]) -> Result<Vec<Vec<f32>>, ClipError> {
        self.texts(texts, Pace::AtOnce)
    }

    /// [`Self::embed_texts`] in steps, with the same results.
    ///
    /// # Errors
    /// As [`Self::embed_texts`].
    pub fn embed_texts_in_steps<T: AsRef<str>>(
        &self,
        texts: &[T],
        pacer: &dyn Pacer,
    ) -> Result<Vec<Vec<f32>>, ClipError> {
        self.texts(texts, Pace::InSteps(pacer))
    }

    fn texts<T: AsRef<str>>(&self, texts: &[T], pace: Pace<'_>) -> Result<Vec<Vec<f32>>, ClipError> {
        let mut embeddings = Vec::with_capacity(texts.len());
        for texts in texts.chunks(pace.together(TEXTS_AT_ONCE, TEXTS_IN_STEPS)) {
            let tokens = |text: &T| self.tokenizer.tokens(text.as_ref(), self.config.context);
            let tokens: Vec<Vec<u32>> = texts.iter().map(tokens).collect();
            embeddings.extend(self.normalised(&self.text.forward(&tokens, pace), "a text")?);
        }
        Ok(embeddings)
    }

    /// Vectors of length 1.
    fn normalised(&self, rows: &[f32], of: &'static str) -> Result<Vec<Vec<f32>>, ClipError> {
        rows.chunks_exact(self.config.embedding)
            .map(|row| {
                let squares: f64 = row.iter().map(|value| f64::from(*value) * f64::from(*value)).sum();
                let length = squares.sqrt();
                if !(length.is_finite() && length > 0.0) {
                    return Err(ClipError::NotFinite { path: self.path.clone(), of });
                }
                Ok(row.iter().map(|value| (f64::from(*value) / length) as f32).collect())
            })
            .collect()
    }
}
