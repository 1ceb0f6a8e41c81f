//! Matrix products (GEMM): nearly all arithmetic of the networks.
//!
//! Both operands are first packed into *panels*. A panel holds one tile's rows of the left operand, or one tile's
//! columns of the right, with the inner dimension outermost. The microkernel then reads both panels sequentially and
//! keeps its tile in registers (Goto and van de Geijn, *Anatomy of high-performance matrix multiplication*, 2008). The
//! inner dimension is cut into blocks of [`DEPTH_BLOCK`], whose panels fit the first-level cache. The blocks and the
//! order within them are fixed, so a result does not depend on the number of threads.
//!
//! Linear layers pack their weights once, and read tokens in place (`row_product`).

mod linear;
mod microkernel;
mod packing;
mod row_product;

pub use linear::{LinearChain, PackedLinear};
pub use packing::{pack_columns, pack_rows};

/// Length of the inner dimension summed before a tile is stored to memory.
pub const DEPTH_BLOCK: usize = 256;
