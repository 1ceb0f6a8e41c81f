//! CLIP networks: an image and a text become vectors whose cosine says how well they fit.
//!
//! | file | content |
//! | --- | --- |
//! | `layout.rs` | recognises a checkpoint by its names: OpenCLIP, Hugging Face, Perception Encoder |
//! | `config.rs` | the sizes of both towers, from the shapes and from a `config.json` beside the checkpoint |
//! | `image_tower.rs`, `attention_pooling.rs`, `rotary.rs` | image to vector |
//! | `text_tower.rs`, `causal_attention.rs`, `tokenizer.rs` | text to vector |
//! | `pacing.rs` | networks that rest between short steps |
//!
//! The blocks of both towers are those of `transformer/`.
//!
//! Radford et al. 2021; Bolya et al. 2025 for the Perception Encoder. All layers are loops of `splatseg-kernels` on the
//! CPU, so that a program without the feature `networks` has them too.

mod attention_pooling;
mod causal_attention;
mod config;
mod error;
mod image_tower;
mod layout;
mod network;
mod pacing;
mod rotary;
mod text_tower;
mod tokenizer;

pub use crate::transformer::TowerConfig;
pub use config::ClipConfig;
pub use error::ClipError;
pub use layout::ClipLayout;
pub use network::ClipNetwork;
pub use pacing::Pacer;
pub use tokenizer::{ClipTokenizer, TokenizerError};
