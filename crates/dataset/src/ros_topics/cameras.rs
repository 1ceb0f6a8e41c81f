//! Cameras described by camera info messages.

use crate::DatasetError;
use crate::own_camera::{OwnCamera, has_shape};
use crate::undistort::Camera;
use glam::{DVec2, dvec2};
use splatseg_geometry::{Distortion, DistortionError, Intrinsics};
use splatseg_ros::CameraInfo;
use std::path::Path;

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

/// Facts about images from other sources than their camera info.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ImageFacts {
    /// True if they were rectified before recording.
    pub(crate) is_rectified: bool,
    /// Size of the first image, `(width, height)`, if it can be read.
    pub(crate) size: Option<(usize, usize)>,
    /// True if camera infos state sizes, and none of them is that of the first image.
    pub(crate) is_of_other_size: bool,
    /// The camera of the settings.
    pub(crate) own: Option<OwnCamera>,
}

impl ImageFacts {
    /// Returns the size of the first image, if none of the camera infos states it.
    pub(crate) fn unstated_size(&self) -> Option<(usize, usize)> {
        self.size.filter(|_| self.is_of_other_size)
    }
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

    /// Returns the image size that it states, `(width, height)`, if it does.
    pub(crate) fn stated_size(&self) -> Option<(usize, usize)> {
        (self.width > 0 && self.height > 0).then_some((self.width as usize, self.height as usize))
    }

    /// Returns the image size, `(width, height)`, or that of the images where the camera info has none.
    fn size(&self, images: ImageFacts) -> (usize, usize) {
        self.stated_size().or(images.size).unwrap_or_default()
    }

    /// Returns the camera with K, or with P.
    fn pinhole(&self, uses_p: bool, images: ImageFacts) -> Intrinsics {
        let [fx, fy, cx, cy] = (if uses_p { self.rectified } else { self.raw }).map(|number| number as f32);
        let (width, height) = self.size(images);
        Intrinsics { fx, fy, cx, cy, width, height }
    }

    /// Returns true if K is not that of a camera, and P is: some drivers fill in only P.
    pub(crate) fn has_only_p(&self, images: ImageFacts) -> bool {
        self.pinhole(false, images).validated().is_err() && self.pinhole(true, images).validated().is_ok()
    }

    /// Returns true if it describes a camera, alone or with that of the settings.
    pub(crate) fn is_usable(&self, own: Option<OwnCamera>) -> bool {
        // The size of images may not be known yet.
        let facts = |is_rectified| ImageFacts { is_rectified, size: Some((1, 1)), is_of_other_size: false, own };
        [false, true].iter().any(|is_rectified| self.camera(facts(*is_rectified), Path::new("")).is_ok())
    }

    /// Returns the camera of images. Its intrinsics are those of the settings if they give any, otherwise P for images
    /// that were rectified before recording, otherwise K, or P if there is no K. Those of another resolution than the images
    /// are scaled. With intrinsics of the settings, an unreadable lens is ignored. `path` is named in errors.
    ///
    /// # Errors
    /// If the intrinsics or the model of the lens are invalid.
    pub(crate) fn camera(&self, images: ImageFacts, path: &Path) -> Result<Camera, DatasetError> {
        let uses_p = images.is_rectified && self.rectified[0] > 0.0 || self.has_only_p(images);
        let stated = self.pinhole(uses_p, images);
        let stated_size = (stated.width, stated.height);
        let intrinsics = images.own.map_or(stated, |own| own.intrinsics(images.unstated_size().unwrap_or(stated_size)));
        let intrinsics =
            intrinsics.validated().map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })?;
        let intrinsics = match images.unstated_size() {
            Some((width, height)) if images.own.is_none() && has_shape((width, height), stated_size) => {
                intrinsics.resized(width, height)
            }
            _ => intrinsics,
        };
        let distortion = match self.lens() {
            _ if images.is_rectified => Distortion::None,
            Ok(distortion) => distortion,
            Err(_) if images.own.is_some() => Distortion::None,
            Err(error) => {
                let text = format!("{error}; --fx (--fy, --cx, --cy) describes the camera, without its lens");
                return Err(DatasetError::Other { scene: path.display().to_string(), source: text.into() });
            }
        };
        Ok(Camera { intrinsics, distortion })
    }

    /// Returns the lens. Some drivers write the coefficients of a rational polynomial as `plumb_bob`, or give the lens of
    /// `equidistant` the name it has in OpenCV or in its author's paper.
    ///
    /// # Errors
    /// If its model is unknown or its coefficients are invalid.
    pub(crate) fn lens(&self) -> Result<Distortion, DistortionError> {
        let model = match (self.model.as_str(), self.coefficients.len()) {
            ("plumb_bob", 8 | 12 | 14) => "rational_polynomial",
            ("fisheye" | "kannala_brandt" | "kannala_brandt4", 0 | 4) => "equidistant",
            (model, _) => model,
        };
        Distortion::from_coefficients(model, &self.coefficients)
    }

    /// Describes K and P, for messages.
    pub(crate) fn text(&self) -> String {
        let text = |[fx, fy, cx, cy]: [f64; 4]| format!("fx {fx}, fy {fy}, cx {cx}, cy {cy}");
        format!("K has {}, P has {}", text(self.raw), text(self.rectified))
    }
}

/// Number of places along each side of an image at which lenses are compared.
const COMPARED_PLACES: usize = 9;

impl Camera {
    /// Returns how far apart two cameras without their lenses see the corners of an image, pixels of `self`. A camera of
    /// another resolution is scaled.
    pub(crate) fn grid_distance(&self, other: &Self) -> f64 {
        let own = self.intrinsics;
        let other = other.intrinsics.resized(own.width, own.height);
        let end = |side: usize| side.saturating_sub(1) as f32;
        let corners = [(0.0, 0.0), (end(own.width), 0.0), (0.0, end(own.height)), (end(own.width), end(own.height))];
        let distance = |(x, y): (f32, f32)| {
            let (ray_x, ray_y) = ((x - own.cx) / own.fx, (y - own.cy) / own.fy);
            f64::from((ray_x * other.fx + other.cx - x).hypot(ray_y * other.fy + other.cy - y))
        };
        largest(corners.into_iter().map(distance))
    }

    /// Returns how far apart two lenses move a pixel of an image of `self`, at most, pixels.
    pub(crate) fn lens_distance(&self, other: &Self) -> f64 {
        if self.distortion == other.distortion {
            return 0.0;
        }
        let Intrinsics { fx, fy, cx, cy, width, height } = self.intrinsics;
        let focal = dvec2(fx.into(), fy.into());
        let last = (COMPARED_PLACES - 1) as f64;
        let at = |column: usize, row: usize| {
            let place = dvec2(column as f64, row as f64) / last * dvec2(width as f64, height as f64);
            (place - dvec2(cx.into(), cy.into())) / focal
        };
        let distance =
            |point: DVec2| ((self.distortion.distort(point) - other.distortion.distort(point)) * focal).length();
        let rows = |column: usize| (0..COMPARED_PLACES).map(move |row| (column, row));
        largest((0..COMPARED_PLACES).flat_map(rows).map(|(column, row)| distance(at(column, row))))
    }

    /// Returns true if two images have about the same shape.
    pub(crate) fn has_shape_of(&self, other: &Self) -> bool {
        has_shape((self.intrinsics.width, self.intrinsics.height), (other.intrinsics.width, other.intrinsics.height))
    }
}

/// Returns the largest of some numbers; infinity if one is NaN.
fn largest(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.map(|number| if number.is_nan() { f64::INFINITY } else { number }).fold(0.0, f64::max)
}
