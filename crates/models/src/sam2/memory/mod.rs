//! What is remembered of an object, and how a frame attends to it: the memory encoder turns a frame and its mask into a
//! memory, the memory bank keeps the memories and object pointers that attention can still see, and memory attention
//! conditions the features of the next frame on them.

mod assembly;
mod memory_attention;
mod memory_bank;
mod memory_encoder;
mod remembered;

pub(crate) use assembly::{AssembledMemory, Assembly};
#[cfg(test)]
pub(crate) use assembly::{DistantPointer, SpatialMemory};
pub(crate) use memory_attention::MemoryAttention;
pub(crate) use memory_bank::MemoryBank;
pub(crate) use memory_encoder::{MaskForMemory, MemoryEncoder};
pub(crate) use remembered::{RememberedMap, RememberedPointer};
