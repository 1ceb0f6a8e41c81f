//! EdgeTAM's perceiver: compresses the memory of a frame to a few tokens (Zhou et al. 2025, section 3.2; official
//! `perceiver.py`).
//!
//! Some tokens attend to the whole map. The others form a small square map; each attends to the part of the map that it
//! covers, so places are kept.

use crate::sam2::Sam2Error;
use crate::sam2::config::PerceiverConfig;
use crate::sam2::encoder::position_encoding::sine_2d;
use crate::sam2::layers::{Activation, LayerNorm, Linear, LinearWeights, forward_chain, multi_head};
use crate::sam2::weights::WeightReader;
use crate::transfer::upload;
use burn::tensor::Tensor;

const LAYERS: usize = 2;
const EPSILON: f64 = 1e-5;
/// Hidden channels of a feed-forward layer, per channel.
const FEED_FORWARD_RATIO: usize = 4;

/// The perceiver.
#[derive(Clone, Debug)]
pub(crate) struct Perceiver {
    /// Tokens that see the whole map, `[1, latents, memory]`.
    latents: Tensor<3>,
    /// Tokens of the small map, `[side · side, 1, memory]`.
    square_latents: Tensor<3>,
    layers: Vec<Layer>,
    norm: LayerNorm,
    /// Position encoding of the map, `[1, tokens, memory]`.
    position: Tensor<3>,
    /// Side of the small map.
    side: usize,
}

/// One layer (official `PerceiverEncoderLayer`): both kinds of tokens use the same weights.
#[derive(Clone, Debug)]
struct Layer {
    norm_map: LayerNorm,
    to_map: Attention,
    feed_forward: FeedForward,
    to_each_other: Attention,
    self_feed_forward: FeedForward,
}

/// Attention with one head; its projections have no bias.
#[derive(Clone, Debug)]
struct Attention {
    /// Of the tokens that attend.
    norm: LayerNorm,
    queries: Linear,
    keys: Linear,
    values: Linear,
    out: Linear,
}

#[derive(Clone, Debug)]
struct FeedForward {
    norm: LayerNorm,
    widen: Linear,
    narrow: Linear,
}

/// Loads a linear layer without bias, `[outputs, inputs]`.
fn unbiased(reader: &WeightReader, name: &str, inputs: usize, outputs: usize) -> Result<LinearWeights, Sam2Error> {
    LinearWeights::load_unbiased(&reader.child(name), inputs, outputs)
}

impl Attention {
    fn load(reader: &WeightReader, norm: &str, channels: usize) -> Result<Self, Sam2Error> {
        let device = reader.device();
        let [keys, values] = unbiased(reader, "to_kv", channels, 2 * channels)?.split();
        Ok(Self {
            norm: LayerNorm::load(&reader.child(norm), channels, EPSILON)?,
            queries: unbiased(reader, "to_q", channels, channels)?.on(device),
            keys: keys.on(device),
            values: values.on(device),
            out: unbiased(reader, "to_out", channels, channels)?.on(device),
        })
    }

    /// Tokens `[problems, n, channels]` attend to `others` `[problems, m, channels]`, of which keys and values have the
    /// positions `position` added, and add what they find.
    fn forward(&self, tokens: Tensor<3>, others: Tensor<3>, position: Option<&Tensor<3>>) -> Tensor<3> {
        let projected = |linear: &Linear| {
            let projected = linear.forward(others.clone());
            match position {
                Some(position) => projected + position.clone(),
                None => projected,
            }
        };
        let values = projected(&self.values);
        // There is nothing to choose from.
        if values.dims()[1] == 1 {
            return self.out.forward_added(values, tokens);
        }
        let queries = self.queries.forward_normed(&self.norm, tokens.clone());
        self.out.forward_added(multi_head(queries, projected(&self.keys), values, 1), tokens)
    }
}

impl FeedForward {
    fn load(reader: &WeightReader, channels: usize) -> Result<Self, Sam2Error> {
        let (device, hidden) = (reader.device(), FEED_FORWARD_RATIO * channels);
        Ok(Self {
            norm: LayerNorm::load(&reader.child("0"), channels, EPSILON)?,
            widen: unbiased(reader, "1", channels, hidden)?.on(device),
            narrow: unbiased(reader, "3", hidden, channels)?.on(device),
        })
    }

    fn forward(&self, tokens: Tensor<3>) -> Tensor<3> {
        let layers = [(&self.widen, Activation::Gelu), (&self.narrow, Activation::None)];
        forward_chain(Some(&self.norm), &layers, tokens.clone(), Some(tokens))
    }
}

impl Layer {
    fn load(reader: &WeightReader, channels: usize) -> Result<Self, Sam2Error> {
        Ok(Self {
            norm_map: LayerNorm::load(&reader.child("attn.norm_x"), channels, EPSILON)?,
            to_map: Attention::load(&reader.child("attn"), "norm_latents", channels)?,
            feed_forward: FeedForward::load(&reader.child("ff"), channels)?,
            to_each_other: Attention::load(&reader.child("self_attn"), "norm", channels)?,
            self_feed_forward: FeedForward::load(&reader.child("self_ff"), channels)?,
        })
    }

    /// Tokens `[problems, n, channels]` and what they see of the map, `[problems, m, channels]`.
    fn forward(&self, tokens: Tensor<3>, map: Tensor<3>, position: Option<&Tensor<3>>) -> Tensor<3> {
        let tokens = self.to_map.forward(tokens, self.norm_map.forward(map), position);
        let tokens = self.feed_forward.forward(tokens);
        let others = self.to_each_other.norm.forward(tokens.clone());
        self.self_feed_forward.forward(self.to_each_other.forward(tokens, others, None))
    }
}

impl Perceiver {
    /// Loads the perceiver for memories of `map_side` × `map_side` tokens with `channels` channels.
    pub fn load(
        reader: &WeightReader,
        shape: PerceiverConfig,
        channels: usize,
        map_side: usize,
    ) -> Result<Self, Sam2Error> {
        let PerceiverConfig { latents, side } = shape;
        let layer = |layer: usize| Layer::load(&reader.child(format!("layers.{layer}")), channels);
        Ok(Self {
            latents: reader.tensor::<2>("latents", [latents, channels])?.unsqueeze(),
            square_latents: reader.tensor::<2>("latents_2d", [side * side, channels])?.unsqueeze_dim(1),
            layers: (0..LAYERS).map(layer).collect::<Result<_, _>>()?,
            norm: LayerNorm::load(&reader.child("norm"), channels, EPSILON)?,
            position: upload(
                sine_2d(map_side, map_side, channels),
                [1, map_side * map_side, channels],
                reader.device(),
            ),
            side,
        })
    }

    /// Compresses memories `[objects, map tokens, memory]` to `[objects, latents + side · side, memory]`: first the
    /// tokens that have seen the whole map, then the small map.
    pub fn forward(&self, maps: Tensor<3>) -> Tensor<3> {
        let [objects, tokens, channels] = maps.dims();
        let [_, latents, _] = self.latents.dims();
        let mut all = self.latents.clone().expand([objects, latents, channels]);
        for layer in &self.layers {
            all = layer.forward(all, maps.clone(), Some(&self.position));
        }
        let (side, part) = (self.side, tokens.isqrt() / self.side);
        let parts = maps.reshape([objects, side, part, side, part, channels]).permute([0, 1, 3, 2, 4, 5]).reshape([
            objects * side * side,
            part * part,
            channels,
        ]);
        let mut square = self.square_latents.clone().repeat_dim(0, objects);
        for layer in &self.layers {
            square = layer.forward(square, parts.clone(), None);
        }
        let square = square.reshape([objects, side * side, channels]);
        self.norm.forward(Tensor::cat(vec![all, square], 1))
    }
}
