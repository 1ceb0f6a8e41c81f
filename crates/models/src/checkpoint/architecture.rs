//! Recognises the network of a checkpoint.

use super::Checkpoint;
use crate::clip::ClipLayout;
use crate::depth_anything::DepthAnythingLayout;
use std::fmt;

/// A network, recognised by the names and shapes of its tensors.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Architecture {
    /// YOLOv8-seg. With one class, it is FastSAM.
    YoloV8Seg {
        /// `n`, `s`, `m`, `l` or `x`; `None` for another width or depth.
        scale: Option<char>,
        /// Channels after the first convolution.
        width: usize,
        /// Bottlenecks of the first C2f block.
        depth: usize,
        /// Number of classes.
        classes: usize,
    },
    /// SAM 2 or 2.1.
    Sam2 {
        /// `tiny`, `small`, `base_plus` or `large`; `None` for another size.
        size: Option<&'static str>,
        /// True if it has the additions of 2.1.
        is_2_1: bool,
        /// Channels of the first stage of the image encoder.
        width: usize,
        /// Blocks of the image encoder.
        blocks: usize,
    },
    /// EdgeTAM.
    EdgeTam {
        /// Channels of the first stage of the image encoder; 48 in the published one.
        width: usize,
    },
    /// EfficientTAM.
    EfficientTam {
        /// Channels of the image encoder: 384 in `efficienttam_s`, 192 in `efficienttam_ti`.
        width: usize,
    },
    /// A CLIP network: images and texts.
    Clip {
        /// Naming scheme of its tensors.
        layout: ClipLayout,
    },
    /// Depth Anything V2.
    DepthAnything {
        /// Naming scheme of its tensors.
        layout: DepthAnythingLayout,
        /// Channels of the encoder: 384 in Small, 768 in Base, 1024 in Large.
        width: usize,
    },
    /// Something else.
    Unknown,
}

impl Architecture {
    /// Recognises the network of a checkpoint.
    pub(super) fn from_checkpoint(checkpoint: &Checkpoint) -> Self {
        yolo_v8_seg(checkpoint)
            .or_else(|| descendant_of_sam2(checkpoint))
            .or_else(|| sam2(checkpoint))
            .or_else(|| ClipLayout::of(checkpoint).map(|layout| Architecture::Clip { layout }))
            .or_else(|| depth_anything(checkpoint))
            .unwrap_or(Self::Unknown)
    }
}

/// Length of the first axis of a tensor with `N` axes.
fn first_axis<const N: usize>(checkpoint: &Checkpoint, name: &str) -> Option<usize> {
    let shape: &[usize; N] = checkpoint.info(name)?.shape().try_into().ok()?;
    Some(shape[0])
}

/// Number of consecutive tensors `prefix.0.suffix`, `prefix.1.suffix`, …
fn count(checkpoint: &Checkpoint, prefix: &str, suffix: &str) -> usize {
    (0..).take_while(|index| checkpoint.info(&format!("{prefix}.{index}.{suffix}")).is_some()).count()
}

fn yolo_v8_seg(checkpoint: &Checkpoint) -> Option<Architecture> {
    // Module 22 is the head: boxes (cv2), classes (cv3), mask coefficients (cv4), prototypes.
    let width = first_axis::<4>(checkpoint, "model.0.conv.weight")?;
    let classes = first_axis::<4>(checkpoint, "model.22.cv3.0.2.weight")?;
    checkpoint.info("model.22.cv4.0.2.weight")?;
    checkpoint.info("model.22.proto.cv1.conv.weight")?;
    let depth = count(checkpoint, "model.2.m", "cv1.conv.weight");
    let scale = match (width, depth) {
        (16, 1) => Some('n'),
        (32, 1) => Some('s'),
        (48, 2) => Some('m'),
        (64, 3) => Some('l'),
        (80, 3) => Some('x'),
        _ => None,
    };
    Some(Architecture::YoloV8Seg { scale, width, depth, classes })
}

fn sam2(checkpoint: &Checkpoint) -> Option<Architecture> {
    let width = first_axis::<4>(checkpoint, "image_encoder.trunk.patch_embed.proj.weight")?;
    checkpoint.info("sam_mask_decoder.iou_token.weight")?;
    checkpoint.info("maskmem_tpos_enc")?;
    let is_2_1 = checkpoint.info("no_obj_embed_spatial").is_some();
    let blocks = count(checkpoint, "image_encoder.trunk.blocks", "norm1.weight");
    let size = match (width, blocks) {
        (96, 12) => Some("tiny"),
        (96, 16) => Some("small"),
        (112, 24) => Some("base_plus"),
        (144, 48) => Some("large"),
        _ => None,
    };
    Some(Architecture::Sam2 { size, is_2_1, width, blocks })
}

fn descendant_of_sam2(checkpoint: &Checkpoint) -> Option<Architecture> {
    checkpoint.info("maskmem_tpos_enc")?;
    if checkpoint.info("spatial_perceiver.latents").is_some() {
        let width =
            first_axis::<4>(checkpoint, "image_encoder.trunk.body.stages_0.blocks.0.token_mixer.conv.c.weight")?;
        return Some(Architecture::EdgeTam { width });
    }
    checkpoint.info("image_encoder.neck.convs.0.conv_1x1.weight")?;
    let width = first_axis::<4>(checkpoint, "image_encoder.trunk.patch_embed.proj.weight")?;
    Some(Architecture::EfficientTam { width })
}

fn depth_anything(checkpoint: &Checkpoint) -> Option<Architecture> {
    let layout = DepthAnythingLayout::of(checkpoint)?;
    let width = first_axis::<4>(checkpoint, layout.patches())?;
    Some(Architecture::DepthAnything { layout, width })
}

impl fmt::Display for Architecture {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::YoloV8Seg { scale, width, depth, classes } => {
                let name = scale.map_or_else(|| "YOLOv8-seg".to_owned(), |scale| format!("YOLOv8{scale}-seg"));
                match (classes, scale) {
                    (1, Some(scale)) => write!(formatter, "FastSAM-{scale} ({name} with 1 class)")?,
                    (1, None) => write!(formatter, "FastSAM ({name} with 1 class)")?,
                    _ => write!(formatter, "{name} with {classes} classes")?,
                }
                match scale {
                    Some(_) => Ok(()),
                    None => write!(formatter, " of no published scale: width {width}, depth {depth}"),
                }
            }
            Self::Sam2 { size, is_2_1, width, blocks } => {
                write!(formatter, "SAM 2{}", if *is_2_1 { ".1" } else { "" })?;
                match size {
                    Some(size) => write!(formatter, " {size}"),
                    None => write!(formatter, " of no published size: width {width}, {blocks} blocks"),
                }
            }
            Self::EdgeTam { width: 48 } => formatter.write_str("EdgeTAM"),
            Self::EdgeTam { width } => write!(formatter, "EdgeTAM of no published size: width {width}"),
            Self::EfficientTam { width: 384 } => formatter.write_str("EfficientTAM-S"),
            Self::EfficientTam { width: 192 } => formatter.write_str("EfficientTAM-Ti"),
            Self::EfficientTam { width } => write!(formatter, "EfficientTAM of no published size: width {width}"),
            Self::Clip { layout } => formatter.write_str(layout.name()),
            Self::DepthAnything { layout, width } => {
                let size = match width {
                    384 => "Small",
                    768 => "Base",
                    1024 => "Large",
                    1536 => "Giant",
                    _ => return write!(formatter, "{} of no published size: width {width}", layout.name()),
                };
                write!(formatter, "{}, {size}", layout.name())
            }
            Self::Unknown => formatter.write_str("unknown"),
        }
    }
}
