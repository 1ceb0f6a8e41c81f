//! Gaussians for rendering, one array per property.

use glam::{Quat, Vec3};

/// The shape of one Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// The same standard deviation in every direction, metres.
    Ball(f32),
    /// Standard deviations along three axes, metres, and the orientation of those axes.
    Ellipsoid(Vec3, Quat),
}

/// A set of renderable 3D Gaussians, in world coordinates.
pub trait Splats: Sync {
    /// Number of Gaussians.
    fn count(&self) -> usize;

    /// Centre of a Gaussian, metres.
    fn mean(&self, index: usize) -> Vec3;

    /// Opacity of a Gaussian, in [0, 1].
    fn opacity(&self, index: usize) -> f32;

    /// Shape of a Gaussian.
    fn shape(&self, index: usize) -> Shape;
}

/// Anisotropic 3D Gaussians in world coordinates, one entry per Gaussian in every array.
///
/// Colours and features are not stored here: they are rendered as products with [`BlendWeights`](crate::BlendWeights).
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

    /// True if there are none.
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

impl Splats for Gaussians {
    fn count(&self) -> usize {
        self.len()
    }

    #[inline(always)]
    fn mean(&self, index: usize) -> Vec3 {
        self.means[index]
    }

    #[inline(always)]
    fn opacity(&self, index: usize) -> f32 {
        self.opacities[index]
    }

    #[inline(always)]
    fn shape(&self, index: usize) -> Shape {
        let scale = self.scales[index];
        if scale.x == scale.y && scale.y == scale.z {
            // A ball looks the same from every side.
            return Shape::Ball(scale.x);
        }
        Shape::Ellipsoid(scale, self.quats[index])
    }
}

/// Opaque isotropic Gaussians, as in a map grown from depth images. One entry per Gaussian in every array.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Balls {
    /// Centres, world coordinates, metres.
    pub means: Vec<Vec3>,
    /// Standard deviations, metres.
    pub radii: Vec<f32>,
}

impl Balls {
    /// Number of balls.
    pub fn len(&self) -> usize {
        self.means.len()
    }

    /// True if there are none.
    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// Adds one ball.
    pub fn push(&mut self, mean: Vec3, radius: f32) {
        self.means.push(mean);
        self.radii.push(radius);
    }
}

impl Splats for Balls {
    fn count(&self) -> usize {
        self.len()
    }

    #[inline(always)]
    fn mean(&self, index: usize) -> Vec3 {
        self.means[index]
    }

    #[inline(always)]
    fn opacity(&self, _: usize) -> f32 {
        1.0
    }

    #[inline(always)]
    fn shape(&self, index: usize) -> Shape {
        Shape::Ball(self.radii[index])
    }
}
