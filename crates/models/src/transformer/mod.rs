//! Vision and text transformers, as CLIP and Depth Anything have them. All layers are loops of `splatseg-kernels`.
//!
//! | file | content |
//! | --- | --- |
//! | `block.rs` | the blocks, and attention to all tokens |
//! | `block_names.rs` | what their tensors are called |
//! | `layer_reader.rs` | reads layers from a checkpoint |

mod block;
mod block_names;
mod layer_reader;

pub(crate) use block::{Block, Norm, full_attention, head_attention};
pub(crate) use block_names::{BlockNames, QueryKeyValue};
pub(crate) use layer_reader::{LayerReader, packed};

use splatseg_kernels::Activation;

/// Sizes of one transformer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TowerConfig {
    /// Channels.
    pub width: usize,
    /// Attention heads.
    pub heads: usize,
    /// Blocks.
    pub blocks: usize,
    /// Activation between the linear layers.
    pub activation: Activation,
}
