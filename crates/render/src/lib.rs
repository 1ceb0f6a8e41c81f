//! Rasterisation of 3D Gaussians to [`BlendWeights`]; every image is then a product with them.
//!
//! Geometry does not change while segment features are learnt, and rendering is linear in the features: `F = W f`. A
//! view is therefore rasterised **once** ([`View`]), and colour, depth, silhouette, any number of feature channels, and
//! the gradients with respect to them, are products with `W` and `Wᵀ`.
//!
//! The semantics are those of `gsplat.rasterization` 1.5 in classic mode: a 0.3 px² low-pass filter, alpha at most
//! 0.999, alphas below 1/255 are skipped, and a pixel is finished when its transmittance would fall to 1e-4.
//!
//! Everything is deterministic: the same input gives the same bits, for any number of threads and any vector
//! instructions of the processor.

mod active;
mod blend_weights;
mod camera;
mod gaussians;
mod pixel_set;
mod projection;
mod rasterise;
mod tile_weights;
mod tiles;
mod view;

pub use active::{ActiveTile, ActiveWeights};
pub use blend_weights::BlendWeights;
pub use camera::{Camera, RasterLimits};
pub use gaussians::{Balls, Gaussians, Shape, Splats};
pub use pixel_set::PixelSet;
pub use projection::{ProjectedGaussian, project, project_one};
pub use tile_weights::TileWeights;
pub use view::View;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
