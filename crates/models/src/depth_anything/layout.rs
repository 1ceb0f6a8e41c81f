//! Recognises the layout of a Depth Anything checkpoint: what its tensors are called.

use crate::checkpoint::Checkpoint;
use crate::transformer::{BlockNames, QueryKeyValue};

/// Who named the tensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthAnythingLayout {
    /// The authors' code: `pretrained.…`, `depth_head.…`.
    Official,
    /// Hugging Face: `backbone.…`, `neck.…`, `head.…`.
    HuggingFace,
}

/// Names of the encoder's tensors besides its blocks.
pub(super) struct EncoderNames {
    pub class: &'static str,
    pub positions: &'static str,
    pub patches: &'static str,
    pub norm: &'static str,
}

/// Names of the layers of a fusion.
pub(super) struct FusionNames {
    /// Two layers of the unit for the stage's own features, and two of the unit for the sum.
    pub residuals: [[String; 2]; 2],
    pub projection: String,
}

impl DepthAnythingLayout {
    /// The layout of a checkpoint; `None` if it is not of a Depth Anything network.
    pub fn of(checkpoint: &Checkpoint) -> Option<Self> {
        let has = |name: &str| checkpoint.info(name).is_some();
        if has("pretrained.patch_embed.proj.weight") && has("depth_head.scratch.output_conv1.weight") {
            Some(Self::Official)
        } else if has("backbone.embeddings.patch_embeddings.projection.weight") && has("neck.convs.0.weight") {
            Some(Self::HuggingFace)
        } else {
            None
        }
    }

    /// Where the network is from.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Official => "Depth Anything V2",
            Self::HuggingFace => "Depth Anything V2 of Hugging Face",
        }
    }

    /// The authors' code enlarges position embeddings by a factor that is slightly larger than the ratio of the sizes: as
    /// if the image had this much more than its patches.
    pub(super) const fn position_offset(self) -> f64 {
        match self {
            Self::Official => 0.1,
            Self::HuggingFace => 0.0,
        }
    }

    /// The name of the weights of the patches, whose first axis is the encoder's width.
    pub(crate) fn patches(self) -> &'static str {
        match self {
            Self::Official => "pretrained.patch_embed.proj.weight",
            Self::HuggingFace => "backbone.embeddings.patch_embeddings.projection.weight",
        }
    }

    pub(super) fn encoder(self) -> EncoderNames {
        match self {
            Self::Official => EncoderNames {
                class: "pretrained.cls_token",
                positions: "pretrained.pos_embed",
                patches: "pretrained.patch_embed.proj",
                norm: "pretrained.norm",
            },
            Self::HuggingFace => EncoderNames {
                class: "backbone.embeddings.cls_token",
                positions: "backbone.embeddings.position_embeddings",
                patches: "backbone.embeddings.patch_embeddings.projection",
                norm: "backbone.layernorm",
            },
        }
    }

    pub(super) fn blocks(self, checkpoint: &Checkpoint) -> BlockNames {
        let mlp = ["mlp.fc1", "mlp.fc2"];
        match self {
            Self::Official => BlockNames {
                blocks: "pretrained.blocks.".to_owned(),
                norms: ["norm1", "norm2"],
                query_key_value: QueryKeyValue::Fused("attn.qkv.weight", "attn.qkv.bias"),
                output: "attn.proj",
                mlp,
                layer_scales: Some(["ls1.gamma", "ls2.gamma"]),
            },
            Self::HuggingFace => {
                // Published files have the first names; Transformers 5 has others in memory.
                let is_published =
                    checkpoint.info("backbone.encoder.layer.0.attention.attention.query.weight").is_some();
                let (layers, output) = if is_published {
                    (
                        ["attention.attention.query", "attention.attention.key", "attention.attention.value"],
                        "attention.output.dense",
                    )
                } else {
                    (["attention.q_proj", "attention.k_proj", "attention.v_proj"], "attention.o_proj")
                };
                BlockNames {
                    blocks: "backbone.encoder.layer.".to_owned(),
                    norms: ["norm1", "norm2"],
                    query_key_value: QueryKeyValue::Separate(layers),
                    output,
                    mlp,
                    layer_scales: Some(["layer_scale1.lambda1", "layer_scale2.lambda1"]),
                }
            }
        }
    }

    /// From tokens to the channels of stage 0 to 3.
    pub(super) fn projection(self, stage: usize) -> String {
        match self {
            Self::Official => format!("depth_head.projects.{stage}"),
            Self::HuggingFace => format!("neck.reassemble_stage.layers.{stage}.projection"),
        }
    }

    /// The change of size of stage 0, 1 and 3.
    pub(super) fn resize(self, stage: usize) -> String {
        match self {
            Self::Official => format!("depth_head.resize_layers.{stage}"),
            Self::HuggingFace => format!("neck.reassemble_stage.layers.{stage}.resize"),
        }
    }

    /// From the channels of a stage to those that all have.
    pub(super) fn features(self, stage: usize) -> String {
        match self {
            Self::Official => format!("depth_head.scratch.layer{}_rn", stage + 1),
            Self::HuggingFace => format!("neck.convs.{stage}"),
        }
    }

    /// The fusion of a stage with what comes from the coarser ones.
    pub(super) fn fusion(self, stage: usize) -> FusionNames {
        let (prefix, units, layers, projection) = match self {
            Self::Official => (
                format!("depth_head.scratch.refinenet{}", stage + 1),
                ["resConfUnit1", "resConfUnit2"],
                ["conv1", "conv2"],
                "out_conv",
            ),
            // Counted from the coarsest.
            Self::HuggingFace => (
                format!("neck.fusion_stage.layers.{}", 3 - stage),
                ["residual_layer1", "residual_layer2"],
                ["convolution1", "convolution2"],
                "projection",
            ),
        };
        let residuals = units.map(|unit| layers.map(|layer| format!("{prefix}.{unit}.{layer}")));
        FusionNames { residuals, projection: format!("{prefix}.{projection}") }
    }

    /// The last three layers.
    pub(super) const fn head(self) -> [&'static str; 3] {
        match self {
            Self::Official => [
                "depth_head.scratch.output_conv1",
                "depth_head.scratch.output_conv2.0",
                "depth_head.scratch.output_conv2.2",
            ],
            Self::HuggingFace => ["head.conv1", "head.conv2", "head.conv3"],
        }
    }
}
