//! Undistortion of the images that are read, as a pinhole camera with the same intrinsics would see them.

use crate::DatasetError;
use crate::files::MemoryRequirement;
use crate::plausibility::warn_once;
use splatseg_geometry::{CowImage, Distortion, Image, Intrinsics};
use splatseg_imaging::{SeenBy, UndistortionMap, whole_view};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// A lens that shows nothing in more than this share of an image is doubted...
const MOST_UNSEEN: f64 = 0.3;
/// ...or of an image that is widened, whose corners a round view leaves empty.
const MOST_UNSEEN_WIDENED: f64 = 0.8;

/// Map from each pixel of an undistorted image to its position in the distorted image. Computed once per camera.
///
/// The undistorted image has the intrinsics of the distorted one, as with OpenCV's `initUndistortRectifyMap` and
/// `newCameraMatrix = cameraMatrix`, and with ROS's `image_proc` and the matrix K. Depth along the z axis is unchanged.
/// Pixels outside the lens's view are black, without depth. Such an image lacks the outer parts of what a lens with barrel
/// distortion shows; within this crate, depth that is warped to another camera afterwards has a wider one.
#[derive(Clone, Debug)]
pub struct Undistortion {
    map: UndistortionMap,
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
        let requirement = MemoryRequirement {
            what: "undistortion map",
            size: (target.width, target.height),
            bytes_per_pixel: UndistortionMap::BYTES_PER_PIXEL,
            remedy: "raise --memory-limit, or record smaller images",
        };
        requirement.check(path)?;
        let map = UndistortionMap::new((&camera, distortion), &target);
        warn_of_unseen(map.unseen_share(), if target == camera { MOST_UNSEEN } else { MOST_UNSEEN_WIDENED }, path);
        Ok(Some(Self { map }))
    }

    /// Returns the `(width, height)` of the images it applies to, pixels.
    pub fn size(&self) -> (usize, usize) {
        self.map.source_size()
    }

    /// Returns the position, `(column, row)`, of an undistorted pixel in the distorted image; `None` outside it.
    pub fn source(&self, column: usize, row: usize) -> Option<[f32; 2]> {
        self.map.source(column, row)
    }

    /// Undistorts colour, `[height, width]`, by bilinear interpolation.
    ///
    /// # Errors
    /// [`DatasetError::SizesDiffer`] if the image does not have the camera's size. `path` is named in the error.
    pub fn color(&self, image: &CowImage<'_, [u8; 3]>, path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
        self.map.color(image).ok_or_else(|| self.other_size(image.size(), "colour image", path))
    }

    /// Undistorts depth (z, metres, 0 if missing), `[height, width]`, by taking the nearest measurement, never a
    /// mixture.
    ///
    /// # Errors
    /// [`DatasetError::SizesDiffer`] if the image does not have the camera's size. `path` is named in the error.
    pub fn depth(&self, image: &CowImage<'_, f32>, path: &Path) -> Result<Image<f32>, DatasetError> {
        self.map.depth(image).ok_or_else(|| self.other_size(image.size(), "depth image", path))
    }

    fn other_size(&self, found: (usize, usize), what: &'static str, path: &Path) -> DatasetError {
        let (path, expected_from) = (path.to_owned(), "the camera");
        DatasetError::SizesDiffer { path, what, found, expected: self.size(), expected_from }
    }
}

/// Warns if a lens shows nothing in more than `most` of an image. `path` is named.
fn warn_of_unseen(share: f64, most: f64, path: &Path) {
    if share > most {
        warn_once(format!(
            "{}: the lens sees nothing in {:.0} % of the undistorted image, which stay black: check the model and the \
             coefficients of the lens; for recordings, --camera-info chooses other ones",
            path.display(),
            100.0 * share
        ));
    }
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
