//! The image encoder's trunk, Hiera (Ryali et al. 2023; official `hieradet.py`).

use super::position_encoding::windowed_embedding;
use crate::device::is_cpu;
use crate::sam2::layers::host::{HostValues, from_host};
use crate::sam2::layers::{Activation, Conv2d, ConvShape, LayerNorm, Linear, Mlp, multi_head};
use crate::sam2::weights::WeightReader;
use crate::sam2::{HieraConfig, Sam2Error};
use crate::transfer::upload;
use burn::tensor::Tensor;
use splatseg_kernels::attention::{HeadRows, WindowShape, max_pool, multi_head_attention, window_attention};

/// ε of the channel normalisation in the trunk.
const EPSILON: f64 = 1e-6;
/// Hidden channels of a block's feed-forward layer, per channel.
const MLP_RATIO: usize = 4;

/// The trunk.
#[derive(Clone, Debug)]
pub(crate) struct Hiera {
    patch_embed: Conv2d,
    /// `[side, side, channels]`.
    pos_embed: Tensor<3>,
    blocks: Vec<Block>,
    /// Index of the last block of each stage.
    stage_ends: [usize; 4],
}

impl Hiera {
    /// Loads the trunk for a square input with a side of `image_size` pixels.
    pub fn load(reader: &WeightReader, config: &HieraConfig, image_size: usize) -> Result<Self, Sam2Error> {
        let channels = config.embed_dim;
        let patch = ConvShape { inputs: 3, outputs: channels, kernel: 7, stride: 4, padding: 3, groups: 1 };
        let patch_embed = Conv2d::load(&reader.child("patch_embed.proj"), patch)?;
        let size = config.pos_embed_size;
        let tile = config.window_sizes[0];
        let background = reader.floats("pos_embed", &[1, channels, size, size])?;
        let window = reader.floats("pos_embed_window", &[1, channels, tile, tile])?;
        let side = image_size / 4;
        let pos_embed = windowed_embedding(&background, &window, channels, side);
        let pos_embed = upload(pos_embed, [side, side, channels], reader.device());

        let mut blocks = Vec::new();
        let mut stage_ends = [0; 4];
        for (stage, count) in config.stages.into_iter().enumerate() {
            for block in 0..count {
                let index = blocks.len();
                let enters_stage = stage > 0 && block == 0;
                // The first block of a stage still uses the previous stage's windows.
                let window = config.window_sizes[if enters_stage { stage - 1 } else { stage }];
                let shape = BlockShape {
                    inputs: channels << if enters_stage { stage - 1 } else { stage },
                    outputs: channels << stage,
                    heads: config.num_heads << stage,
                    window: (!config.global_blocks.contains(&index)).then_some(window),
                };
                blocks.push(Block::load(&reader.child(format!("blocks.{index}")), shape)?);
            }
            stage_ends[stage] = blocks.len() - 1;
        }
        Ok(Self { patch_embed, pos_embed, blocks, stage_ends })
    }

    /// Embeds the patches of a normalised image: `[1, 3, side, side]` to `[side / 4, side / 4, channels]`.
    pub fn embed_patches(&self, image: Tensor<4>) -> Tensor<3> {
        self.patch_embed.forward_planes(image).permute([0, 2, 3, 1]).squeeze_dim(0)
    }

    /// Returns the outputs of the four stages, finest first: from `[side / 4, side / 4, channels]` to
    /// `[side / 32, side / 32, 8 · channels]`. `observe` is called with every block's index and output.
    pub fn forward(&self, image: Tensor<4>, mut observe: impl FnMut(usize, &Tensor<3>)) -> [Tensor<3>; 4] {
        let mut map = self.embed_patches(image) + self.pos_embed.clone();
        let mut stages = Vec::with_capacity(4);
        for (index, block) in self.blocks.iter().enumerate() {
            map = block.forward(map);
            observe(index, &map);
            if self.stage_ends.contains(&index) {
                stages.push(map.clone());
            }
        }
        stages.try_into().unwrap_or_else(|_| unreachable!("there are four stages"))
    }

    #[cfg(test)]
    /// The position embedding, `[side / 4, side / 4, channels]`.
    pub fn pos_embed(&self) -> &Tensor<3> {
        &self.pos_embed
    }
}

/// The hyper-parameters of a [`Block`].
#[derive(Clone, Copy, Debug)]
pub(super) struct BlockShape {
    pub inputs: usize,
    pub outputs: usize,
    pub heads: usize,
    /// Side of the attention windows; `None` if the block attends to the whole map.
    pub window: Option<usize>,
}

/// One transformer block (official `MultiScaleBlock`). A block that increases the number of channels halves the map.
#[derive(Clone, Debug)]
pub(super) struct Block {
    shape: BlockShape,
    norm1: LayerNorm,
    qkv: Linear,
    /// The projection of an all-zero token, used to pad windows, `[1, 1, 3 · channels]`.
    padding: Tensor<3>,
    attention_out: Linear,
    norm2: LayerNorm,
    mlp: Mlp,
    /// Projection of the residual branch, if the number of channels changes.
    shortcut: Option<Linear>,
}

impl Block {
    pub fn load(reader: &WeightReader, shape: BlockShape) -> Result<Self, Sam2Error> {
        let BlockShape { inputs, outputs, .. } = shape;
        let shortcut = (inputs != outputs).then(|| Linear::load(&reader.child("proj"), inputs, outputs)).transpose()?;
        Ok(Self {
            shape,
            norm1: LayerNorm::load(&reader.child("norm1"), inputs, EPSILON)?,
            qkv: Linear::load(&reader.child("attn.qkv"), inputs, 3 * outputs)?,
            padding: reader.child("attn.qkv").tensor::<1>("bias", [3 * outputs])?.unsqueeze(),
            attention_out: Linear::load(&reader.child("attn.proj"), outputs, outputs)?,
            norm2: LayerNorm::load(&reader.child("norm2"), outputs, EPSILON)?,
            mlp: Mlp::load(&reader.child("mlp"), &[outputs, MLP_RATIO * outputs, outputs], Activation::Gelu)?,
            shortcut,
        })
    }

    pub fn forward(&self, map: Tensor<3>) -> Tensor<3> {
        let qkv = self.qkv.forward_normed(&self.norm1, map.clone());
        let shortcut = match &self.shortcut {
            None => map,
            Some(projection) => pool(projection.forward_normed(&self.norm1, map)),
        };
        let map = self.attention_out.forward_added(self.attend(qkv), shortcut);
        self.mlp.forward_residual(Some(&self.norm2), map)
    }

    /// Multi-head attention, `[height, width, 3 · channels]` to `[height, width, channels]`, or half the height and
    /// width if queries are pooled.
    fn attend(&self, qkv: Tensor<3>) -> Tensor<3> {
        let BlockShape { outputs: channels, heads, window, .. } = self.shape;
        let pooling = if self.shortcut.is_some() { 2 } else { 1 };
        if !is_cpu(&qkv.device()) {
            return match window {
                Some(window) => self.attend_in_windows(qkv, window, pooling),
                None => attend_everywhere(qkv, heads, pooling),
            };
        }
        let device = qkv.device();
        let [height, width, _] = qkv.dims();
        let data = HostValues::from_tensor(qkv);
        let qkv = data.as_slice();
        let pooled = (pooling == 2).then(|| max_pool(qkv, (height, width), 3 * channels, channels));
        let (queries, query_stride) = match &pooled {
            Some(pooled) => (pooled.as_slice(), channels),
            None => (qkv, 3 * channels),
        };
        let out = match window {
            Some(window) => {
                let shape = WindowShape { height, width, window, pooling, heads, channels, query_stride };
                window_attention(queries, qkv, HostValues::from_tensor(self.padding.clone()).as_slice(), shape)
            }
            None => {
                let rows = |data, stride, count| HeadRows { data, count, width: channels / heads, stride };
                let tokens = height * width;
                let queries = rows(queries, query_stride, tokens / (pooling * pooling));
                let keys = rows(&qkv[channels..], 3 * channels, tokens);
                let values = rows(&qkv[2 * channels..], 3 * channels, tokens);
                multi_head_attention(&[[queries, keys, values]], heads, None)
            }
        };
        from_host(out, [height / pooling, width / pooling, channels], &device)
    }

    /// [`Self::attend`] on a device, within windows. Windows beyond the right or lower border are padded.
    fn attend_in_windows(&self, qkv: Tensor<3>, window: usize, pooling: usize) -> Tensor<3> {
        let BlockShape { outputs: channels, heads, .. } = self.shape;
        let [height, width, _] = qkv.dims();
        let (rows, columns) = (height.div_ceil(window), width.div_ceil(window));
        let padded = |map: Tensor<3>, dimension: usize, tokens: usize| {
            let mut missing = map.dims();
            missing[dimension] = tokens - missing[dimension];
            if missing[dimension] == 0 {
                return map;
            }
            Tensor::cat(vec![map, self.padding.clone().expand(missing)], dimension)
        };
        let qkv = padded(padded(qkv, 0, rows * window), 1, columns * window);
        let [queries, keys, values] = [0, 1, 2].map(|part| {
            let part_of_all = qkv.clone().narrow(2, part * channels, channels);
            let (part, window) = match part {
                0 if pooling == 2 => (pool(part_of_all), window / 2),
                _ => (part_of_all, window),
            };
            part.reshape([rows, window, columns, window, channels]).swap_dims(1, 2).reshape([
                rows * columns,
                window * window,
                channels,
            ])
        });
        let side = window / pooling;
        multi_head(queries, keys, values, heads)
            .reshape([rows, columns, side, side, channels])
            .swap_dims(1, 2)
            .reshape([rows * side, columns * side, channels])
            .narrow(0, 0, height / pooling)
            .narrow(1, 0, width / pooling)
    }
}

/// [`Block::attend`] on a device, over the whole map.
fn attend_everywhere(qkv: Tensor<3>, heads: usize, pooling: usize) -> Tensor<3> {
    let [height, width, tripled] = qkv.dims();
    let channels = tripled / 3;
    let [queries, keys, values] = [0, 1, 2].map(|part| {
        let part_of_all = qkv.clone().narrow(2, part * channels, channels);
        let part = if part == 0 && pooling == 2 { pool(part_of_all) } else { part_of_all };
        part.flatten::<2>(0, 1).unsqueeze()
    });
    multi_head(queries, keys, values, heads).reshape([height / pooling, width / pooling, channels])
}

/// Max-pooling of 2×2 tokens.
fn pool(map: Tensor<3>) -> Tensor<3> {
    let device = map.device();
    let [height, width, channels] = map.dims();
    if !is_cpu(&device) {
        let blocks = map.reshape([height / 2, 2, width / 2, 2, channels]);
        return blocks.max_dim(3).max_dim(1).reshape([height / 2, width / 2, channels]);
    }
    let pooled = max_pool(HostValues::from_tensor(map).as_slice(), (height, width), channels, channels);
    from_host(pooled, [height / 2, width / 2, channels], &device)
}
