//! One frame of an RGB-D video.

use crate::{Image, Intrinsics, IntrinsicsError, Pose};
use thiserror::Error;

/// One registered RGB-D frame: colour and depth of the same pixels, the camera and where it stood.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame {
    name: String,
    color: Image<[u8; 3]>,
    depth: Image<f32>,
    intrinsics: Intrinsics,
    world_from_camera: Pose,
}

/// Images and intrinsics that do not belong together.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum FrameError {
    /// Colour and depth differ in size; both are `(width, height)`.
    #[error("colour is {}x{} but depth is {}x{}: they must be registered to the same pixels", color.0, color.1, depth.0, depth.1)]
    SizesDiffer {
        /// Size of the colour image.
        color: (usize, usize),
        /// Size of the depth image.
        depth: (usize, usize),
    },
    /// The intrinsics are for an image of another size; both are `(width, height)`.
    #[error("the intrinsics are for {}x{} pixels but the images have {}x{}", intrinsics.0, intrinsics.1, image.0, image.1)]
    IntrinsicsSize {
        /// Size that the intrinsics state.
        intrinsics: (usize, usize),
        /// Size of the images.
        image: (usize, usize),
    },
    /// The intrinsics are impossible.
    #[error(transparent)]
    Intrinsics(#[from] IntrinsicsError),
}

impl RgbdFrame {
    /// Puts a frame together. `color` and `depth` are `[height, width]` of the same pixels; `depth` is z-depth in
    /// metres, where negative, infinite and NaN values become 0 ("missing").
    ///
    /// # Errors
    /// If the sizes of the images and of the intrinsics differ, or the intrinsics are impossible.
    pub fn new(
        name: impl Into<String>,
        color: Image<[u8; 3]>,
        mut depth: Image<f32>,
        intrinsics: Intrinsics,
        world_from_camera: Pose,
    ) -> Result<Self, FrameError> {
        if color.size() != depth.size() {
            return Err(FrameError::SizesDiffer { color: color.size(), depth: depth.size() });
        }
        if (intrinsics.width, intrinsics.height) != color.size() {
            return Err(FrameError::IntrinsicsSize {
                intrinsics: (intrinsics.width, intrinsics.height),
                image: color.size(),
            });
        }
        intrinsics.validated()?;
        for value in depth.pixels_mut() {
            if !(value.is_finite() && *value > 0.0) {
                *value = 0.0;
            }
        }
        Ok(Self { name: name.into(), color, depth, intrinsics, world_from_camera })
    }

    /// The frame's name in its scene, e.g. `frame-000150` or `42`: outputs are named after it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.color.width()
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.color.height()
    }

    /// sRGB colour, `[height, width]`.
    pub fn color(&self) -> &Image<[u8; 3]> {
        &self.color
    }

    /// z-depth in metres, `[height, width]`; 0 where missing, otherwise positive and finite.
    pub fn depth(&self) -> &Image<f32> {
        &self.depth
    }

    /// The camera.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// Where the camera stood.
    pub fn world_from_camera(&self) -> &Pose {
        &self.world_from_camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERA: Intrinsics = Intrinsics { fx: 2.0, fy: 2.0, cx: 0.5, cy: 0.5, width: 2, height: 2 };

    #[test]
    fn unusable_depth_is_missing() {
        let depth = Image::from_pixels(2, 2, vec![1.5, f32::NAN, -1.0, f32::INFINITY]).unwrap();
        let frame = RgbdFrame::new("0", Image::filled(2, 2, [0; 3]), depth, CAMERA, Pose::IDENTITY).unwrap();
        assert_eq!(frame.depth().pixels(), &[1.5, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn sizes_must_agree() {
        let error = RgbdFrame::new("0", Image::filled(2, 2, [0; 3]), Image::filled(2, 1, 1.0), CAMERA, Pose::IDENTITY)
            .unwrap_err();
        assert_eq!(error.to_string(), "colour is 2x2 but depth is 2x1: they must be registered to the same pixels");
        let wide = Image::filled(3, 2, [0; 3]);
        assert!(matches!(
            RgbdFrame::new("0", wide, Image::filled(3, 2, 1.0), CAMERA, Pose::IDENTITY),
            Err(FrameError::IntrinsicsSize { .. })
        ));
    }
}
