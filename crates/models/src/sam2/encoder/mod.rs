//! The image encoder, which runs once per frame: the trunk (Hiera or RepViT), the
//! feature pyramid, and position encodings.

pub(crate) mod fpn_neck;
mod hiera;
mod image_encoder;
pub(crate) mod position_encoding;
pub(crate) mod repvit;

#[cfg(test)]
pub(crate) use image_encoder::Trunk;
pub(crate) use image_encoder::{ImageEncoder, ImageFeatures};
