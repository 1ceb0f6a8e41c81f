//! Memory of objects, and attention to it. The memory encoder converts a frame and its mask to a memory. The memory
//! bank keeps the memories and object pointers that attention can still see. Memory attention conditions the next
//! frame's features on them.

mod assembly;
mod memory_attention;
mod memory_bank;
mod memory_encoder;
mod perceiver;
mod pooled_attention;
mod remembered;

pub(crate) use assembly::{AssembledMemory, Assembly};
#[cfg(test)]
pub(crate) use assembly::{DistantPointer, SpatialMemory};
pub(crate) use memory_attention::MemoryAttention;
pub(crate) use memory_bank::MemoryBank;
pub(crate) use memory_encoder::{MaskForMemory, MemoryEncoder};
pub(crate) use remembered::{RememberedMap, RememberedPointer};
