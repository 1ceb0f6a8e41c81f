//! Cameras as camera info messages describe them.

use crate::DatasetError;
use crate::undistort::Undistortion;
use splatseg_geometry::{Distortion, Intrinsics};
use splatseg_ros::CameraInfo;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// A camera info, without its header.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Calibration {
    width: u32,
    height: u32,
    model: String,
    coefficients: Vec<f64>,
    /// fx, fy, cx, cy of the image as taken.
    raw: [f64; 4],
    /// fx, fy, cx, cy of the rectified image; zeros if it is not known.
    rectified: [f64; 4],
}

/// A camera whose image is undistorted before it is used.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Camera {
    pub(super) intrinsics: Intrinsics,
    pub(super) distortion: Distortion,
}

impl Calibration {
    pub(super) fn new(info: &CameraInfo) -> Self {
        let (k, p, roi) = (&info.k, &info.p, &info.roi);
        let binning = [info.binning_x, info.binning_y].map(|binning| f64::from(binning.max(1)));
        // Of the part of the image that is given, and of its pixels, as ROS's `image_geometry` has it.
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

    /// What it takes in memory, bytes.
    pub(super) fn memory(&self) -> u64 {
        (size_of::<Self>() + self.model.len() + 8 * self.coefficients.len()) as u64
    }

    /// `(width, height)`.
    pub(super) fn size(&self) -> (usize, usize) {
        (self.width as usize, self.height as usize)
    }

    /// The camera of images as taken, or of those that were rectified before they were recorded. `path` is named in
    /// errors.
    pub(super) fn camera(&self, is_rectified: bool, path: &Path) -> Result<Camera, DatasetError> {
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
    /// Whether an image of the other camera has the same pixels.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let close = |left: f32, right: f32| (left - right).abs() < 1e-2;
        let (a, b) = (&self.intrinsics, &other.intrinsics);
        (a.width, a.height) == (b.width, b.height)
            && close(a.fx, b.fx)
            && close(a.fy, b.fy)
            && close(a.cx, b.cx)
            && close(a.cy, b.cy)
    }
}

/// The map of the camera that was used last: as a rule there is only one.
#[derive(Debug, Default)]
pub(super) struct UndistortionCache {
    last: Mutex<Option<(Camera, Option<Arc<Undistortion>>)>>,
}

impl UndistortionCache {
    /// The map of a camera; `None` if it does not distort. `path` is named in errors.
    pub(super) fn get(&self, camera: &Camera, path: &Path) -> Result<Option<Arc<Undistortion>>, DatasetError> {
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
