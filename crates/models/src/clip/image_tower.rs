//! The image tower: a vision transformer with a token for the class.

use super::attention_pooling::AttentionPooling;
use super::layout::{self, ClipLayout};
use super::pacing::{Pace, part};
use super::{ClipConfig, ClipError, rotary};
use crate::transformer::{Block, BlockNames, LayerReader, Norm, full_attention, head_attention};
use splatseg_geometry::CowImage;
use splatseg_kernels::Instructions;
use splatseg_kernels::gemm::PackedLinear;

#[derive(Clone, Debug)]
pub(super) struct ImageTower {
    /// From patches `[patch, patch, 3]`.
    patches: PackedLinear,
    class: Vec<f32>,
    /// `[1 + patches, width]`.
    positions: Vec<f32>,
    norm_before: Norm,
    blocks: Vec<Block>,
    norm_after: Norm,
    pooling: Option<AttentionPooling>,
    projection: PackedLinear,
    /// Of a Perception Encoder.
    angles: Option<Vec<[f32; 2]>>,
}

/// Names of the parts of an image tower.
struct Names {
    patches: &'static str,
    class: &'static str,
    positions: &'static str,
    norms: [&'static str; 2],
    blocks: BlockNames,
}

impl Names {
    fn of(layout: ClipLayout) -> Self {
        match layout {
            ClipLayout::OpenClip => Self {
                patches: "visual.conv1",
                class: "visual.class_embedding",
                positions: "visual.positional_embedding",
                norms: ["visual.ln_pre", "visual.ln_post"],
                blocks: layout::open_clip_blocks("visual."),
            },
            ClipLayout::HuggingFace => Self {
                patches: "vision_model.embeddings.patch_embedding",
                class: "vision_model.embeddings.class_embedding",
                positions: "vision_model.embeddings.position_embedding.weight",
                // Misspelt in the original.
                norms: ["vision_model.pre_layrnorm", "vision_model.post_layernorm"],
                blocks: layout::hugging_face_blocks("vision_model."),
            },
            ClipLayout::PerceptionEncoder => Self {
                patches: "visual.trunk.patch_embed.proj",
                class: "visual.trunk.cls_token",
                positions: "visual.trunk.pos_embed",
                norms: ["visual.trunk.norm_pre", "visual.trunk.norm"],
                blocks: layout::timm_blocks("visual.trunk."),
            },
        }
    }
}

impl ImageTower {
    pub fn load(reader: LayerReader<'_>, config: &ClipConfig) -> Result<Self, ClipError> {
        let names = Names::of(config.layout);
        let (width, count) = (config.image.width, config.grid() * config.grid() + 1);
        let is_perception = config.layout == ClipLayout::PerceptionEncoder;
        let class: &[usize] = if is_perception { &[1, 1, width] } else { &[width] };
        let positions: &[usize] = if is_perception { &[1, count, width] } else { &[count, width] };
        let pooling = is_perception
            .then(|| AttentionPooling::load(reader, "visual.trunk.attn_pool.", width, config.pooling_heads))
            .transpose()?;
        let angles = is_perception.then(|| rotary::angles(config.grid(), width / config.image.heads));
        Ok(Self {
            patches: patch_layer(reader, names.patches, config)?,
            class: reader.tensor(names.class, class)?,
            positions: reader.tensor(names.positions, positions)?,
            norm_before: reader.norm(names.norms[0], width)?,
            blocks: reader.blocks(&names.blocks, &config.image)?,
            norm_after: reader.norm(names.norms[1], width)?,
            pooling,
            projection: projection(reader, config)?,
            angles,
        })
    }

    /// Images of the network's size to `[images, embedding]`, not normalised.
    pub fn forward(&self, images: &[CowImage<'_, [u8; 3]>], config: &ClipConfig, pace: Pace<'_>) -> Vec<f32> {
        let (width, count) = (self.class.len(), config.grid() * config.grid() + 1);
        let mut tokens = self.tokens(images, config, pace);
        self.norm_before.layer().apply_parallel(&mut tokens);
        let shape = [images.len() * count, width];
        for block in &self.blocks {
            let mut rows = pace.rows(shape, |range| block.query_key_value(part(&tokens, width, range)));
            if let Some(angles) = &self.angles {
                pace.wait();
                rotary::turn(&mut rows, width, block.heads, angles);
            }
            let attended = attention(&rows, [count, width], block.heads, pace);
            tokens = pace
                .rows(shape, |range| block.finish(part(&tokens, width, range.clone()), part(&attended, width, range)));
        }
        pace.wait();
        let mut pooled = match &self.pooling {
            Some(pooling) => {
                self.norm_after.layer().apply_parallel(&mut tokens);
                pooling.forward(&tokens, count, pace)
            }
            None => tokens.chunks_exact(count * width).flat_map(|image| image[..width].iter().copied()).collect(),
        };
        if self.pooling.is_none() {
            self.norm_after.layer().apply(&mut pooled);
        }
        self.projection.forward(&pooled)
    }

    /// The class token and the patches of each image, with their positions: `[images, 1 + patches, width]`.
    fn tokens(&self, images: &[CowImage<'_, [u8; 3]>], config: &ClipConfig, pace: Pace<'_>) -> Vec<f32> {
        let width = self.class.len();
        pace.wait();
        let patches = patches_of(images, config);
        let inputs = self.patches.dims()[0];
        let count = images.len() * config.grid() * config.grid();
        let embedded = pace.rows([count, width], |range| self.patches.forward(part(&patches, inputs, range)));
        let per_image = config.grid() * config.grid() * width;
        let mut tokens = Vec::with_capacity(images.len() * (per_image + width));
        for image in embedded.chunks_exact(per_image) {
            let values = self.class.iter().chain(image);
            tokens.extend(values.zip(&self.positions).map(|(value, position)| value + position));
        }
        tokens
    }
}

/// Attention within each image, `[images, count, 3 · width]` to `[images, count, width]`; in steps, one head after the other.
fn attention(rows: &[f32], [count, width]: [usize; 2], heads: usize, pace: Pace<'_>) -> Vec<f32> {
    if matches!(pace, Pace::AtOnce) {
        return full_attention(rows, [count, width], heads);
    }
    let head_width = width / heads;
    let mut attended = vec![0.0; rows.len() / 3];
    for head in 0..heads {
        pace.wait();
        let values = head_attention(rows, [count, width], heads, head);
        for (row, values) in attended.chunks_exact_mut(width).zip(values.chunks_exact(head_width)) {
            row[head * head_width..][..head_width].copy_from_slice(values);
        }
    }
    attended
}

/// The normalised patches of all images, `[images · patches, patch, patch, 3]`.
fn patches_of(images: &[CowImage<'_, [u8; 3]>], config: &ClipConfig) -> Vec<f32> {
    let (patch, grid) = (config.patch, config.grid());
    let [mean, deviation] = config.normalisation;
    let mut values = Vec::with_capacity(images.len() * config.image_size * config.image_size * 3);
    for image in images {
        for at in 0..grid * grid {
            let (left, top) = (at % grid * patch, at / grid * patch);
            for row in top..top + patch {
                for pixel in &image.row(row)[left..left + patch] {
                    values.extend(
                        (0..3).map(|channel| (f32::from(pixel[channel]) / 255.0 - mean[channel]) / deviation[channel]),
                    );
                }
            }
        }
    }
    values
}

/// The convolution of the patches as a linear layer.
fn patch_layer(reader: LayerReader<'_>, name: &str, config: &ClipConfig) -> Result<PackedLinear, ClipError> {
    let (width, patch) = (config.image.width, config.patch);
    let area = patch * patch;
    let weight = reader.tensor(&format!("{name}.weight"), &[width, 3, patch, patch])?;
    let element = |index: usize| {
        let (pixel, channel, output) = (index / (3 * width), index / width % 3, index % width);
        weight[(output * 3 + channel) * area + pixel]
    };
    let patches: Vec<f32> = (0..weight.len()).map(element).collect();
    Ok(PackedLinear::new(&patches, &vec![0.0; width], Instructions::best()))
}

/// The last layer, from the width to the embedding.
fn projection(reader: LayerReader<'_>, config: &ClipConfig) -> Result<PackedLinear, ClipError> {
    let dims = [config.image.width, config.embedding];
    match config.layout {
        ClipLayout::OpenClip => open_clip_projection(reader, "visual.proj", dims),
        ClipLayout::HuggingFace => Ok(reader.linear_of("visual_projection.weight", None, dims)?),
        ClipLayout::PerceptionEncoder => Ok(reader.linear("visual.trunk.head", dims)?),
    }
}

/// A projection that is stored `[inputs, outputs]`, without a bias.
pub(super) fn open_clip_projection(
    reader: LayerReader<'_>,
    name: &str,
    [inputs, outputs]: [usize; 2],
) -> Result<PackedLinear, ClipError> {
    let weight = reader.tensor(name, &[inputs, outputs])?;
    Ok(PackedLinear::new(&weight, &vec![0.0; outputs], Instructions::best()))
}
