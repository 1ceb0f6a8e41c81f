//! The images of listed frames.

use super::ListedFrame;
use crate::DatasetError;
use crate::decode::{image_size, read_color, read_grey};
use crate::depth_file::read_depth;
use crate::depth_scale::DepthScale;
use crate::error::{COLOR_IMAGE, CONFIDENCE_IMAGE};
use splatseg_geometry::Image;
use std::fmt::Debug;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// Reads the images of listed frames.
pub(crate) trait FrameFiles: Debug + Send + Sync {
    /// Reads the colour image.
    fn color(&self, frame: &ListedFrame) -> Result<Image<[u8; 3]>, DatasetError>;

    /// Returns the `(width, height)` of the colour image.
    fn color_size(&self, frame: &ListedFrame) -> Result<(usize, usize), DatasetError>;

    /// Reads depth, metres, 0 where missing.
    fn depth(&self, frame: &ListedFrame) -> Result<Image<f32>, DatasetError>;

    /// Reads the confidence of each depth, 0 for the lowest; `None` if there is none.
    fn confidence(&self, frame: &ListedFrame) -> Result<Option<Image<u32>>, DatasetError>;

    /// Returns the place of an image of a frame, for messages.
    fn place(&self, image: &Path) -> PathBuf {
        image.to_owned()
    }
}

/// Images that are files.
#[derive(Debug)]
pub(crate) struct PlainFiles {
    pub(crate) depth_scale: DepthScale,
    /// A folder with some of them, removed with this.
    pub(crate) _extracted: Option<TempDir>,
}

impl FrameFiles for PlainFiles {
    fn color(&self, frame: &ListedFrame) -> Result<Image<[u8; 3]>, DatasetError> {
        read_color(&frame.color)
    }

    fn color_size(&self, frame: &ListedFrame) -> Result<(usize, usize), DatasetError> {
        image_size(&frame.color, COLOR_IMAGE)
    }

    fn depth(&self, frame: &ListedFrame) -> Result<Image<f32>, DatasetError> {
        read_depth(&frame.depth, self.depth_scale)
    }

    fn confidence(&self, frame: &ListedFrame) -> Result<Option<Image<u32>>, DatasetError> {
        frame.confidence.as_deref().map(|path| read_grey(path, CONFIDENCE_IMAGE)).transpose()
    }
}

/// Removes the depth of the lowest confidence, 0: the phones guess there, and the readers of these recordings leave it out
/// unless told otherwise. `path` is that of the confidences, for errors.
pub(crate) fn drop_unconfident(
    depth: &mut Image<f32>,
    confidence: &Image<u32>,
    path: &Path,
) -> Result<(), DatasetError> {
    if depth.size() != confidence.size() {
        return Err(DatasetError::SizesDiffer {
            path: path.to_owned(),
            what: CONFIDENCE_IMAGE,
            found: confidence.size(),
            expected: depth.size(),
            expected_from: "its depth image",
        });
    }
    for (depth, confidence) in depth.pixels_mut().iter_mut().zip(confidence.pixels()) {
        if *confidence == 0 {
            *depth = 0.0;
        }
    }
    Ok(())
}
