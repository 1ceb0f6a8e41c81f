//! Gaussian rasterisation into blend weights, and their products with any channels and back.

mod gaussians;

pub use gaussians::Gaussians;
