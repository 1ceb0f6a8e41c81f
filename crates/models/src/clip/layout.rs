//! Recognises the layout of a CLIP checkpoint: what its tensors are called.

use crate::checkpoint::Checkpoint;
use crate::transformer::{BlockNames, QueryKeyValue};

/// Who named the tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClipLayout {
    /// OpenCLIP and OpenAI: `visual.conv1.weight`, `transformer.resblocks.…`.
    OpenClip,
    /// Hugging Face: `vision_model.…`, `text_model.…`.
    HuggingFace,
    /// A Perception Encoder Core in OpenCLIP: `visual.trunk.…` as in timm, `text.…`.
    PerceptionEncoder,
}

impl ClipLayout {
    /// The layout of a checkpoint; `None` if it is not of a CLIP network.
    pub fn of(checkpoint: &Checkpoint) -> Option<Self> {
        let has = |name: &str| checkpoint.info(name).is_some();
        if has("vision_model.embeddings.patch_embedding.weight") && has("text_model.embeddings.token_embedding.weight")
        {
            Some(Self::HuggingFace)
        } else if has("visual.trunk.patch_embed.proj.weight")
            && has("visual.trunk.attn_pool.latent")
            && has("text.token_embedding.weight")
        {
            Some(Self::PerceptionEncoder)
        } else if has("visual.conv1.weight")
            && (has("token_embedding.weight") || has("text.token_embedding.weight"))
            && has("visual.proj")
        {
            Some(Self::OpenClip)
        } else {
            None
        }
    }

    /// The network's usual name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::OpenClip => "CLIP of OpenCLIP",
            Self::HuggingFace => "CLIP of Hugging Face",
            Self::PerceptionEncoder => "Perception Encoder Core",
        }
    }

    /// Prefix of the names of the text tower.
    pub(super) fn text_prefix(self, checkpoint: &Checkpoint) -> &'static str {
        match self {
            Self::HuggingFace => "text_model.",
            Self::OpenClip if checkpoint.info("token_embedding.weight").is_some() => "",
            Self::OpenClip | Self::PerceptionEncoder => "text.",
        }
    }
}

/// Blocks of torch's `MultiheadAttention` (OpenAI, OpenCLIP).
pub(super) fn open_clip_blocks(prefix: &str) -> BlockNames {
    BlockNames {
        blocks: format!("{prefix}transformer.resblocks."),
        norms: ["ln_1", "ln_2"],
        query_key_value: QueryKeyValue::Fused("attn.in_proj_weight", "attn.in_proj_bias"),
        output: "attn.out_proj",
        mlp: ["mlp.c_fc", "mlp.c_proj"],
        layer_scales: None,
    }
}

/// Blocks of Hugging Face's `CLIPEncoder`.
pub(super) fn hugging_face_blocks(prefix: &str) -> BlockNames {
    BlockNames {
        blocks: format!("{prefix}encoder.layers."),
        norms: ["layer_norm1", "layer_norm2"],
        query_key_value: QueryKeyValue::Separate(["self_attn.q_proj", "self_attn.k_proj", "self_attn.v_proj"]),
        output: "self_attn.out_proj",
        mlp: ["mlp.fc1", "mlp.fc2"],
        layer_scales: None,
    }
}

/// Blocks of timm's `Eva`.
pub(super) fn timm_blocks(prefix: &str) -> BlockNames {
    BlockNames {
        blocks: format!("{prefix}blocks."),
        norms: ["norm1", "norm2"],
        query_key_value: QueryKeyValue::Fused("attn.qkv.weight", "attn.qkv.bias"),
        output: "attn.proj",
        mlp: ["mlp.fc1", "mlp.fc2"],
        layer_scales: None,
    }
}
