//! The Gaussians that are rendered, as one array per property.

use glam::{Quat, Vec3};

/// Anisotropic 3D Gaussians in world coordinates, one entry per Gaussian in every array.
///
/// What a Gaussian *carries* (colour, features) is not here: channels are rendered as products with
/// [`BlendWeights`](crate::BlendWeights).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gaussians {
    /// Centres, metres.
    pub means: Vec<Vec3>,
    /// Orientations; normalised when they are used.
    pub quats: Vec<Quat>,
    /// Standard deviations along the three axes, metres (not logarithms).
    pub scales: Vec<Vec3>,
    /// Opacities in [0, 1] (not logits).
    pub opacities: Vec<f32>,
}

impl Gaussians {
    /// Number of Gaussians.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Adds one Gaussian.
    pub fn push(&mut self, mean: Vec3, quat: Quat, scale: Vec3, opacity: f32) {
        self.means.push(mean);
        self.quats.push(quat);
        self.scales.push(scale);
        self.opacities.push(opacity);
    }
}
