//! Undistortion of images: redrawn as a pinhole camera with the same intrinsics would see them.

use crate::DatasetError;
use crate::files::MemoryRequirement;
use crate::plausibility::warn_once;
use glam::{DVec2, dvec2};
use splatseg_geometry::{CowImage, Distortion, Image, Intrinsics, Pose};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Memory used by the map per pixel.
const BYTES_PER_PIXEL: u64 = size_of::<Option<[f32; 2]>>() as u64;
/// A view is widened by at most this share of an image's side at each end.
const MAX_WIDENING: f64 = 0.5;
/// Nearest distance that is needed of an image that is warped to another camera, metres.
const NEAREST_M: f64 = 0.1;
/// Pixels around what is needed, for the pixels that are spread out when depth is warped.
const NEEDED_MARGIN: f64 = 2.0;
/// Directions with a smaller forward component than this (of a unit vector) are not bounded.
const MIN_FORWARD: f64 = 0.05;
/// A lens that shows nothing in more than this share of an image is doubted...
const MOST_UNSEEN: f64 = 0.3;
/// ...or of an image that is widened, whose corners a round view leaves empty.
const MOST_UNSEEN_WIDENED: f64 = 0.8;
/// Number of places along each side of an image at which its view is measured.
const BORDER_PLACES: usize = 64;

/// Map from each pixel of an undistorted image to its position in the distorted image. Computed once per camera.
///
/// The undistorted image has the intrinsics of the distorted one, as with OpenCV's `initUndistortRectifyMap` and
/// `newCameraMatrix = cameraMatrix`, and with ROS's `image_proc` and the matrix K. Depth along the z axis is unchanged.
/// Pixels outside the lens's view are black, without depth. Such an image lacks the outer parts of what a lens with barrel
/// distortion shows; within this crate, depth that is warped to another camera afterwards has a wider one.
#[derive(Clone, Debug)]
pub struct Undistortion {
    /// Size of the undistorted image.
    width: usize,
    height: usize,
    /// Size of the distorted image.
    source: (usize, usize),
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
        Self::to_camera((intrinsics, distortion), intrinsics, path)
    }

    /// Like [`Self::new`], but draws the image of another pinhole camera at the same place.
    ///
    /// # Errors
    /// As there.
    pub(crate) fn to_camera(
        (intrinsics, distortion): (&Intrinsics, &Distortion),
        target: &Intrinsics,
        path: &Path,
    ) -> Result<Option<Self>, DatasetError> {
        if *distortion == Distortion::None {
            return Ok(None);
        }
        let valid = |camera: &Intrinsics| {
            camera.validated().map_err(|source| DatasetError::Intrinsics { path: path.to_owned(), source })
        };
        let (camera, target) = (valid(intrinsics)?, valid(target)?);
        let Intrinsics { width, height, .. } = target;
        let remedy = "raise --memory-limit, or record smaller images";
        let what = "undistortion map";
        MemoryRequirement { what, size: (width, height), bytes_per_pixel: BYTES_PER_PIXEL, remedy }.check(path)?;
        let ((focal, center), (target_focal, target_center)) = (optics(&camera), optics(&target));
        let end = |camera: &Intrinsics| dvec2(camera.width as f64, camera.height as f64) - 1.0;
        let (last, target_last) = (end(&camera), end(&target));
        let farthest = ((target_last - target_center).abs().max(target_center.abs()) / target_focal).length();
        let usable_squared = distortion.usable_radius(farthest).powi(2);
        let source = |column: usize, row: usize| {
            let point = (dvec2(column as f64, row as f64) - target_center) / target_focal;
            let pixel = distortion.distort(point) * focal + center;
            let inside = pixel.cmpge(dvec2(-0.5, -0.5)).all() && pixel.cmple(last + 0.5).all();
            let usable = point.length_squared() <= usable_squared;
            (inside && usable).then(|| pixel.as_vec2().to_array())
        };
        let sources = (0..height).flat_map(|row| (0..width).map(move |column| (column, row)));
        let sources = sources.map(|(column, row)| source(column, row)).collect();
        let map = Self { width, height, source: (camera.width, camera.height), sources };
        map.warn_of_unseen(if target == camera { MOST_UNSEEN } else { MOST_UNSEEN_WIDENED }, path);
        Ok(Some(map))
    }

    /// Returns the `(width, height)` of the images it applies to, pixels.
    pub fn size(&self) -> (usize, usize) {
        self.source
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
            let (left, x) = split(x, self.source.0);
            let (top, y) = split(y, self.source.1);
            let (right, bottom) = ((left + 1).min(self.source.0 - 1), (top + 1).min(self.source.1 - 1));
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
        Ok(self.draw(|[x, y]| image[(nearest(x, self.source.0), nearest(y, self.source.1))]))
    }

    /// Warns if more than the share `most` of the pixels are outside the lens's view. `path` is named.
    fn warn_of_unseen(&self, most: f64, path: &Path) {
        let count = self.sources.iter().filter(|source| source.is_none()).count();
        let share = count as f64 / self.sources.len().max(1) as f64;
        if share > most {
            warn_once(format!(
                "{}: the lens sees nothing in {:.0} % of the undistorted image, which stay black: check the model and the \
                 coefficients of the lens; for recordings, --camera-info chooses other ones",
                path.display(),
                100.0 * share
            ));
        }
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

/// Returns the focal lengths and the principal point of a camera.
fn optics(camera: &Intrinsics) -> (DVec2, DVec2) {
    (dvec2(camera.fx.into(), camera.fy.into()), dvec2(camera.cx.into(), camera.cy.into()))
}

/// Returns a pinhole camera with the focal lengths of a distorted one that sees all of its image, as far as twice its size
/// suffices, and as far as the cameras to which it is warped see it.
fn whole_view(camera: &Intrinsics, distortion: &Distortion, seen_by: &SeenBy) -> Intrinsics {
    let (focal, center) = optics(camera);
    let last = dvec2(camera.width as f64, camera.height as f64) - 1.0;
    let room = (last + 1.0) * MAX_WIDENING;
    let (mut low, mut high) = (DVec2::ZERO, last);
    for pixel in border(last) {
        // Nothing is seen where the lens shows nothing.
        if let Some(point) = distortion.undistort((pixel - center) / focal) {
            let seen = (point * focal + center).clamp(-room, last + room);
            (low, high) = (low.min(seen), high.max(seen));
        }
    }
    if let Some((needed_low, needed_high)) = seen_by.bounds() {
        let (first, end) = (needed_low * focal + center - NEEDED_MARGIN, needed_high * focal + center + NEEDED_MARGIN);
        // Cameras that see nothing in common keep one pixel.
        low = low.max(first).min(high);
        high = high.min(end).max(low);
    }
    let (low, high) = (low.floor(), high.ceil());
    let (size, center) = (high - low + 1.0, center - low);
    Intrinsics { cx: center.x as f32, cy: center.y as f32, width: size.x as usize, height: size.y as usize, ..*camera }
}

/// Returns places along the border of an image whose last pixel is `last`.
fn border(last: DVec2) -> impl Iterator<Item = DVec2> {
    (0..=BORDER_PLACES).flat_map(move |place| {
        let along = last * (place as f64 / BORDER_PLACES as f64);
        [dvec2(along.x, 0.0), dvec2(along.x, last.y), dvec2(0.0, along.y), dvec2(last.x, along.y)]
    })
}

/// The cameras to which an image is warped after it was undistorted: what they do not see needs not be drawn.
#[derive(Clone, Debug)]
pub(crate) struct SeenBy {
    pub(crate) cameras: Vec<Intrinsics>,
    /// From the coordinates of the undistorted camera to theirs.
    pub(crate) from_undistorted: Pose,
}

impl SeenBy {
    /// Returns the lowest and highest coordinates, at a depth of 1, of what the cameras see from [`NEAREST_M`] on; `None` if
    /// some of it is beside or behind the undistorted camera.
    fn bounds(&self) -> Option<(DVec2, DVec2)> {
        let to_undistorted = self.from_undistorted.inverse();
        let (turn, shift) = (to_undistorted.rotation(), to_undistorted.translation());
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for camera in &self.cameras {
            let (focal, center) = optics(camera);
            let last = dvec2(camera.width as f64, camera.height as f64) - 1.0;
            for pixel in border(last + 1.0) {
                let ray = ((pixel - 0.5 - center) / focal).extend(1.0);
                // Far away and near; between, it moves along a line.
                for point in [turn * ray, turn * (ray * NEAREST_M) + shift] {
                    if point.z < MIN_FORWARD * point.length() {
                        return None;
                    }
                    let seen = point.truncate() / point.z;
                    (low, high) = (low.min(seen), high.max(seen));
                }
            }
        }
        low.is_finite().then_some((low, high)).filter(|(_, high)| high.is_finite())
    }
}

/// Splits a position inside the image into the pixel at or before it and the remainder, 0 to 1. Positions are clamped
/// to the edge.
fn split(at: f32, len: usize) -> (usize, f32) {
    let at = at.clamp(0.0, (len - 1) as f32);
    let before = at.floor();
    (before as usize, at - before)
}

/// Corrects the lens of a camera whose frames arrive one by one, as recordings are corrected when they are read. The map is
/// computed again only when the camera or its lens changes.
#[derive(Debug, Default)]
pub struct LensCorrection {
    maps: UndistortionCache,
}

impl LensCorrection {
    /// Undistorts a frame's colour and its depth (metres) of the same pixels, `[height, width]`. The intrinsics stay as they
    /// are. `name` is that of the camera, for errors.
    ///
    /// # Errors
    /// As [`Undistortion::new`], [`Undistortion::color`] and [`Undistortion::depth`].
    pub fn correct(
        &self,
        (color, depth): (Image<[u8; 3]>, Image<f32>),
        (intrinsics, distortion): (&Intrinsics, &Distortion),
        name: &str,
    ) -> Result<(Image<[u8; 3]>, Image<f32>), DatasetError> {
        let (camera, path) = (Camera { intrinsics: *intrinsics, distortion: *distortion }, Path::new(name));
        match self.maps.get(&camera, path)?.map {
            Some(map) => Ok((map.color(&color, path)?, map.depth(&depth, path)?)),
            None => Ok((color, depth)),
        }
    }
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

/// Undistortion map of the last camera used. Usually there is only one.
#[derive(Debug, Default)]
pub(crate) struct UndistortionCache {
    last: Mutex<Option<(Camera, Undistorted)>>,
    /// If given, all that the lens shows and these cameras see is drawn; otherwise the image keeps its size.
    seen_by: Option<SeenBy>,
}

/// The camera of undistorted images, and the map to them; `None` if its lens does not distort.
#[derive(Clone, Debug)]
pub(crate) struct Undistorted {
    pub(crate) camera: Intrinsics,
    pub(crate) map: Option<Arc<Undistortion>>,
}

impl UndistortionCache {
    /// Creates one of images that are warped to other cameras: all that the lens shows and they see is drawn.
    pub(crate) fn warped_to(seen_by: SeenBy) -> Self {
        Self { seen_by: Some(seen_by), ..Self::default() }
    }

    /// Returns how the images of a camera are undistorted. `path` is named in errors.
    pub(crate) fn get(&self, camera: &Camera, path: &Path) -> Result<Undistorted, DatasetError> {
        let Camera { intrinsics, distortion } = camera;
        if *distortion == Distortion::None {
            return Ok(Undistorted { camera: *intrinsics, map: None });
        }
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((known, undistorted)) = last.as_ref()
            && known == camera
        {
            return Ok(undistorted.clone());
        }
        let target = match &self.seen_by {
            Some(seen_by) => whole_view(intrinsics, distortion, seen_by),
            None => *intrinsics,
        };
        let map = Undistortion::to_camera((intrinsics, distortion), &target, path)?.map(Arc::new);
        let undistorted = Undistorted { camera: target, map };
        *last = Some((*camera, undistorted.clone()));
        Ok(undistorted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DVec3, dvec3};

    /// A camera that sees as much as the wide mode of an Azure Kinect, beside a colour camera of 90 degrees.
    #[test]
    fn what_is_warped_is_drawn_as_far_as_it_is_seen() {
        let depth = Intrinsics { fx: 504.0, fy: 504.0, cx: 511.5, cy: 511.5, width: 1024, height: 1024 };
        let color = Intrinsics { fx: 980.0, fy: 980.0, cx: 1023.5, cy: 767.5, width: 2048, height: 1536 };
        let lens = Distortion::from_coefficients("equidistant", &[0.01, 0.0, 0.0, 0.0]).unwrap();
        let color_from_depth = Pose::from_translation(dvec3(-0.032, -0.002, 0.004));
        let view = |cameras: Vec<Intrinsics>, from_undistorted: Pose| {
            whole_view(&depth, &lens, &SeenBy { cameras, from_undistorted })
        };
        let (whole, seen) = (view(Vec::new(), color_from_depth), view(vec![color], color_from_depth));
        let pixels = |camera: &Intrinsics| camera.width * camera.height;
        assert!(2 * pixels(&seen) < pixels(&whole), "{seen:?} {whole:?}");
        for z in [NEAREST_M, 1.0, 1e6] {
            for (column, row) in [(0.0, 0.0), (2047.0, 0.0), (0.0, 1535.0), (2047.0, 1535.0), (1000.0, 0.0)] {
                let ray = dvec3((column - 1023.5) / 980.0, (row - 767.5) / 980.0, 1.0);
                let point: DVec3 = ray * z - color_from_depth.translation();
                let (focal, center) = optics(&seen);
                let pixel = point.truncate() / point.z * focal + center;
                let end = dvec2(seen.width as f64, seen.height as f64) - 1.0;
                assert!(pixel.cmpge(DVec2::ZERO).all() && pixel.cmple(end).all(), "{pixel} of {seen:?}");
            }
        }
        // What looks the other way sees nothing that could be left out, and the view stays valid.
        let back = Pose::from_quaternion(DVec3::ZERO, glam::DQuat::from_rotation_y(std::f64::consts::PI)).unwrap();
        assert_eq!(view(vec![color], back), whole);
        let aside = Pose::from_translation(dvec3(1e3, 0.0, 0.0));
        assert!(view(vec![Intrinsics { width: 2, height: 2, ..color }], aside).validated().is_ok());
    }
}
