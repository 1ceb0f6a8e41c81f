//! Cameras described by camera info messages.

use crate::DatasetError;
use crate::undistort::Undistortion;
use splatseg_geometry::{Distortion, Intrinsics};
use splatseg_ros::CameraInfo;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// A camera info, without its header.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Calibration {
    width: u32,
    height: u32,
    model: String,
    coefficients: Vec<f64>,
    /// fx, fy, cx, cy of the original image.
    raw: [f64; 4],
    /// fx, fy, cx, cy of the rectified image; zeros if unknown.
    rectified: [f64; 4],
}

/// A camera whose image is undistorted before it is used.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Camera {
    pub(crate) intrinsics: Intrinsics,
    pub(crate) distortion: Distortion,
}

impl Calibration {
    pub(crate) fn new(info: &CameraInfo) -> Self {
        let (k, p, roi) = (&info.k, &info.p, &info.roi);
        let binning = [info.binning_x, info.binning_y].map(|binning| f64::from(binning.max(1)));
        // Adjusted for the region of interest and binning, as in ROS's `image_geometry`.
        let of_image = |[fx, fy, cx, cy]: [f64; 4]| {
            let (x, y) = (f64::from(roi.x_offset), f64::from(roi.y_offset));
            [fx / binning[0], fy / binning[1], (cx - x) / binning[0], (cy - y) / binning[1]]
        };
        let side = |whole: u32, part: u32, binning: u32| (if part == 0 { whole } else { part }) / binning.max(1);
        Self {
            width: side(info.width, roi.width, info.binning_x),
            height: side(info.height, roi.height, info.binning_y),
            model: info.distortion_model.clone(),
            coefficients: info.d.clone(),
            raw: of_image([k[0], k[4], k[2], k[5]]),
            rectified: of_image([p[0], p[5], p[2], p[6]]),
        }
    }

    /// Returns its size in memory, bytes.
    pub(crate) fn memory(&self) -> u64 {
        (size_of::<Self>() + self.model.len() + 8 * self.coefficients.len()) as u64
    }

    /// Returns the image size, `(width, height)`.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.width as usize, self.height as usize)
    }

    /// Returns the camera of the original images, or of images that were rectified before recording. `path` is named in
    /// errors.
    pub(crate) fn camera(&self, is_rectified: bool, path: &Path) -> Result<Camera, DatasetError> {
        let uses_projection = is_rectified && self.rectified[0] > 0.0;
        let [fx, fy, cx, cy] = (if uses_projection { self.rectified } else { self.raw }).map(|number| number as f32);
        let (width, height) = self.size();
        let intrinsics = Intrinsics { fx, fy, cx, cy, width, height }
            .validated()
            .map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })?;
        let distortion = if is_rectified {
            Distortion::None
        } else {
            Distortion::from_coefficients(&self.model, &self.coefficients)
                .map_err(|error| DatasetError::Other { scene: path.display().to_string(), source: error.into() })?
        };
        Ok(Camera { intrinsics, distortion })
    }
}

impl Camera {
    /// Returns true if both cameras have the same pixel grid.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let close = |left: f32, right: f32| (left - right).abs() < 1e-2;
        let (a, b) = (&self.intrinsics, &other.intrinsics);
        (a.width, a.height) == (b.width, b.height)
            && close(a.fx, b.fx)
            && close(a.fy, b.fy)
            && close(a.cx, b.cx)
            && close(a.cy, b.cy)
    }
}

/// Undistortion map of the last camera used. Usually there is only one.
#[derive(Debug, Default)]
pub(crate) struct UndistortionCache {
    last: Mutex<Option<(Camera, Option<Arc<Undistortion>>)>>,
}

impl UndistortionCache {
    /// Returns the map of a camera; `None` if its lens does not distort. `path` is named in errors.
    pub(crate) fn get(&self, camera: &Camera, path: &Path) -> Result<Option<Arc<Undistortion>>, DatasetError> {
        if camera.distortion == Distortion::None {
            return Ok(None);
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, map)) = last.as_ref()
            && known == camera
        {
            return Ok(map.clone());
        }
        let map = Undistortion::new(&camera.intrinsics, &camera.distortion, path)?.map(Arc::new);
        *last = Some((camera.clone(), map.clone()));
        Ok(map)
    }
}
