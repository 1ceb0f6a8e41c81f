//! Names of the tensors of a transformer.

use crate::checkpoint::Checkpoint;

/// Names of the tensors of a block of a transformer.
pub(crate) struct BlockNames {
    /// Prefix of all blocks, to which the number is appended.
    pub blocks: String,
    pub norms: [&'static str; 2],
    pub query_key_value: QueryKeyValue,
    pub output: &'static str,
    pub mlp: [&'static str; 2],
    /// Factors of the channels that attention and the linear layers add to their input, if there are any.
    pub layer_scales: Option<[&'static str; 2]>,
}

/// How queries, keys and values are stored.
#[derive(Clone, Copy)]
pub(crate) enum QueryKeyValue {
    /// One matrix and one bias, by their full names.
    Fused(&'static str, &'static str),
    /// Three layers.
    Separate([&'static str; 3]),
}

impl BlockNames {
    /// Number of blocks in a checkpoint: the largest number in a name, plus 1. A block that lacks a tensor counts too, so
    /// that it is missed when the blocks are read.
    pub fn count(&self, checkpoint: &Checkpoint) -> usize {
        let number = |name: &str| name.strip_prefix(self.blocks.as_str())?.split('.').next()?.parse::<usize>().ok();
        let numbers = checkpoint.tensors().filter_map(|tensor| number(tensor.name()));
        numbers.max().map_or(0, |last| last.saturating_add(1))
    }
}
