//! The image encoder, which runs once per frame: the trunk (Hiera, RepViT or a plain ViT), the feature pyramid, and
//! position encodings.

pub(crate) mod fpn_neck;
mod hiera;
mod image_encoder;
pub(crate) mod position_encoding;
pub(crate) mod repvit;
pub(crate) mod vit;

#[cfg(test)]
pub(crate) use image_encoder::{FineFeatures, Trunk};
pub(crate) use image_encoder::{ImageEncoder, ImageFeatures};
