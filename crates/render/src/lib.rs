//! 3D Gaussians and a camera in, [`BlendWeights`] out; every image is then a product with them.
//!
//! Geometry does not change while segment features are learnt, and rendering is linear in the features: `F = W f`. So a
//! view is rasterised **once** ([`View`]), and colour, depth, silhouette, any number of feature channels, and the gradients
//! with respect to them, are products with `W` and `Wᵀ`.
//!
//! Semantics are those of 3DGS as `gsplat.rasterization` 1.5 (classic mode) defines them: 0.3 px² low-pass, alpha at
//! most 0.999, alphas below 1/255 skipped, a pixel finished when its transmittance would fall to 1e-4.
//!
//! Everything is deterministic: the same input gives the same bits, whatever the number of threads and whichever
//! vector instructions the processor has.

mod active;
mod blend_weights;
mod camera;
mod gaussians;
mod projection;
mod rasterise;
mod tiles;
mod view;

pub use active::{ActiveTile, ActiveWeights, PixelSet};
pub use blend_weights::{BlendWeights, TileWeights};
pub use camera::{Camera, RasterLimits};
pub use gaussians::{Balls, Gaussians, Shape, Splats};
pub use projection::{ProjectedGaussian, project, project_one};
pub use view::View;

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
