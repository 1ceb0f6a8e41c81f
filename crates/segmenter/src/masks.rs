//! Masks that another program computed, one file per frame.

mod annotations;

use crate::{Segmenter, SegmenterError};
use splatseg_dataset::{Framing, ImageSize, read_segments_png};
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask};
use splatseg_settings::SettingError;
use std::path::{Path, PathBuf};

/// Most pixels that a stored mask may have: files are not trusted with more memory than that.
const MAX_PIXELS: usize = 1 << 26;

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
/// pixel) and cropped by the [`Framing`], as the video's own images were.
#[derive(Clone, Debug)]
pub struct MaskFolder {
    folder: PathBuf,
    framing: Framing,
}

impl MaskFolder {
    /// Opens a folder of masks made for a video whose frames are resized and cropped by `framing`.
    ///
    /// # Errors
    /// If `folder` cannot be read, is not a folder, or holds neither `.png` nor `.json` files.
    pub fn open(folder: impl Into<PathBuf>, framing: Framing) -> Result<Self, SegmenterError> {
        let folder = folder.into();
        let read_error = |source| SegmenterError::Read { path: folder.clone(), source };
        if !std::fs::metadata(&folder).map_err(read_error)?.is_dir() {
            return Err(SegmenterError::NotAFolder { path: folder });
        }
        if let Some(size @ ImageSize { width, height }) = framing.resize
            && width.saturating_mul(height) > MAX_PIXELS
        {
            return Err(SegmenterError::Setting(SettingError {
                key: "dataset.resize".to_owned(),
                found: size.to_string(),
                expected: "at most 67108864 pixels in all".to_owned(),
            }));
        }
        for entry in std::fs::read_dir(&folder).map_err(read_error)? {
            let name = entry.map_err(read_error)?.path();
            if name.extension().is_some_and(|extension| extension == "png" || extension == "json") {
                return Ok(Self { folder, framing });
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
            let ids = read_segments_png(&png).map_err(|error| SegmenterError::IdImage(Box::new(error)))?;
            let masks = Mask::of_segments(&ids).into_iter().map(|(_, mask)| ScoredMask { mask, score: 1.0 });
            (png, masks.collect())
        } else if json.is_file() {
            let masks = annotations::read(&json)?;
            (json, masks)
        } else {
            return Err(SegmenterError::MissingFrame { frame: frame.name().to_owned(), png, json });
        };
        let fit = Fit { path: &path, framing: self.framing, frame_size: (frame.width(), frame.height()) };
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
    framing: Framing,
    frame_size: (usize, usize),
}

impl Fit<'_> {
    fn apply(&self, mask: Mask) -> Result<Mask, SegmenterError> {
        let stored = (mask.width(), mask.height());
        if stored == self.frame_size {
            return Ok(mask);
        }
        // Where the crop leaves nothing, nothing can have the frame's size.
        let found = self.framing.check(stored).unwrap_or((0, 0));
        match self.framing.apply_to_mask(&mask) {
            Ok(mask) if found == self.frame_size => Ok(mask),
            _ => {
                Err(SegmenterError::WrongSize { path: self.path.to_owned(), stored, found, expected: self.frame_size })
            }
        }
    }
}

/// Refuses sizes that no image of this project has, before memory is taken for them.
fn check_size(path: &Path, size: (usize, usize)) -> Result<(), SegmenterError> {
    if size.0.checked_mul(size.1).is_none_or(|pixels| pixels == 0 || pixels > MAX_PIXELS) {
        return Err(SegmenterError::ImpossibleSize { path: path.to_owned(), size, limit: MAX_PIXELS });
    }
    Ok(())
}
