//! Arithmetic on plain slices, where Burn's operations would write large intermediate results to memory.

mod activation;
mod attention;
mod axial_attention;
mod axial_scores;
mod pooling;
mod rotary;
mod softmax;
mod windows;

pub(super) use activation::apply_to_all;
pub(super) use attention::{HeadRows, multi_head_attention};
pub(super) use axial_attention::{AxialKeys, RememberedMaps};
pub(super) use pooling::max_pool;
pub(super) use rotary::rotate;
pub(super) use windows::{WindowShape, window_attention};
