//! The camera in nerfstudio's `transforms.json`: each of its values is global, or given by each frame.

use crate::decode::image_size;
use crate::error::COLOR_IMAGE;
use crate::undistort::Camera;
use crate::{DatasetError, text::shortened};
use serde::Deserialize;
use splatseg_geometry::{Distortion, Intrinsics};
use std::path::Path;

/// Models of lenses that a pinhole camera or polynomials describe.
const POLYNOMIAL_MODELS: [&str; 6] = ["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "PERSPECTIVE"];
const FISHEYE_MODEL: &str = "OPENCV_FISHEYE";

/// Values of a camera, in the file or in a frame.
#[derive(Clone, Debug, Default, Deserialize)]
pub(super) struct CameraFields {
    camera_model: Option<String>,
    /// Horizontal field of view, radians, in Blender's data sets.
    camera_angle_x: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    /// k1 k2 k3 k4 p1 p2
    distortion_params: Option<Vec<f64>>,
}

impl CameraFields {
    fn distorts(&self) -> bool {
        let single = [self.k1, self.k2, self.k3, self.k4, self.p1, self.p2];
        self.distortion_params.is_some() || single.iter().any(Option::is_some)
    }

    /// Returns `[k1, k2, k3, k4, p1, p2]`.
    fn coefficients(&self) -> Option<[f64; 6]> {
        match &self.distortion_params {
            Some(params) => params.as_slice().try_into().ok(),
            None => {
                Some([self.k1, self.k2, self.k3, self.k4, self.p1, self.p2].map(|number| number.unwrap_or_default()))
            }
        }
    }
}

/// Reads the cameras of a file.
pub(super) struct CameraReader<'a> {
    file: &'a Path,
    global: &'a CameraFields,
}

impl<'a> CameraReader<'a> {
    pub(super) fn new(file: &'a Path, global: &'a CameraFields) -> Self {
        Self { file, global }
    }

    /// Returns the camera of a frame. `color` is its image, whose size counts if none is stated, and `place` is named in
    /// errors.
    pub(super) fn camera(&self, own: &CameraFields, color: &Path, place: &Path) -> Result<Camera, DatasetError> {
        let value = |of: fn(&CameraFields) -> Option<f64>| of(self.global).or(of(own));
        let size = match (value(|camera| camera.w), value(|camera| camera.h)) {
            (Some(width), Some(height)) => (side(width, "w", place)?, side(height, "h", place)?),
            _ => image_size(color, COLOR_IMAGE)?,
        };
        let from_angle = value(|camera| camera.camera_angle_x).map(|angle| 0.5 * size.0 as f64 / (0.5 * angle).tan());
        let fx = value(|camera| camera.fl_x).or(from_angle).ok_or_else(|| DatasetError::Field {
            path: place.to_owned(),
            field: "fl_x".to_owned(),
            found: "nothing, here or at the top of the file".to_owned(),
            expected: "the focal length, pixels".to_owned(),
        })?;
        let fy = value(|camera| camera.fl_y).unwrap_or(fx);
        // Here the centre of the first pixel is at (0, 0), in nerfstudio at (0.5, 0.5).
        let cx = value(|camera| camera.cx).unwrap_or(size.0 as f64 / 2.0) - 0.5;
        let cy = value(|camera| camera.cy).unwrap_or(size.1 as f64 / 2.0) - 0.5;
        let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(|number| number as f32);
        let intrinsics = Intrinsics { fx, fy, cx, cy, width: size.0, height: size.1 };
        let camera = Camera::pinhole(intrinsics, place)?;
        Ok(Camera { distortion: self.distortion(own, place)?, ..camera })
    }

    fn distortion(&self, own: &CameraFields, place: &Path) -> Result<Distortion, DatasetError> {
        let wrong = |field: &str, found: String, expected: &str| DatasetError::Field {
            path: place.to_owned(),
            field: field.to_owned(),
            found,
            expected: expected.to_owned(),
        };
        let (fields, place_of_lens) = if self.global.distorts() { (self.global, self.file) } else { (own, place) };
        let [k1, k2, k3, k4, p1, p2] = fields
            .coefficients()
            .ok_or_else(|| wrong("distortion_params", "another number of them".to_owned(), "6: k1 k2 k3 k4 p1 p2"))?;
        let model = self.global.camera_model.as_deref().or(own.camera_model.as_deref()).unwrap_or("OPENCV");
        let distortion = if model == FISHEYE_MODEL {
            Distortion::from_coefficients("equidistant", &[k1, k2, k3, k4])
        } else if !POLYNOMIAL_MODELS.contains(&model) {
            return Err(wrong("camera_model", shortened(model), "OPENCV, PINHOLE, OPENCV_FISHEYE or a simpler one"));
        } else if k4 != 0.0 {
            return Err(wrong("k4", format!("{k4:?}"), "0, except for OPENCV_FISHEYE"));
        } else {
            Distortion::from_coefficients("plumb_bob", &[k1, k2, p1, p2, k3])
        };
        distortion.map_err(|source| DatasetError::Distortion { path: place_of_lens.to_owned(), source })
    }
}

/// Returns a side of an image, which may be written with a decimal point.
fn side(number: f64, key: &str, place: &Path) -> Result<usize, DatasetError> {
    if (1.0..=1e6).contains(&number) && number.fract() == 0.0 {
        return Ok(number as usize);
    }
    Err(DatasetError::Field {
        path: place.to_owned(),
        field: key.to_owned(),
        found: format!("{number:?}"),
        expected: "a number of pixels".to_owned(),
    })
}
