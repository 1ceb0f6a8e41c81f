//! A Depth Anything network.

use super::decoder::Decoder;
use super::encoder::Encoder;
use super::planes::Planes;
use super::resize::{input, input_size};
use super::{DepthAnythingConfig, DepthAnythingError, DepthOutput};
use crate::checkpoint::Checkpoint;
use crate::transformer::LayerReader;
use splatseg_geometry::{CowImage, Image};
use std::path::{Path, PathBuf};

/// ε of every layer norm of DINOv2.
const EPSILON: f32 = 1e-6;

/// A Depth Anything V2 network on the CPU: Small, Base or Large, or one of other sizes with their structure.
#[derive(Clone, Debug)]
pub struct DepthAnythingNetwork {
    path: PathBuf,
    config: DepthAnythingConfig,
    encoder: Encoder,
    decoder: Decoder,
}

impl DepthAnythingNetwork {
    /// Loads the network of a file: the authors' `.pth`, or `.safetensors` of Hugging Face. `output` is what it returns;
    /// `None`: as the `config.json` beside it or its name says.
    ///
    /// # Errors
    /// [`DepthAnythingError`]: the file cannot be read, is not of such a network, or has sizes that are not supported.
    pub fn open(path: &Path, output: Option<DepthOutput>) -> Result<Self, DepthAnythingError> {
        Self::load(&Checkpoint::open(path)?, output)
    }

    /// Loads the network of an open checkpoint, as [`Self::open`].
    ///
    /// # Errors
    /// As [`Self::open`].
    pub fn load(checkpoint: &Checkpoint, output: Option<DepthOutput>) -> Result<Self, DepthAnythingError> {
        let config = DepthAnythingConfig::of(checkpoint, output)?;
        let reader = LayerReader { checkpoint, epsilon: EPSILON };
        let (encoder, decoder) = (Encoder::load(reader, &config)?, Decoder::load(reader, &config)?);
        Ok(Self { path: checkpoint.path().to_owned(), config, encoder, decoder })
    }

    /// The sizes of the network, and what it returns.
    pub const fn config(&self) -> &DepthAnythingConfig {
        &self.config
    }

    /// The file that the network was loaded from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The size `(width, height)` at which [`Self::predict`] processes an image of this size.
    pub fn input_size(&self, size: (usize, usize), short_side: usize) -> (usize, usize) {
        input_size(size, short_side, self.config.patch)
    }

    /// The network's output for an image, of the image's size: see [`DepthOutput`]. The image is processed with its
    /// short side resized to `short_side` pixels (rounded down to whole patches), and the result is enlarged to the image.
    /// Results do not depend on the number of threads.
    ///
    /// # Errors
    /// [`DepthAnythingError::NotFinite`]; [`DepthAnythingError::Size`] for an image without pixels.
    pub fn predict(&self, image: &CowImage<'_, [u8; 3]>, short_side: usize) -> Result<Image<f32>, DepthAnythingError> {
        let (image_width, image_height) = image.size();
        if image_width * image_height == 0 {
            return Err(DepthAnythingError::Size {
                path: self.path.clone(),
                what: "an image for this network".to_owned(),
                found: format!("{image_width} x {image_height} pixels"),
                expected: "at least one".to_owned(),
            });
        }
        let size = self.input_size(image.size(), short_side);
        let grid = [size.1, size.0].map(|side| side / self.config.patch);
        let tokens = self.encoder.forward(&input(image, size), grid, &self.config);
        let Planes { values, .. } =
            self.decoder.forward(&tokens, grid, &self.config).resized([image_height, image_width]);
        if values.iter().any(|value| !value.is_finite()) {
            return Err(DepthAnythingError::NotFinite { path: self.path.clone() });
        }
        Ok(Image::from_fn(image_width, image_height, |column, row| values[row * image_width + column]))
    }
}
