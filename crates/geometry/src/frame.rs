//! One frame of an RGB-D video.

use crate::{CowImage, Intrinsics, IntrinsicsError, Pose, QuarterTurn};
use std::ops::Deref;
use std::time::Duration;
use thiserror::Error;

/// An RGB-D frame whose camera pose is not known yet: registered colour and depth, the camera's intrinsics, and an
/// optional timestamp. With a pose it is an [`RgbdFrame`].
///
/// The images may borrow their pixels for `'a`, so that a frame can be made from a camera driver's buffers without a
/// copy. Datasets return frames that own their pixels, `CameraFrame<'static>`.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFrame<'a> {
    name: String,
    timestamp: Option<Duration>,
    color: CowImage<'a, [u8; 3]>,
    depth: CowImage<'a, f32>,
    predicted: Option<CowImage<'a, bool>>,
    intrinsics: Intrinsics,
}

/// A [`CameraFrame`] with the pose of its camera. It dereferences to the former.
///
/// ```
/// use splatseg_geometry::{CowImage, Intrinsics, Pose, RgbdFrame};
/// use std::time::Duration;
/// let (rgb, depth_m) = ([128u8; 3 * 4], [1.5f32; 4]); // 2x2 pixels, as from a camera driver
/// let frame = RgbdFrame::new(
///     "0",
///     CowImage::from_slice(2, 2, rgb.as_chunks().0)?,
///     CowImage::from_slice(2, 2, &depth_m)?,
///     Intrinsics { fx: 2.0, fy: 2.0, cx: 0.5, cy: 0.5, width: 2, height: 2 },
///     Pose::IDENTITY,
/// )?
/// .with_timestamp(Duration::from_millis(33));
/// assert_eq!(frame.depth().pixels().as_ptr(), depth_m.as_ptr());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame<'a> {
    camera: CameraFrame<'a>,
    world_from_camera: Pose,
}

/// Errors creating a [`CameraFrame`].
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
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
        /// Size in the intrinsics.
        intrinsics: (usize, usize),
        /// Size of the images.
        image: (usize, usize),
    },
    /// The intrinsics are invalid.
    #[error(transparent)]
    Intrinsics(#[from] IntrinsicsError),
}

impl<'a> Deref for RgbdFrame<'a> {
    type Target = CameraFrame<'a>;

    fn deref(&self) -> &CameraFrame<'a> {
        &self.camera
    }
}

impl<'a> RgbdFrame<'a> {
    /// Creates a frame without a timestamp, as [`CameraFrame::new`] does, with a pose.
    ///
    /// # Errors
    /// As [`CameraFrame::new`].
    pub fn new(
        name: impl Into<String>,
        color: CowImage<'a, [u8; 3]>,
        depth: CowImage<'a, f32>,
        intrinsics: Intrinsics,
        world_from_camera: Pose,
    ) -> Result<Self, FrameError> {
        Ok(CameraFrame::new(name, color, depth, intrinsics)?.at(world_from_camera))
    }

    /// Sets or removes the timestamp; see [`CameraFrame::timestamp`].
    #[must_use]
    pub fn with_timestamp(self, timestamp: impl Into<Option<Duration>>) -> Self {
        Self { camera: self.camera.with_timestamp(timestamp), ..self }
    }

    /// Converts to a frame that owns its pixels. Copies borrowed pixels.
    pub fn into_owned(self) -> RgbdFrame<'static> {
        self.camera.into_owned().at(self.world_from_camera)
    }

    /// The frame without its pose.
    pub fn into_camera_frame(self) -> CameraFrame<'a> {
        self.camera
    }

    /// The camera's pose.
    pub fn world_from_camera(&self) -> &Pose {
        &self.world_from_camera
    }
}

impl<'a> CameraFrame<'a> {
    /// Creates a frame without a timestamp. `color` (sRGB) and `depth` are `[height, width]`, registered to the same
    /// pixels. `depth` is z-depth in metres; negative, infinite and NaN values become 0 ("missing"). Borrowed depth is
    /// copied only if it has such values.
    ///
    /// # Errors
    /// If the sizes of the images and of the intrinsics differ, or the intrinsics are invalid.
    pub fn new(
        name: impl Into<String>,
        color: CowImage<'a, [u8; 3]>,
        mut depth: CowImage<'a, f32>,
        intrinsics: Intrinsics,
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
        remove_from(&mut depth, f32::INFINITY);
        Ok(Self { name: name.into(), timestamp: None, color, depth, predicted: None, intrinsics })
    }

    /// Replaces the depth, or part of it, by predicted depth: `predicted` is true where it was. Both are `[height, width]`.
    ///
    /// # Errors
    /// If a size differs from the frame's.
    pub fn with_predicted_depth(
        self,
        mut depth: CowImage<'a, f32>,
        predicted: CowImage<'a, bool>,
    ) -> Result<Self, FrameError> {
        if let Some(size) = [depth.size(), predicted.size()].into_iter().find(|size| *size != self.color.size()) {
            return Err(FrameError::SizesDiffer { color: self.color.size(), depth: size });
        }
        remove_from(&mut depth, f32::INFINITY);
        Ok(Self { depth, predicted: Some(predicted), ..self })
    }

    /// Removes depth of `limit` metres or more, a positive number: it becomes 0 ("missing"). Borrowed depth is copied only
    /// if it has some.
    #[must_use]
    pub fn without_depth_from(mut self, limit: f32) -> Self {
        remove_from(&mut self.depth, limit);
        self
    }

    /// Sets or removes the timestamp; see [`CameraFrame::timestamp`].
    #[must_use]
    pub fn with_timestamp(mut self, timestamp: impl Into<Option<Duration>>) -> Self {
        self.timestamp = timestamp.into();
        self
    }

    /// Adds the pose of the camera.
    pub fn at(self, world_from_camera: Pose) -> RgbdFrame<'a> {
        RgbdFrame { camera: self, world_from_camera }
    }

    /// Borrows the frame's pixels as a new frame.
    pub fn as_borrowed(&self) -> CameraFrame<'_> {
        CameraFrame {
            name: self.name.clone(),
            timestamp: self.timestamp,
            color: self.color.as_borrowed(),
            depth: self.depth.as_borrowed(),
            predicted: self.predicted.as_ref().map(CowImage::as_borrowed),
            intrinsics: self.intrinsics,
        }
    }

    /// Converts to a frame that owns its pixels. Copies borrowed pixels.
    pub fn into_owned(self) -> CameraFrame<'static> {
        CameraFrame {
            color: self.color.into_owned(),
            depth: self.depth.into_owned(),
            predicted: self.predicted.map(CowImage::into_owned),
            ..self
        }
    }

    /// The frame with every second row and column only, beginning with the first: a quarter of its pixels.
    pub fn halved(&self) -> CameraFrame<'static> {
        let (width, height) = (self.width().div_ceil(2), self.height().div_ceil(2));
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        CameraFrame {
            color: self.color.halved(),
            depth: self.depth.halved(),
            predicted: self.predicted.as_ref().map(CowImage::halved),
            intrinsics: Intrinsics { fx: fx / 2.0, fy: fy / 2.0, cx: cx / 2.0, cy: cy / 2.0, width, height },
            name: self.name.clone(),
            timestamp: self.timestamp,
        }
    }

    /// The frame as a camera would see it that is turned about its viewing direction.
    #[must_use]
    pub fn turned(&self, turn: QuarterTurn) -> CameraFrame<'static> {
        CameraFrame {
            color: self.color.turned(turn),
            depth: self.depth.turned(turn),
            predicted: self.predicted.as_ref().map(|predicted| predicted.turned(turn)),
            intrinsics: self.intrinsics.turned(turn),
            name: self.name.clone(),
            timestamp: self.timestamp,
        }
    }

    /// The frame's name in its scene, e.g. `frame-000150` or `42`. Output files are named after it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Capture time of the colour image, relative to a fixed instant for the whole video (the Unix epoch for TUM RGB-D,
    /// often the start of the sensor for other recordings). `None` if unknown.
    pub fn timestamp(&self) -> Option<Duration> {
        self.timestamp
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
    pub fn color(&self) -> &CowImage<'a, [u8; 3]> {
        &self.color
    }

    /// z-depth in metres, `[height, width]`; 0 where missing, otherwise positive and finite.
    pub fn depth(&self) -> &CowImage<'a, f32> {
        &self.depth
    }

    /// True where the depth was predicted from colour, not measured, `[height, width]`. `None` if all was measured.
    pub fn predicted(&self) -> Option<&CowImage<'a, bool>> {
        self.predicted.as_ref()
    }

    /// The camera's intrinsics.
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }
}

/// Replaces depth from `limit` on, which is positive, and values that are no depth by 0.
fn remove_from(depth: &mut CowImage<'_, f32>, limit: f32) {
    // By the bits, of which negative and infinite values and NaN have larger ones: vector code for the many images in which
    // all values stay.
    let largest = depth.pixels().iter().map(|value| value.to_bits()).fold(0, u32::max);
    if largest >= limit.to_bits() {
        for value in depth.pixels_mut().iter_mut().filter(|value| value.to_bits() >= limit.to_bits()) {
            *value = 0.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Image;
    use glam::Vec2;

    const CAMERA: Intrinsics = Intrinsics { fx: 2.0, fy: 2.0, cx: 0.5, cy: 0.5, width: 2, height: 2 };

    #[test]
    fn depth_from_a_limit_on_is_missing() {
        let depth = Image::from_pixels(2, 2, vec![0.0, 1.5, 4.0, 9.0]).unwrap();
        let frame = CameraFrame::new("0", Image::filled(2, 2, [0; 3]), depth, CAMERA).unwrap();
        assert_eq!(frame.as_borrowed().without_depth_from(4.0).depth().pixels(), [0.0, 1.5, 0.0, 0.0]);
        assert_eq!(frame.depth().pixels(), [0.0, 1.5, 4.0, 9.0], "what is borrowed stays");
    }

    #[test]
    fn unusable_depth_is_missing() {
        let depth = Image::from_pixels(2, 2, vec![1.5, f32::NAN, -1.0, f32::INFINITY]).unwrap();
        let frame = RgbdFrame::new("0", Image::filled(2, 2, [0; 3]), depth, CAMERA, Pose::IDENTITY).unwrap();
        assert_eq!(frame.depth().pixels(), &[1.5, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn usable_buffers_are_not_copied() {
        let (rgb, metres) = (vec![[1, 2, 3]; 4], vec![1.5, 0.0, 2.0, 3.0]);
        let with_depth = |depth| {
            let color = CowImage::from_slice(2, 2, &rgb).unwrap();
            RgbdFrame::new("0", color, depth, CAMERA, Pose::IDENTITY).unwrap()
        };
        let frame = with_depth(CowImage::from_slice(2, 2, &metres).unwrap());
        assert_eq!(frame.color().pixels().as_ptr(), rgb.as_ptr());
        assert_eq!(frame.depth().pixels().as_ptr(), metres.as_ptr());
        let damaged = [1.5, f32::NAN, 2.0, -0.0];
        let frame = with_depth(CowImage::from_slice(2, 2, &damaged).unwrap());
        let bits: Vec<u32> = frame.depth().pixels().iter().map(|metres| metres.to_bits()).collect();
        assert_eq!(bits, [1.5f32, 0.0, 2.0, 0.0].map(f32::to_bits));
        assert!(damaged[1].is_nan(), "the caller's buffer stays as it is");
    }

    #[test]
    fn a_timestamp_is_kept_when_the_pixels_become_the_frames_own() {
        let metres = [1.0; 4];
        let depth = CowImage::from_slice(2, 2, &metres).unwrap();
        let frame = RgbdFrame::new("0", Image::filled(2, 2, [0; 3]), depth, CAMERA, Pose::IDENTITY).unwrap();
        assert_eq!(frame.timestamp(), None);
        let stamped = frame.with_timestamp(Duration::from_micros(7));
        let owned: RgbdFrame<'static> = stamped.clone().into_owned();
        assert_eq!((owned.timestamp(), &owned), (Some(Duration::from_micros(7)), &stamped));
    }

    #[test]
    fn half_a_frame_sees_the_same_points() {
        let camera = Intrinsics { fx: 6.0, fy: 5.0, cx: 2.5, cy: 1.5, width: 5, height: 3 };
        let depth = Image::from_fn(5, 3, |column, row| (1 + column + 5 * row) as f32);
        let color = Image::from_fn(5, 3, |column, row| [column as u8, row as u8, 7]);
        let frame = CameraFrame::new("0", color, depth, camera).unwrap();
        let half = frame.halved();
        assert_eq!((half.width(), half.height()), (3, 2));
        for (column, row) in [(0, 0), (2, 1), (1, 0)] {
            let [one, other] = [(&frame, 2), (&half, 1)].map(|(frame, step)| {
                let at = (step * column, step * row);
                let depth = frame.depth()[at];
                (frame.color()[at], frame.intrinsics().unproject(Vec2::new(at.0 as f32, at.1 as f32), depth))
            });
            assert_eq!(one, other);
        }
    }

    #[test]
    fn a_turned_frame_sees_turned_points() {
        let camera = Intrinsics { fx: 6.0, fy: 5.0, cx: 2.5, cy: 1.0, width: 5, height: 3 };
        let depth = Image::from_fn(5, 3, |column, row| (1 + column + 5 * row) as f32);
        let frame = CameraFrame::new("0", Image::filled(5, 3, [0; 3]), depth, camera).unwrap();
        let point = |frame: &CameraFrame<'_>, at: (usize, usize)| {
            frame.intrinsics().unproject(Vec2::new(at.0 as f32, at.1 as f32), frame.depth()[at])
        };
        for turn in QuarterTurn::ALL {
            let (before, after) = (point(&frame, (4, 1)), point(&frame.turned(turn), turn.pixel((4, 1), (5, 3))));
            let [(xx, xy), (yx, yy)] = [(1, 0), (0, 1)].map(|axis| turn.vector(axis));
            let expected = (xx as f32 * before.x + yx as f32 * before.y, xy as f32 * before.x + yy as f32 * before.y);
            assert_eq!((after.x, after.y, after.z), (expected.0, expected.1, before.z), "{turn:?}");
        }
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
