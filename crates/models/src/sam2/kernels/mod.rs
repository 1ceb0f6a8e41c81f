//! Arithmetic on plain slices, where Burn's operations would write large intermediate results to memory.

mod attention;
mod exponential;
mod matmul;
mod pooling;
mod rotary;
mod windows;

pub(super) use attention::{HeadRows, attention, multi_head_attention};
pub(super) use pooling::max_pool;
pub(super) use rotary::rotate;
pub(super) use windows::{WindowShape, window_attention};
