//! The camera for rendering, and the constants of rasterisation.

use glam::{Mat3, Vec3};
use splatseg_geometry::{Intrinsics, LocalPose};

/// A pinhole camera at a pose, and the limits of rasterisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// The pinhole model; pixel centres have integer coordinates.
    pub intrinsics: Intrinsics,
    /// Rotation part of the world-to-camera transform.
    pub camera_from_world_rotation: Mat3,
    /// Translation part of the world-to-camera transform, metres.
    pub camera_from_world_translation: Vec3,
    /// The limits of rasterisation.
    pub limits: RasterLimits,
}

/// The constants of 3DGS rasterisation, with the values of gsplat 1.5 (`rasterize_mode="classic"`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RasterLimits {
    /// Gaussians with their centre at or before this (camera z, metres) are omitted.
    pub near_plane: f32,
    /// Gaussians with their centre at or beyond this (camera z, metres) are omitted.
    pub far_plane: f32,
    /// Added to both diagonal entries of the 2D covariance, pixels²: no Gaussian is thinner than about a pixel.
    pub low_pass: f32,
    /// Upper bound of alpha.
    pub max_alpha: f32,
    /// Smaller alphas are skipped.
    pub min_alpha: f32,
    /// A pixel is finished when its transmittance would fall to this; the Gaussian that would cause it is not blended.
    pub min_transmittance: f32,
}

impl Default for RasterLimits {
    fn default() -> Self {
        Self {
            near_plane: 0.01,
            far_plane: 1e10,
            low_pass: 0.3,
            max_alpha: 0.999,
            min_alpha: 1.0 / 255.0,
            min_transmittance: 1e-4,
        }
    }
}

impl Camera {
    /// A camera with the default [`RasterLimits`].
    pub fn new(intrinsics: Intrinsics, world_from_camera: &LocalPose) -> Self {
        let rotation = world_from_camera.rotation().transpose();
        Self {
            intrinsics,
            camera_from_world_rotation: rotation,
            camera_from_world_translation: -(rotation * world_from_camera.translation()),
            limits: RasterLimits::default(),
        }
    }

    /// Transforms a world point to the camera's frame, metres.
    #[inline(always)]
    pub fn to_camera(&self, point_world: Vec3) -> Vec3 {
        self.camera_from_world_rotation * point_world + self.camera_from_world_translation
    }
}
