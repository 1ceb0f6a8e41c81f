//! Configurations of SAM 2.1, and of EdgeTAM and EfficientTAM, which keep its interface at less work.

use super::weights::{count, first_axis};
use super::{Sam2Error, Weights};

/// The published networks, and a miniature for tests.
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
    /// `edgetam`: 14 M parameters.
    EdgeTam,
    /// `efficienttam_s` (34 M parameters) or `efficienttam_ti` (18 M), with any pooling of the memory.
    EfficientTam,
}

/// The image encoder's trunk.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TrunkConfig {
    /// The trunk of SAM 2.1.
    Hiera(HieraConfig),
    /// The trunk of EdgeTAM.
    RepVit(RepVitConfig),
    /// The trunk of EfficientTAM.
    Vit(VitConfig),
}

/// Hyper-parameters of EfficientTAM's trunk, a plain ViT (Xiong et al. 2024; official `vitdet.py`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VitConfig {
    /// Channels.
    pub embed_dim: usize,
    /// Attention heads, one for every 64 channels.
    pub num_heads: usize,
    /// Number of blocks. Every third attends to the whole map, the others within windows.
    pub blocks: usize,
    /// Side of the position embedding, in tokens.
    pub pos_embed_size: usize,
}

/// Hyper-parameters of EdgeTAM's trunk, RepViT (Wang et al. 2024; `repvit_m1` in timm).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RepVitConfig {
    /// Channels of each stage.
    pub channels: [usize; 4],
    /// Number of blocks of each stage, without the one that reduces the map.
    pub depths: [usize; 4],
}

/// Number of tokens to which EdgeTAM's perceiver compresses the memory of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PerceiverConfig {
    /// Tokens that see the whole map, and have no position.
    pub latents: usize,
    /// Side of the square of tokens that see a part of the map each.
    pub side: usize,
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

/// Parameters that differ between the networks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sam2Config {
    /// The size.
    pub size: Sam2Size,
    /// The image encoder's trunk.
    pub trunk: TrunkConfig,
    /// Channels of the feature maps, of prompts and of object pointers.
    pub hidden_dim: usize,
    /// Channels of the spatial memory.
    pub memory_dim: usize,
    /// Number of layers of memory attention.
    pub memory_attention_layers: usize,
    /// Hidden channels of memory attention's feed-forward layers.
    pub memory_feed_forward_dim: usize,
    /// The compression of memories; `None` if whole maps are remembered.
    pub perceiver: Option<PerceiverConfig>,
    /// True for SAM 2.1, whose memory tells when an object pointer was seen and where there was no object.
    pub has_memory_of_absence: bool,
    /// Published side of the square network input, in pixels.
    pub image_size: usize,
}

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
/// Tensors by which EdgeTAM's and EfficientTAM's encoders are recognised.
const FIRST_OF_REPVIT: &str = "image_encoder.trunk.body.stem.conv1.c.weight";
const FIRST_OF_VIT: &str = "image_encoder.neck.convs.0.conv_1x1.weight";
/// Channels of an attention head of EfficientTAM's trunk.
const VIT_HEAD: usize = 64;

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
    Sam2Config {
        size,
        trunk: TrunkConfig::Hiera(trunk),
        hidden_dim: 256,
        memory_dim: 64,
        memory_attention_layers: 4,
        memory_feed_forward_dim: 2048,
        perceiver: None,
        has_memory_of_absence: true,
        image_size: 1024,
    }
}

impl Sam2Config {
    /// All sizes of SAM 2.1.
    pub const ALL: [Self; 5] = [
        Self {
            size: Sam2Size::Mini,
            // The miniature has two global blocks.
            hidden_dim: 64,
            memory_dim: 16,
            memory_feed_forward_dim: 128,
            image_size: 256,
            ..published(Sam2Size::Mini, trunk(16, 2, [1, 2, 4, 2], [4, 6, 6], 14))
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
    /// If the trunk's first layer is missing, or no network has this number of blocks and channels.
    pub fn from_weights(weights: &dyn Weights) -> Result<Self, Sam2Error> {
        if weights.shape(FIRST_OF_REPVIT).is_some() {
            return Self::edge_tam(weights)?.checked();
        }
        if weights.shape(FIRST_OF_VIT).is_some() {
            return Self::efficient_tam(weights)?.checked();
        }
        let name = "image_encoder.trunk.patch_embed.proj.bias";
        let embed_dim = first_axis(weights, name).map_err(|_| Sam2Error::OtherNetwork)?;
        let blocks = count(|block| format!("image_encoder.trunk.blocks.{block}.norm1.weight"), weights);
        let is_found = |config: &Self| {
            let TrunkConfig::Hiera(trunk) = config.trunk else { return false };
            trunk.embed_dim == embed_dim && trunk.stages.iter().sum::<usize>() == blocks
        };
        Self::ALL.into_iter().find(is_found).ok_or(Sam2Error::UnknownConfiguration { blocks, embed_dim })
    }

    /// The side of the network input must be a multiple of this, in pixels.
    pub fn image_size_unit(&self) -> usize {
        match self.perceiver {
            None => 2 * FEATURE_STRIDE,
            // Whole parts of the map, and a whole stage at half of its resolution.
            Some(perceiver) if perceiver.side % 2 == 1 => 2 * perceiver.side * FEATURE_STRIDE,
            Some(perceiver) => perceiver.side * FEATURE_STRIDE,
        }
    }

    /// EdgeTAM, of the size that the tensors have.
    fn edge_tam(weights: &dyn Weights) -> Result<Self, Sam2Error> {
        let squared = first_axis(weights, "spatial_perceiver.latents_2d")?;
        let perceiver =
            PerceiverConfig { latents: first_axis(weights, "spatial_perceiver.latents")?, side: squared.isqrt() };
        if perceiver.side.pow(2) != squared {
            return Err(unusual(format!("spatial_perceiver.latents_2d has {squared} rows, expected a square number")));
        }
        let trunk = TrunkConfig::RepVit(RepVitConfig::from_weights(weights)?);
        Self::descendant(weights, Sam2Size::EdgeTam, trunk, Some(perceiver))
    }

    /// EfficientTAM, of the size that the tensors have.
    fn efficient_tam(weights: &dyn Weights) -> Result<Self, Sam2Error> {
        Self::descendant(weights, Sam2Size::EfficientTam, TrunkConfig::Vit(VitConfig::from_weights(weights)?), None)
    }

    fn descendant(
        weights: &dyn Weights,
        size: Sam2Size,
        trunk: TrunkConfig,
        perceiver: Option<PerceiverConfig>,
    ) -> Result<Self, Sam2Error> {
        Ok(Self {
            size,
            trunk,
            hidden_dim: first_axis(weights, "memory_attention.norm.bias")?,
            memory_dim: first_axis(weights, "memory_encoder.out_proj.bias")?,
            memory_attention_layers: count(|layer| format!("memory_attention.layers.{layer}.norm1.bias"), weights),
            memory_feed_forward_dim: first_axis(weights, "memory_attention.layers.0.linear1.bias")?,
            perceiver,
            has_memory_of_absence: false,
            image_size: 1024,
        })
    }

    /// Checks numbers that were read from a checkpoint.
    fn checked(self) -> Result<Self, Sam2Error> {
        let Self { hidden_dim, memory_dim, memory_attention_layers: layers, .. } = self;
        if hidden_dim == 0 || !hidden_dim.is_multiple_of(64) || memory_dim == 0 || !memory_dim.is_multiple_of(4) {
            return Err(unusual(format!("memory attention has {hidden_dim} channels, and memories have {memory_dim}")));
        }
        if !hidden_dim.is_multiple_of(memory_dim) || layers == 0 || self.memory_feed_forward_dim == 0 {
            return Err(unusual(format!(
                "memory attention has {layers} layers, {hidden_dim} channels, and memories of {memory_dim} channels"
            )));
        }
        let is_usual = match (self.trunk, self.perceiver) {
            (TrunkConfig::RepVit(trunk), Some(perceiver)) => {
                let has_channels = trunk.channels.iter().all(|channels| *channels > 0) && trunk.channels[0] % 2 == 0;
                has_channels && perceiver.latents > 0 && (1..=256).contains(&perceiver.side)
            }
            (TrunkConfig::Vit(trunk), _) => trunk.num_heads > 0 && trunk.blocks > 0 && trunk.pos_embed_size > 0,
            _ => true,
        };
        if is_usual { Ok(self) } else { Err(unusual("its image encoder has an empty layer".into())) }
    }
}

impl RepVitConfig {
    /// Reads channels and depths from the shapes of a checkpoint's tensors.
    fn from_weights(weights: &dyn Weights) -> Result<Self, Sam2Error> {
        let name = |stage: usize, block: usize| {
            format!("image_encoder.trunk.body.stages_{stage}.blocks.{block}.token_mixer.conv.c.weight")
        };
        let mut config = Self { channels: [0; 4], depths: [0; 4] };
        for stage in 0..4 {
            config.channels[stage] = first_axis(weights, &name(stage, 0))?;
            config.depths[stage] = count(|block| name(stage, block), weights);
        }
        Ok(config)
    }
}

impl VitConfig {
    /// Reads channels and depth from the shapes of a checkpoint's tensors.
    fn from_weights(weights: &dyn Weights) -> Result<Self, Sam2Error> {
        let embed_dim = first_axis(weights, "image_encoder.trunk.patch_embed.proj.bias")?;
        let positions = weights
            .shape("image_encoder.trunk.pos_embed")
            .ok_or_else(|| Sam2Error::MissingTensor { name: "image_encoder.trunk.pos_embed".into() })?;
        Ok(Self {
            embed_dim,
            num_heads: embed_dim / VIT_HEAD,
            blocks: count(|block| format!("image_encoder.trunk.blocks.{block}.norm1.weight"), weights),
            // One position is that of the class token of its training.
            pos_embed_size: positions.get(1).copied().unwrap_or(0).saturating_sub(1).isqrt(),
        })
    }
}

fn unusual(reason: String) -> Sam2Error {
    Sam2Error::UnusualShape { reason }
}
