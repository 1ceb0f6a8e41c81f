//! Undistortion of images: redrawn as a pinhole camera with the same intrinsics would see them.

use crate::DatasetError;
use crate::files::MemoryRequirement;
use glam::dvec2;
use splatseg_geometry::{CowImage, Distortion, Image, Intrinsics};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Memory used by the map per pixel.
const BYTES_PER_PIXEL: u64 = size_of::<Option<[f32; 2]>>() as u64;

/// Map from each pixel of an undistorted image to its position in the distorted image. Computed once per camera.
///
/// The undistorted image has the intrinsics of the distorted one, as with OpenCV's `initUndistortRectifyMap` and
/// `newCameraMatrix = cameraMatrix`, and with ROS's `image_proc` and the matrix K. Depth along the z axis is unchanged.
/// Pixels outside the lens's view are black, without depth.
#[derive(Clone, Debug)]
pub struct Undistortion {
    width: usize,
    height: usize,
    /// `[height, width]`, the `(column, row)` in the distorted image; `None` outside it.
    sources: Vec<Option<[f32; 2]>>,
}

impl Undistortion {
    /// Computes the map of a camera; `None` if its lens does not distort. `path` is named in errors.
    ///
    /// # Errors
    /// [`DatasetError::Intrinsics`] for invalid intrinsics, [`DatasetError::MemoryLimit`] if the map would be too
    /// large.
    pub fn new(intrinsics: &Intrinsics, distortion: &Distortion, path: &Path) -> Result<Option<Self>, DatasetError> {
        if *distortion == Distortion::None {
            return Ok(None);
        }
        let camera =
            intrinsics.validated().map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })?;
        let Intrinsics { width, height, .. } = camera;
        let remedy = "raise --memory-limit, or record smaller images";
        let what = "undistortion map";
        MemoryRequirement { what, size: (width, height), bytes_per_pixel: BYTES_PER_PIXEL, remedy }.check(path)?;
        let (focal, center) = (dvec2(camera.fx.into(), camera.fy.into()), dvec2(camera.cx.into(), camera.cy.into()));
        let last = dvec2(width as f64, height as f64) - 1.0;
        let farthest = ((last - center).abs().max(center.abs()) / focal).length();
        let usable_squared = distortion.usable_radius(farthest).powi(2);
        let source = |column: usize, row: usize| {
            let point = (dvec2(column as f64, row as f64) - center) / focal;
            let pixel = distortion.distort(point) * focal + center;
            let inside = pixel.cmpge(dvec2(-0.5, -0.5)).all() && pixel.cmple(last + 0.5).all();
            let usable = point.length_squared() <= usable_squared;
            (inside && usable).then(|| pixel.as_vec2().to_array())
        };
        let sources = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let sources = sources.map(|(column, row)| source(column, row)).collect();
        Ok(Some(Self { width, height, sources }))
    }

    /// Returns the `(width, height)` of the images it applies to, pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// Returns the position, `(column, row)`, of an undistorted pixel in the distorted image; `None` outside it.
    pub fn source(&self, column: usize, row: usize) -> Option<[f32; 2]> {
        if column >= self.width {
            return None;
        }
        self.sources.get(row.checked_mul(self.width)?.checked_add(column)?).copied().flatten()
    }

    /// Undistorts colour, `[height, width]`, by bilinear interpolation.
    ///
    /// # Errors
    /// [`DatasetError::SizesDiffer`] if the image does not have the camera's size. `path` is named in the error.
    pub fn color(&self, image: &CowImage<'_, [u8; 3]>, path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
        self.require_size(image.size(), "colour image", path)?;
        Ok(self.draw(|[x, y]| {
            let (left, x) = split(x, self.width);
            let (top, y) = split(y, self.height);
            let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
            let corners = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|at| image[at]);
            let weights = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y];
            [0, 1, 2].map(|channel| {
                let sum: f32 =
                    corners.iter().zip(weights).map(|(pixel, weight)| f32::from(pixel[channel]) * weight).sum();
                sum.round() as u8
            })
        }))
    }

    /// Undistorts depth (z, metres, 0 if missing), `[height, width]`, by taking the nearest measurement, never a
    /// mixture.
    ///
    /// # Errors
    /// [`DatasetError::SizesDiffer`] if the image does not have the camera's size. `path` is named in the error.
    pub fn depth(&self, image: &CowImage<'_, f32>, path: &Path) -> Result<Image<f32>, DatasetError> {
        self.require_size(image.size(), "depth image", path)?;
        let nearest = |at: f32, len: usize| (at.round().max(0.0) as usize).min(len - 1);
        Ok(self.draw(|[x, y]| image[(nearest(x, self.width), nearest(y, self.height))]))
    }

    fn draw<T: Clone + Default>(&self, pixel: impl Fn([f32; 2]) -> T) -> Image<T> {
        let mut sources = self.sources.iter();
        Image::from_fn(self.width, self.height, |_, _| {
            sources.next().copied().flatten().map_or_else(T::default, &pixel)
        })
    }

    fn require_size(&self, found: (usize, usize), what: &'static str, path: &Path) -> Result<(), DatasetError> {
        if found == self.size() {
            return Ok(());
        }
        let (path, expected_from) = (path.to_owned(), "the camera");
        Err(DatasetError::SizesDiffer { path, what, found, expected: self.size(), expected_from })
    }
}

/// Splits a position inside the image into the pixel at or before it and the remainder, 0 to 1. Positions are clamped
/// to the edge.
fn split(at: f32, len: usize) -> (usize, f32) {
    let at = at.clamp(0.0, (len - 1) as f32);
    let before = at.floor();
    (before as usize, at - before)
}

/// A camera whose images are undistorted before they are used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Camera {
    pub(crate) intrinsics: Intrinsics,
    pub(crate) distortion: Distortion,
}

impl Camera {
    /// Creates a camera whose lens does not distort. `path` is named in errors.
    pub(crate) fn pinhole(intrinsics: Intrinsics, path: &Path) -> Result<Self, DatasetError> {
        let valid = intrinsics.validated();
        let intrinsics = valid.map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })?;
        Ok(Self { intrinsics, distortion: Distortion::None })
    }
}

/// The map of the last camera used: usually there is only one.
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
        *last = Some((*camera, map.clone()));
        Ok(map)
    }
}
