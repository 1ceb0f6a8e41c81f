//! The Gaussians of the map: positions, radii and colours, without the segments that they remember.

use glam::Vec3;
use splatseg_geometry::{KeyframeId, SurfaceKind};
use splatseg_render::Balls;

/// Standard deviation of a new Gaussian divided by the spacing between Gaussians. The paper's is 1.
pub(crate) const RADIUS_PER_SPACING: f32 = 0.6;

/// Attributes of the Gaussians that both kinds of memory need. Every array has one entry per Gaussian.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SplatMap {
    /// Centres, relative to the origin of the map, and radii, metres.
    pub balls: Balls,
    /// sRGB.
    pub colors: Vec<[u8; 3]>,
    /// Index of the last frame that saw each Gaussian.
    pub last_seen: Vec<u32>,
    /// Number of frames that have seen through each Gaussian since a frame last saw it.
    pub seen_through: Vec<u8>,
    /// The keyframe that each Gaussian is attached to. Empty in a [`SplatFile`](crate::SplatFile), where it is part of
    /// the saved state.
    pub anchors: Vec<KeyframeId>,
    /// Whether the surface of each Gaussian was observed or completed. Empty in a [`SplatFile`](crate::SplatFile), as `anchors`.
    pub surfaces: Vec<SurfaceKind>,
}

/// A Gaussian to be added: the surface patch seen by a pixel or a block of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NewGaussian {
    /// Row-major index of the pixel, or of one pixel of the block.
    pub pixel: usize,
    /// Back-projected point, relative to the origin of the map, metres.
    pub mean: Vec3,
    /// Standard deviation in every direction, metres.
    pub radius: f32,
    /// sRGB.
    pub color: [u8; 3],
    /// Whether its surface was observed or completed.
    pub surface: SurfaceKind,
}

impl SplatMap {
    /// Parameters of a Gaussian apart from segments: position 3, radius 1, colour 3.
    pub(crate) const NUMBERS: usize = 3 + 1 + 3;

    /// Number of Gaussians.
    pub(crate) fn len(&self) -> usize {
        self.balls.len()
    }

    /// Adds Gaussians first seen in frame number `frame`, attached to a keyframe.
    pub(crate) fn add(&mut self, added: &[NewGaussian], frame: u32, anchor: KeyframeId) {
        for gaussian in added {
            self.balls.push(gaussian.mean, gaussian.radius);
            self.colors.push(gaussian.color);
            self.surfaces.push(gaussian.surface);
        }
        self.last_seen.resize(self.len(), frame);
        self.seen_through.resize(self.len(), 0);
        self.anchors.resize(self.len(), anchor);
    }

    /// Keeps the Gaussians for which `keep` is true, in their order.
    pub(crate) fn retain(&mut self, keep: &[bool]) {
        retain(&mut self.balls.means, keep);
        retain(&mut self.balls.radii, keep);
        retain(&mut self.colors, keep);
        retain(&mut self.last_seen, keep);
        retain(&mut self.seen_through, keep);
        retain(&mut self.anchors, keep);
        retain(&mut self.surfaces, keep);
    }
}

/// Keeps the entries for which `keep` is true, in their order.
pub(crate) fn retain<T>(entries: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    entries.retain(|_| keep.next().copied().unwrap_or(true));
}
