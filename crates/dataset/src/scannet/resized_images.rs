//! Cameras of images that were made smaller on export while the cameras were left as they were.

use super::Camera;
use crate::DatasetError;
use crate::own_camera::has_shape;
use crate::plausibility::{size_factor, warn_once};
use splatseg_geometry::Intrinsics;

/// A principal point is that of an image of a known size, or of a whole number of times the size, within this share.
const TOLERANCE: f32 = 0.05;
/// Images were this much larger before they were made smaller, at least: of a usual size, and of any.
const MIN_FACTOR_OF_USUAL: f32 = 1.2;
const MIN_FACTOR: f32 = 1.5;

/// Returns a camera for its images of `size` `(width, height)`. Its matrix is that of larger ones if its principal point is
/// the middle of an image that is clearly larger: then it is scaled, with a warning. `usual` is the size of ScanNet's images.
///
/// # Errors
/// [`DatasetError::Intrinsics`] if the matrix is not that of a camera.
pub(super) fn at_size(
    camera: &Camera,
    size: (usize, usize),
    usual: (usize, usize),
) -> Result<Intrinsics, DatasetError> {
    let as_stated = camera.matrix.for_size(size, &camera.path)?;
    let Some(whole) = size_of_whole(&as_stated, usual) else { return Ok(as_stated) };
    warn_once(format!(
        "{}: the principal point ({}, {}) is the middle of images of {}x{} pixels, and these have {}x{}: the intrinsics are \
         scaled to them; --fx (--fy, --cx, --cy) gives other ones",
        camera.path.display(),
        as_stated.cx,
        as_stated.cy,
        whole.0,
        whole.1,
        size.0,
        size.1
    ));
    Ok(camera.matrix.for_size(whole, &camera.path)?.resized(size.0, size.1))
}

/// Returns the size `(width, height)` of the larger images that intrinsics belong to; `None` if they belong to their own.
fn size_of_whole(camera: &Intrinsics, usual: (usize, usize)) -> Option<(usize, usize)> {
    let size = (camera.width, camera.height);
    let factor = size_factor(camera).filter(|factor| *factor > MIN_FACTOR_OF_USUAL)?;
    let is_usual = size_factor(&Intrinsics { width: usual.0, height: usual.1, ..*camera });
    // Exports round sizes, as 1296x968 to 640x480.
    if is_usual.is_some_and(|factor| (factor - 1.0).abs() <= TOLERANCE) {
        return Some(usual);
    }
    // A principal point tells only about how large images were.
    if factor < MIN_FACTOR {
        return None;
    }
    let times = if (factor / factor.round() - 1.0).abs() <= TOLERANCE { factor.round() } else { factor };
    let whole = |side: usize| (side as f32 * times).round() as usize;
    let whole = (whole(size.0), whole(size.1));
    has_shape(whole, size).then_some(whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_principal_point_tells_the_size() {
        let whole = |cx: f32, cy: f32, width: usize, height: usize| {
            size_of_whole(&Intrinsics { fx: 1000.0, fy: 1000.0, cx, cy, width, height }, (1296, 968))
        };
        assert_eq!(whole(641.2, 490.3, 640, 480), Some((1296, 968)));
        assert_eq!(whole(647.8, 483.7, 320, 240), Some((1296, 968)));
        assert_eq!(whole(647.8, 483.7, 960, 717), Some((1296, 968)));
        assert_eq!(whole(320.5, 243.0, 160, 120), Some((640, 480)));
        assert_eq!(whole(159.5, 119.5, 256, 192), None, "1.25 times as large, or a camera that looks aside");
        assert_eq!(whole(399.5, 299.5, 320, 240), Some((800, 600)));
        for (cx, cy) in [(319.5, 239.5), (160.0, 120.0), (639.0, 239.5), (0.0, 0.0)] {
            assert_eq!(whole(cx, cy, 640, 480), None, "{cx} {cy}");
        }
        assert_eq!(whole(647.8, 483.7, 1296, 968), None);
    }
}
