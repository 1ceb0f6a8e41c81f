//! Configurations of SAM 2.1.

use super::{Sam2Error, Weights};

/// The published sizes, and a miniature for tests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Sam2Size {
    /// A random network of the same structure for tests.
    Mini,
    /// `sam2.1_hiera_tiny`: 39 M parameters.
    Tiny,
    /// `sam2.1_hiera_small`: 46 M parameters.
    Small,
    /// `sam2.1_hiera_base_plus`: 81 M parameters.
    BasePlus,
    /// `sam2.1_hiera_large`: 224 M parameters.
    Large,
}

/// Hyper-parameters of the trunk, Hiera (official `sam2/configs/sam2.1/*.yaml`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HieraConfig {
    /// Channels of the first stage; every later stage has twice as many.
    pub embed_dim: usize,
    /// Attention heads of the first stage; every later stage has twice as many.
    pub num_heads: usize,
    /// Number of blocks of each stage.
    pub stages: [usize; 4],
    /// Side of the attention windows of each stage, in tokens.
    pub window_sizes: [usize; 4],
    /// Indices of the blocks that attend to the whole map.
    pub global_blocks: [usize; 3],
    /// Side of the background position embedding, in tokens.
    pub pos_embed_size: usize,
}

/// Parameters that differ between the sizes of SAM 2.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sam2Config {
    /// The size.
    pub size: Sam2Size,
    /// The image encoder's trunk.
    pub trunk: HieraConfig,
    /// Channels of the feature maps, of prompts and of object pointers.
    pub hidden_dim: usize,
    /// Channels of the spatial memory.
    pub memory_dim: usize,
    /// Hidden channels of memory attention's feed-forward layers.
    pub memory_feed_forward_dim: usize,
    /// Published side of the square network input, in pixels.
    pub image_size: usize,
}

/// Number of layers of memory attention.
pub(super) const MEMORY_ATTENTION_LAYERS: usize = 4;
/// Official `num_maskmem`: besides the conditioning frames, attention sees up to one less than this of the frames just
/// before.
pub(super) const NUM_MASK_MEMORIES: usize = 7;
/// Official `max_obj_ptrs_in_encoder`: besides those of conditioning frames, attention sees the object pointers of up
/// to one less than this of the frames just before.
pub(super) const MAX_OBJECT_POINTERS: usize = 16;
/// Pixels of the network input per token of the feature map that masks are decoded from.
pub(super) const FEATURE_STRIDE: usize = 16;
/// Logit for "no object here".
pub(super) const NO_OBJECT_LOGIT: f32 = -1024.0;

const fn trunk(
    embed_dim: usize,
    num_heads: usize,
    stages: [usize; 4],
    global_blocks: [usize; 3],
    pos_embed_size: usize,
) -> HieraConfig {
    HieraConfig { embed_dim, num_heads, stages, window_sizes: [8, 4, 14, 7], global_blocks, pos_embed_size }
}

const fn published(size: Sam2Size, trunk: HieraConfig) -> Sam2Config {
    Sam2Config { size, trunk, hidden_dim: 256, memory_dim: 64, memory_feed_forward_dim: 2048, image_size: 1024 }
}

impl Sam2Config {
    /// All sizes.
    pub const ALL: [Self; 5] = [
        Self {
            size: Sam2Size::Mini,
            // The miniature has two global blocks.
            trunk: trunk(16, 2, [1, 2, 4, 2], [4, 6, 6], 14),
            hidden_dim: 64,
            memory_dim: 16,
            memory_feed_forward_dim: 128,
            image_size: 256,
        },
        published(Sam2Size::Tiny, trunk(96, 1, [1, 2, 7, 2], [5, 7, 9], 7)),
        published(Sam2Size::Small, trunk(96, 1, [1, 2, 11, 2], [7, 10, 13], 7)),
        published(Sam2Size::BasePlus, trunk(112, 2, [2, 3, 16, 3], [12, 16, 20], 14)),
        published(
            Sam2Size::Large,
            HieraConfig { window_sizes: [8, 4, 16, 8], ..trunk(144, 2, [2, 6, 36, 4], [23, 33, 43], 7) },
        ),
    ];

    /// Recognises the configuration of a checkpoint by the names and shapes of its tensors.
    ///
    /// # Errors
    /// If the trunk's first embedding is missing, or no size has this number of blocks and channels.
    pub fn from_weights(weights: &dyn Weights) -> Result<Self, Sam2Error> {
        let name = "image_encoder.trunk.patch_embed.proj.bias";
        let shape = weights.shape(name).ok_or_else(|| Sam2Error::MissingTensor { name: name.into() })?;
        let embed_dim = shape.first().copied().unwrap_or(0);
        let is_block = |block: usize| weights.shape(&format!("image_encoder.trunk.blocks.{block}.norm1.weight"));
        let blocks = (0..).take_while(|block| is_block(*block).is_some()).count();
        Self::ALL
            .into_iter()
            .find(|config| config.trunk.embed_dim == embed_dim && config.trunk.stages.iter().sum::<usize>() == blocks)
            .ok_or(Sam2Error::UnknownConfiguration { blocks, embed_dim })
    }
}
