//! The prompt encoder: points, boxes (as two points) and masks to embeddings (official `prompt_encoder.py`).

use crate::sam2::Sam2Error;
use crate::sam2::encoder::position_encoding::random_fourier;
use crate::sam2::layers::{ConvShape, Halving, Linear};
use crate::sam2::weights::WeightReader;
use crate::transfer::upload;
use burn::tensor::{Device, Tensor};

/// Channels inside the mask encoder.
const MASK_CHANNELS: usize = 16;
/// ε of the channel normalisation of maps.
const EPSILON: f64 = 1e-6;

/// The meaning of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PointLabel {
    /// The point is not on the object.
    Negative,
    /// The point is on the object.
    Positive,
    /// The upper left corner of a box around the object.
    BoxStart,
    /// The lower right corner of a box around the object.
    BoxEnd,
}

/// A point in pixels of the network input; pixel centres are at integers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct InputPoint {
    pub x: f32,
    pub y: f32,
    /// `None` for a padding point.
    pub label: Option<PointLabel>,
}

impl InputPoint {
    /// The padding point, which ends every list and represents "no points".
    pub const NONE: Self = Self { x: 0.0, y: 0.0, label: None };
}

/// The prompt encoder.
#[derive(Clone, Debug)]
pub(crate) struct PromptEncoder {
    /// `[2, hidden / 2]`.
    gaussian: Vec<f32>,
    /// By label: negative, positive, box start, box end.
    point_embeddings: [Vec<f32>; 4],
    not_a_point: Vec<f32>,
    mask: MaskEncoder,
    /// `[1, 1, hidden]`.
    no_mask: Tensor<3>,
    hidden_dim: usize,
    image_size: usize,
    device: Device,
}

/// Encodes mask logits as an embedding at the feature map's size.
#[derive(Clone, Debug)]
struct MaskEncoder {
    halvings: [Halving; 2],
    project: Linear,
}

impl PromptEncoder {
    pub fn load(reader: &WeightReader, hidden_dim: usize, image_size: usize) -> Result<Self, Sam2Error> {
        let embedding = |name: &str| reader.floats(&format!("{name}.weight"), &[1, hidden_dim]);
        let mask = reader.child("mask_downscaling");
        let halve = |inputs, outputs| ConvShape { inputs, outputs, kernel: 2, stride: 2, padding: 0, groups: 1 };
        Ok(Self {
            gaussian: reader.child("pe_layer").floats("positional_encoding_gaussian_matrix", &[2, hidden_dim / 2])?,
            point_embeddings: [
                embedding("point_embeddings.0")?,
                embedding("point_embeddings.1")?,
                embedding("point_embeddings.2")?,
                embedding("point_embeddings.3")?,
            ],
            not_a_point: embedding("not_a_point_embed")?,
            mask: MaskEncoder {
                halvings: [
                    Halving::load(&mask, 0, halve(1, MASK_CHANNELS / 4), EPSILON)?,
                    Halving::load(&mask, 3, halve(MASK_CHANNELS / 4, MASK_CHANNELS), EPSILON)?,
                ],
                project: Linear::load_pointwise(&mask.child("6"), MASK_CHANNELS, hidden_dim)?,
            },
            no_mask: reader.tensor("no_mask_embed.weight", [1, hidden_dim])?.unsqueeze(),
            hidden_dim,
            image_size,
            device: reader.device().clone(),
        })
    }

    /// Position encoding of the feature map, `[1, side · side, hidden]`.
    pub fn dense_position_encoding(&self, side: usize) -> Tensor<3> {
        let centre = |index: usize| (index as f32 + 0.5) / side as f32;
        let encoded: Vec<f32> = (0..side * side)
            .flat_map(|token| random_fourier(centre(token % side), centre(token / side), &self.gaussian))
            .collect();
        upload(encoded, [1, side * side, self.hidden_dim], &self.device)
    }

    /// Embeds points: one list per object, all of the same length, to `[objects, points, hidden]`. Callers must end
    /// every list with [`InputPoint::NONE`], as in training.
    pub fn embed_points(&self, objects: &[Vec<InputPoint>]) -> Tensor<3> {
        let points = objects.first().map_or(0, Vec::len);
        let embedded: Vec<f32> = objects.iter().flatten().flat_map(|point| self.embed_point(*point)).collect();
        upload(embedded, [objects.len(), points, self.hidden_dim], &self.device)
    }

    fn embed_point(&self, point: InputPoint) -> Vec<f32> {
        let Some(label) = point.label else { return self.not_a_point.clone() };
        let unit = |value: f32| (value + 0.5) / self.image_size as f32;
        let mut embedded = random_fourier(unit(point.x), unit(point.y), &self.gaussian);
        embedded.iter_mut().zip(&self.point_embeddings[label as usize]).for_each(|(value, add)| *value += add);
        embedded
    }

    /// Embeds mask logits, `[objects, 4 side, 4 side]` to `[objects, side · side, hidden]`.
    pub fn embed_masks(&self, logits: Tensor<3>) -> Tensor<3> {
        let [objects, height, width] = logits.dims();
        let map = logits.reshape([objects, height, width, 1]);
        let map = self.mask.halvings.iter().fold(map, |map, halving| halving.forward(map));
        self.mask.project.forward(map).reshape([objects, height / 4 * (width / 4), self.hidden_dim])
    }

    /// The embedding of "no mask", `[1, 1, hidden]`.
    pub fn no_mask(&self) -> Tensor<3> {
        self.no_mask.clone()
    }
}
