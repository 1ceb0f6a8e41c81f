//! Matrix products (GEMM), which nearly all arithmetic of the networks is.
//!
//! Both sides are first packed into *panels*: as many rows of the left side as a tile of the result has, as many columns
//! of the right side, with the inner dimension outermost. The microkernel then reads two streams from front to back and
//! keeps its tile in registers (Goto and van de Geijn, *Anatomy of high-performance matrix multiplication*, 2008). The
//! inner dimension is cut into blocks of [`DEPTH_BLOCK`], whose panels fit the first-level cache. The blocks and the order
//! within them are fixed, so a result does not depend on the number of threads.

mod linear;
mod microkernel;
mod packing;

pub use linear::{LinearChain, PackedLinear};
pub use packing::{pack_columns, pack_rows};

/// Length of the inner dimension that is summed up before a tile goes back to memory.
pub const DEPTH_BLOCK: usize = 256;
