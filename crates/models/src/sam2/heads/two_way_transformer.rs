//! The mask decoder's transformer: tokens and image attend to each other (official `sam/transformer.py`).

use crate::sam2::Sam2Error;
use crate::sam2::layers::{Activation, LayerNorm, Linear, Mlp, multi_head};
use crate::sam2::weights::WeightReader;
use burn::tensor::Tensor;

const LAYERS: usize = 2;
const HEADS: usize = 8;
const MLP_DIM: usize = 2048;
/// Factor by which attention between tokens and image is narrower than the embeddings.
const DOWNSAMPLE: usize = 2;
const EPSILON: f64 = 1e-5;

/// Attention with projections before and after.
#[derive(Clone, Debug)]
struct Attention {
    queries: Linear,
    keys: Linear,
    values: Linear,
    out: Linear,
}

impl Attention {
    fn load(reader: &WeightReader, dim: usize, downsample: usize) -> Result<Self, Sam2Error> {
        let inner = dim / downsample;
        Ok(Self {
            queries: Linear::load(&reader.child("q_proj"), dim, inner)?,
            keys: Linear::load(&reader.child("k_proj"), dim, inner)?,
            values: Linear::load(&reader.child("v_proj"), dim, inner)?,
            out: Linear::load(&reader.child("out_proj"), inner, dim)?,
        })
    }

    /// `[objects, n, dim]`, `[objects, m, dim]`, `[objects, m, dim]` to `[objects, n, dim]`.
    fn forward(&self, queries: Tensor<3>, keys: Tensor<3>, values: Tensor<3>) -> Tensor<3> {
        let (queries, keys) = (self.queries.forward(queries), self.keys.forward(keys));
        self.out.forward(multi_head(queries, keys, self.values.forward(values), HEADS))
    }
}

/// One layer (official `TwoWayAttentionBlock`).
#[derive(Clone, Debug)]
struct Layer {
    self_attention: Attention,
    norm1: LayerNorm,
    token_to_image: Attention,
    norm2: LayerNorm,
    mlp: Mlp,
    norm3: LayerNorm,
    image_to_token: Attention,
    norm4: LayerNorm,
    /// True for the first layer, whose tokens are their own position encoding.
    first: bool,
}

impl Layer {
    fn load(reader: &WeightReader, dim: usize, first: bool) -> Result<Self, Sam2Error> {
        let norm = |name: &str| LayerNorm::load(&reader.child(name), dim, EPSILON);
        Ok(Self {
            self_attention: Attention::load(&reader.child("self_attn"), dim, 1)?,
            norm1: norm("norm1")?,
            token_to_image: Attention::load(&reader.child("cross_attn_token_to_image"), dim, DOWNSAMPLE)?,
            norm2: norm("norm2")?,
            mlp: Mlp::load(&reader.child("mlp"), &[dim, MLP_DIM, dim], Activation::Relu)?,
            norm3: norm("norm3")?,
            image_to_token: Attention::load(&reader.child("cross_attn_image_to_token"), dim, DOWNSAMPLE)?,
            norm4: norm("norm4")?,
            first,
        })
    }

    fn forward(
        &self,
        tokens: Tensor<3>,
        image: Tensor<3>,
        token_pe: &Tensor<3>,
        image_pe: &Tensor<3>,
    ) -> [Tensor<3>; 2] {
        let tokens = if self.first {
            self.self_attention.forward(tokens.clone(), tokens.clone(), tokens)
        } else {
            let placed = tokens.clone() + token_pe.clone();
            tokens.clone() + self.self_attention.forward(placed.clone(), placed, tokens)
        };
        let tokens = self.norm1.forward(tokens);

        let placed_image = image.clone() + image_pe.clone();
        let placed = tokens.clone() + token_pe.clone();
        let attended = self.token_to_image.forward(placed, placed_image.clone(), image.clone());
        let tokens = self.norm2.forward(tokens + attended);

        let tokens = self.norm3.forward(self.mlp.forward_residual(None, tokens));

        let placed = tokens.clone() + token_pe.clone();
        let attended = self.image_to_token.forward(placed_image, placed, tokens.clone());
        [tokens, self.norm4.forward(image + attended)]
    }
}

/// The transformer.
#[derive(Clone, Debug)]
pub(crate) struct TwoWayTransformer {
    layers: Vec<Layer>,
    final_attention: Attention,
    final_norm: LayerNorm,
}

impl TwoWayTransformer {
    pub fn load(reader: &WeightReader, dim: usize) -> Result<Self, Sam2Error> {
        let layers = (0..LAYERS)
            .map(|layer| Layer::load(&reader.child(format!("layers.{layer}")), dim, layer == 0))
            .collect::<Result<_, _>>()?;
        Ok(Self {
            layers,
            final_attention: Attention::load(&reader.child("final_attn_token_to_image"), dim, DOWNSAMPLE)?,
            final_norm: LayerNorm::load(&reader.child("norm_final_attn"), dim, EPSILON)?,
        })
    }

    /// Maps tokens `[objects, n, dim]` and image `[objects, m, dim]`, with the image's position encoding `[1, m, dim]`,
    /// to tokens and image of the same shapes.
    pub fn forward(&self, image: Tensor<3>, image_pe: &Tensor<3>, tokens: Tensor<3>) -> [Tensor<3>; 2] {
        let token_pe = tokens.clone();
        let [mut tokens, mut image] = [tokens, image];
        for layer in &self.layers {
            [tokens, image] = layer.forward(tokens, image, &token_pe, image_pe);
        }
        let placed_image = image.clone() + image_pe.clone();
        let attended = self.final_attention.forward(tokens.clone() + token_pe, placed_image, image.clone());
        [self.final_norm.forward(tokens + attended), image]
    }
}
