//! ScanNet (Dai et al., CVPR 2017), exported to folders or as the original `.sens` recording.
//!
//! Frames are those of the depth camera. Colour with another size or camera (ScanNet: 1296x968, with 640x480 depth) is
//! resampled to it, and labels by nearest neighbour. Both are unchanged if the cameras are the same. The few
//! millimetres between ScanNet's cameras are ignored, as is usual. Programs that export smaller images leave the cameras as
//! they were, also ScanNet's own `SensorData.py`: such a camera is scaled to its images.

mod exported;
mod labels;
mod resized_images;
mod sens;
mod sens_file;

pub use exported::ScannetScene;
pub(crate) use exported::{LAYOUT, is_whole, looks_like, parts};
pub use sens::SensScene;
pub(crate) use sens::{LAYOUT as SENS_LAYOUT, looks_like as looks_like_sens};

use crate::DatasetError;
use crate::own_camera::{OwnCamera, camera_place};
use crate::plausibility::check_intrinsics;
use crate::text::PinholeMatrix;
use resized_images::at_size;
use splatseg_geometry::{Image, Intrinsics, SegmentMap};
use splatseg_imaging::{ImageMap, resample_color, resample_labels};
use std::path::{Path, PathBuf};

/// Sizes of ScanNet's images, `(width, height)`.
const COLOR_SIZE: (usize, usize) = (1296, 968);
const DEPTH_SIZE: (usize, usize) = (640, 480);

/// One of a scene's cameras and the file that describes it, or its part of one.
#[derive(Clone, Debug)]
struct Camera {
    matrix: PinholeMatrix,
    path: PathBuf,
}

/// The cameras of a scene, assumed to have the same position and orientation.
#[derive(Clone, Debug)]
enum Cameras {
    /// Each from its own file, or part of one.
    Recorded { color: Camera, depth: Camera },
    /// The colour camera is given by the settings. Depth is from the same camera, with its own number of pixels.
    Own(OwnCamera),
}

impl Cameras {
    /// Returns the intrinsics of the colour and the depth camera, for images of these sizes, both `(width, height)`.
    fn intrinsics(
        &self,
        color_size: (usize, usize),
        depth_size: (usize, usize),
    ) -> Result<(Intrinsics, Intrinsics), DatasetError> {
        match self {
            Self::Recorded { color, depth } => {
                Ok((at_size(color, color_size, COLOR_SIZE)?, at_size(depth, depth_size, DEPTH_SIZE)?))
            }
            Self::Own(camera) => {
                let camera = camera.intrinsics(color_size);
                Ok((camera, camera.resized(depth_size.0, depth_size.1)))
            }
        }
    }

    /// Returns the place of the intrinsics of the frames, for messages.
    fn place(&self) -> PathBuf {
        match self {
            Self::Recorded { depth, .. } => depth.path.clone(),
            Self::Own(camera) => camera_place(Some(camera), Path::new("")),
        }
    }

    /// Maps colour images of size `color` to depth images of size `depth`, both `(width, height)`.
    fn depth_from_color(&self, color: (usize, usize), depth: (usize, usize)) -> Result<ImageMap, DatasetError> {
        let (color_camera, depth_camera) = self.intrinsics(color, depth)?;
        Ok(ImageMap::between_cameras(&color_camera, &depth_camera))
    }

    /// Returns the intrinsics of the depth camera, and the colour image resampled to it. `depth` is the size of the
    /// depth image, `(width, height)`.
    fn color_at_depth(
        &self,
        color: Image<[u8; 3]>,
        depth: (usize, usize),
    ) -> Result<(Intrinsics, Image<[u8; 3]>), DatasetError> {
        let (color_camera, depth_camera) = self.intrinsics(color.size(), depth)?;
        if let Self::Recorded { color, .. } = self {
            // That of depth is the frame's, which is checked like all others.
            check_intrinsics(&color_camera, &|_| color.path.clone())?;
        }
        let map = ImageMap::between_cameras(&color_camera, &depth_camera);
        let color = if map.is_identity() { color } else { resample_color(&color, &map) };
        Ok((depth_camera, color))
    }

    /// Resamples labels with the size of the depth or colour image to the depth camera. `path` is the labels' file, for
    /// errors.
    fn labels_at_depth(
        &self,
        labels: SegmentMap,
        path: &Path,
        depth: (usize, usize),
        color: impl FnOnce() -> Result<(usize, usize), DatasetError>,
    ) -> Result<SegmentMap, DatasetError> {
        if labels.size() == depth {
            return Ok(labels);
        }
        let color = color()?;
        if labels.size() != color {
            return Err(DatasetError::SizesDiffer {
                path: path.to_owned(),
                what: "segment image",
                found: labels.size(),
                expected: color,
                expected_from: "its colour image",
            });
        }
        Ok(resample_labels(&labels, &self.depth_from_color(color, depth)?))
    }
}
