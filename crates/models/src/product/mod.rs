//! Matrix products on the CPU, which nearly all arithmetic of the networks is.
//!
//! Both sides are rearranged into *panels* first: of the left side as many rows as a tile of the result has, of the right
//! side as many columns, with the inner dimension outermost, so that the kernel reads two streams from front to back and
//! keeps its tile in registers (Goto and van de Geijn, *Anatomy of high-performance matrix multiplication*, 2008). The
//! inner dimension is cut into blocks of [`DEPTH_BLOCK`], whose panels fit the first-level cache. The blocks and the order
//! within them are fixed, so a result does not depend on the number of threads.

mod filled;
mod functions;
mod instructions;
mod linear;
mod normalisation;
mod panels;

pub(crate) use filled::filled;
pub(crate) use functions::{exp2, gelu, relu, silu};
pub(crate) use instructions::Instructions;
pub(crate) use linear::{Chain, PackedLinear};
pub(crate) use normalisation::Norm;
pub(crate) use panels::{pack_columns, pack_rows};

/// Most of the inner dimension that is summed up before a tile goes back to memory.
pub(crate) const DEPTH_BLOCK: usize = 256;
/// The columns of a tile are a multiple of this.
pub(crate) const LANES: usize = 16;

/// What follows a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activation {
    /// Nothing.
    None,
    /// max(x, 0).
    Relu,
    /// x · σ(x).
    Silu,
    /// x · Φ(x), exact.
    Gelu,
}

impl Activation {
    /// Replaces `values` by their activations. Fast where the caller runs within [`Instructions::vectorized`].
    #[inline(always)]
    pub(crate) fn apply(self, values: &mut [f32]) {
        match self {
            Self::None => {}
            Self::Relu => relu(values),
            Self::Silu => silu(values),
            Self::Gelu => gelu(values),
        }
    }
}
