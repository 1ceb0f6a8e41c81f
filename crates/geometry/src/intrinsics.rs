//! The pinhole camera.

use crate::QuarterTurn;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Pinhole intrinsics of an image of `width` × `height` pixels, in pixels. Pixel centres have integer coordinates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intrinsics {
    /// Focal length along x, pixels.
    pub fx: f32,
    /// Focal length along y, pixels.
    pub fy: f32,
    /// Principal point, column.
    pub cx: f32,
    /// Principal point, row.
    pub cy: f32,
    /// Image width, pixels.
    pub width: usize,
    /// Image height, pixels.
    pub height: usize,
}

/// Invalid intrinsics.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error(
    "intrinsics fx={}, fy={}, cx={}, cy={} of a {}x{} image are invalid: focal lengths must be positive, all values \
     finite and the image not empty",
    .0.fx, .0.fy, .0.cx, .0.cy, .0.width, .0.height
)]
pub struct IntrinsicsError(pub Intrinsics);

impl Intrinsics {
    /// Returns `self` if the focal lengths are positive, every value is finite and the image is not empty.
    ///
    /// # Errors
    /// [`IntrinsicsError`] otherwise.
    pub fn validated(self) -> Result<Self, IntrinsicsError> {
        let finite = [self.fx, self.fy, self.cx, self.cy].iter().all(|value| value.is_finite());
        if finite && self.fx > 0.0 && self.fy > 0.0 && self.width > 0 && self.height > 0 {
            Ok(self)
        } else {
            Err(IntrinsicsError(self))
        }
    }

    /// Returns the intrinsics after resizing the image to `width` × `height` pixels.
    #[must_use]
    pub fn resized(&self, width: usize, height: usize) -> Self {
        let scale_x = width as f32 / self.width as f32;
        let scale_y = height as f32 / self.height as f32;
        Self {
            fx: self.fx * scale_x,
            fy: self.fy * scale_y,
            cx: (self.cx + 0.5) * scale_x - 0.5,
            cy: (self.cy + 0.5) * scale_y - 0.5,
            width,
            height,
        }
    }

    /// Returns the intrinsics after cropping `border` pixels on each side of the image.
    #[must_use]
    pub fn cropped(&self, border: usize) -> Self {
        Self {
            cx: self.cx - border as f32,
            cy: self.cy - border as f32,
            width: self.width.saturating_sub(2 * border),
            height: self.height.saturating_sub(2 * border),
            ..*self
        }
    }

    /// The intrinsics of the turned image.
    #[must_use]
    pub fn turned(&self, turn: QuarterTurn) -> Self {
        let Self { fx, fy, cx, cy, width, height } = *self;
        let (from_right, from_bottom) = ((width - 1) as f32 - cx, (height - 1) as f32 - cy);
        let ((fx, fy), (cx, cy)) = match turn {
            QuarterTurn::None => ((fx, fy), (cx, cy)),
            QuarterTurn::Right => ((fy, fx), (from_bottom, cx)),
            QuarterTurn::Half => ((fx, fy), (from_right, from_bottom)),
            QuarterTurn::Left => ((fy, fx), (cy, from_right)),
        };
        let (width, height) = turn.size((width, height));
        Self { fx, fy, cx, cy, width, height }
    }

    /// Returns the camera-frame point at `pixel` (column, row) and z-depth `depth` (metres).
    pub fn unproject(&self, pixel: Vec2, depth: f32) -> Vec3 {
        Vec3::new((pixel.x - self.cx) / self.fx * depth, (pixel.y - self.cy) / self.fy * depth, depth)
    }

    /// Returns the pixel (column, row) of a camera-frame point. `None` for points at or behind the camera.
    pub fn project(&self, point_camera: Vec3) -> Option<Vec2> {
        (point_camera.z > 0.0).then(|| {
            Vec2::new(
                self.fx * point_camera.x / point_camera.z + self.cx,
                self.fy * point_camera.y / point_camera.z + self.cy,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CAMERA: Intrinsics = Intrinsics { fx: 525.0, fy: 520.0, cx: 319.5, cy: 239.5, width: 640, height: 480 };

    #[test]
    fn resizing_by_half_moves_the_principal_point_with_the_pixel_grid() {
        let half = CAMERA.resized(320, 240);
        assert_eq!((half.fx, half.fy, half.cx, half.cy), (262.5, 260.0, 159.5, 119.5));
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(Intrinsics { fx: 0.0, ..CAMERA }.validated().is_err());
        assert!(Intrinsics { cy: f32::NAN, ..CAMERA }.validated().is_err());
        assert!(Intrinsics { width: 0, ..CAMERA }.validated().is_err());
        assert_eq!(CAMERA.validated(), Ok(CAMERA));
    }

    proptest! {
        #[test]
        fn unprojecting_then_projecting_returns_the_pixel(x in 0.0f32..639.0, y in 0.0f32..479.0, z in 0.1f32..20.0) {
            let back = CAMERA.project(CAMERA.unproject(Vec2::new(x, y), z)).unwrap();
            prop_assert!((back - Vec2::new(x, y)).length() < 1e-3);
        }

        #[test]
        fn a_point_stays_on_its_surface_when_the_image_is_cropped(x in 10.0f32..600.0, z in 0.1f32..20.0) {
            let point = CAMERA.unproject(Vec2::new(x, 100.0), z);
            let cropped = CAMERA.cropped(5).project(point).unwrap();
            prop_assert!((cropped - Vec2::new(x - 5.0, 95.0)).length() < 1e-3);
        }
    }
}
