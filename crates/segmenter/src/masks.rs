//! Masks that another program computed, one file per frame.

mod annotations;
mod id_image;

use crate::{Segmenter, SegmenterError};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask};
use std::path::{Path, PathBuf};

/// Most pixels that a stored mask may have: files are not trusted with more memory than that.
const MAX_PIXELS: usize = 1 << 26;

/// How the video's images were changed before they became frames: masks of the original images go the same way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameTransform {
    /// `(width, height)` in pixels that the images were resized to; `None` if they kept their size.
    pub resize: Option<(usize, usize)>,
    /// Pixels cut off on each side, after resizing.
    pub crop_border: usize,
}

/// A segmenter that replays stored masks.
///
/// The folder holds, for each frame, one of
///
/// - `<frame name>.png`: 8-bit or 16-bit grey, `[height, width]`, each id above 0 one mask with score 1;
/// - `<frame name>.json`: a list of COCO annotations (or an object whose key `annotations` holds the list), each
///   `{"segmentation": {"size": [height, width], "counts": ...}, "score": ...}`. `counts` is a compressed RLE string
///   or a list of run lengths; `score` is in [0, 1] and 1 if left out; other keys are ignored. Masks may overlap.
///
/// Where both exist the PNG is read. Masks of the frame's size are used as they are; all others are resized (nearest
/// pixel) and cropped by the [`FrameTransform`].
#[derive(Clone, Debug)]
pub struct MaskFolder {
    folder: PathBuf,
    transform: FrameTransform,
}

impl MaskFolder {
    /// Opens a folder of masks made for a video whose frames are changed by `transform`.
    ///
    /// # Errors
    /// If `folder` cannot be read, is no folder, or holds neither `.png` nor `.json` files.
    pub fn open(folder: impl Into<PathBuf>, transform: FrameTransform) -> Result<Self, SegmenterError> {
        let folder = folder.into();
        let read_error = |source| SegmenterError::Read { path: folder.clone(), source };
        if !std::fs::metadata(&folder).map_err(read_error)?.is_dir() {
            return Err(SegmenterError::NotAFolder { path: folder });
        }
        if matches!(transform.resize, Some((width, height)) if width.saturating_mul(height) > MAX_PIXELS) {
            return Err(SegmenterError::Setting {
                field: "resize",
                found: format!("{:?}", transform.resize),
                expected: "at most 67108864 pixels in all",
            });
        }
        for entry in std::fs::read_dir(&folder).map_err(read_error)? {
            let name = entry.map_err(read_error)?.path();
            if name.extension().is_some_and(|extension| extension == "png" || extension == "json") {
                return Ok(Self { folder, transform });
            }
        }
        Err(SegmenterError::NoMasks { path: folder })
    }
}

impl Segmenter for MaskFolder {
    fn name(&self) -> &str {
        "masks"
    }

    fn segment(&mut self, frame: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
        // Frame names may hold dots, so the extension is appended, never replaced.
        let png = self.folder.join(format!("{}.png", frame.name()));
        let json = self.folder.join(format!("{}.json", frame.name()));
        let (path, stored) = if png.is_file() {
            let masks = id_image::read(&png)?;
            (png, masks)
        } else if json.is_file() {
            let masks = annotations::read(&json)?;
            (json, masks)
        } else {
            return Err(SegmenterError::MissingFrame { frame: frame.name().to_owned(), png, json });
        };
        let fit = Fit { path: &path, transform: self.transform, frame_size: (frame.width(), frame.height()) };
        let mut masks = Vec::with_capacity(stored.len());
        for ScoredMask { mask, score } in stored {
            let mask = fit.apply(mask)?;
            if !mask.is_empty() {
                masks.push(ScoredMask { mask, score });
            }
        }
        Ok(masks)
    }
}

/// Brings stored masks to the size of the frame.
struct Fit<'a> {
    path: &'a Path,
    transform: FrameTransform,
    frame_size: (usize, usize),
}

impl Fit<'_> {
    fn apply(&self, mask: Mask) -> Result<Mask, SegmenterError> {
        let stored = (mask.width(), mask.height());
        if stored == self.frame_size {
            return Ok(mask);
        }
        let border = self.transform.crop_border;
        let resized = self.transform.resize.unwrap_or(stored);
        let cut = |length: usize| length.saturating_sub(border.saturating_mul(2));
        let found = (cut(resized.0), cut(resized.1));
        if found != self.frame_size {
            return Err(SegmenterError::WrongSize {
                path: self.path.to_owned(),
                stored,
                found,
                expected: self.frame_size,
            });
        }
        // Pixel centres are at integer coordinates: the nearest source pixel of k is floor((k + 1/2) · from / to).
        let nearest = |pixel: usize, from: usize, to: usize| (2 * pixel + 1) * from / (2 * to);
        Ok(Mask::from_fn(found.0, found.1, |column, row| {
            mask.contains(nearest(column + border, stored.0, resized.0), nearest(row + border, stored.1, resized.1))
        }))
    }
}

/// Refuses sizes that no image of this project has, before memory is taken for them.
fn check_size(path: &Path, size: (usize, usize)) -> Result<(), SegmenterError> {
    if size.0.checked_mul(size.1).is_none_or(|pixels| pixels == 0 || pixels > MAX_PIXELS) {
        return Err(SegmenterError::ImpossibleSize { path: path.to_owned(), size, limit: MAX_PIXELS });
    }
    Ok(())
}
