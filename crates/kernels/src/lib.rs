//! The vector code of splatseg: loops over plain slices of `f32`, compiled for the best instructions of the processor
//! they run on. Has no notion of tensors, networks or splats.
//!
//! | module | contents |
//! | --- | --- |
//! | [`instructions`] | choice of the instruction set, made once for all loops of the workspace |
//! | [`gemm`] | matrix products: packing, the microkernel, linear layers |
//! | [`convolution`] | 2D convolution: direct, and Winograd's algorithm |
//! | [`depthwise`] | depthwise convolution of channels-last maps |
//! | [`patch_convolution`] | convolution of channels-last maps with few channels, with its norm and activation |
//! | [`feature_map`] | for small networks: maps that keep their padding, and their convolutions |
//! | [`attention`] | softmax attention: global, windowed, and axial; rotary position encoding; pooling |
//! | [`activation`], [`layer_norm`] | element-wise steps between layers |
//! | [`exp`](mod@exp) | exponentials and the normal distribution |
//! | [`inner_products`] | inner products that are bit-identical on every processor, and searches for the largest |
//! | [`aligned`] | vectors aligned to cache lines |
//!
//! Work is divided into blocks of fixed size and every sum has a fixed order, so results never depend on the number of
//! threads. Networks fuse multiplications and additions if the processor can ([`gemm`], [`attention`]). Code that
//! builds the Gaussian map ([`inner_products`], [`exp::exp_negative`]) never fuses them, so maps have the same bytes on
//! every machine.

pub mod activation;
pub mod aligned;
pub mod attention;
pub mod convolution;
pub mod depthwise;
pub mod exp;
pub mod feature_map;
pub mod gemm;
pub mod inner_products;
pub mod instructions;
pub mod layer_norm;
pub mod patch_convolution;

pub use activation::Activation;
pub use aligned::AlignedVec;
pub use instructions::{Instructions, InstructionsError, Vectorize};
