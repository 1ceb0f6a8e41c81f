//! Replays masks from another program, one file per frame.

use crate::{Segmenter, SegmenterError};
use splatseg_annotations::{MaskFileError, read_mask_file};
use splatseg_dataset::{Framing, ImageSize, padded_number, read_segments_png, unpadded_number};
use splatseg_files::{MemoryLimit, read_file};
use splatseg_geometry::{CameraFrame, Mask, ScoredMask, Segmentation};
use splatseg_settings::SettingError;
use std::path::{Path, PathBuf};

/// Maximum number of pixels in a stored mask.
const MAX_PIXELS: usize = 1 << 26;
/// Maximum number of masks in a frame: the number of nonzero 16-bit ids.
const MAX_MASKS: usize = u16::MAX as usize;
/// Maximum size of an annotation file, bytes.
const MAX_ANNOTATION_BYTES: u64 = 1 << 26;

/// A segmenter that replays stored masks.
///
/// The folder contains one of these files for each frame:
///
/// - `<frame name>.png`: ids as 8-bit or 16-bit grey, or as 8-bit RGB with id = R + 256 G + 65536 B, `[height, width]`.
///   Each id above 0 is a mask with score 1.
/// - `<frame name>.json`: a list of COCO annotations (or an object with the list under the key `annotations`), each
///   `{"segmentation": {"size": [height, width], "counts": ...}, "score": ...}`. `counts` is a compressed RLE string
///   or a list of run lengths. `score` is in [0, 1], by default 1. Other keys are ignored. Masks may overlap.
///
/// If both exist, the PNG is read. A frame name that is a number may also be zero-padded to six digits, or unpadded, in
/// the file name. Masks of the frame's size are used unchanged. All others are resized (nearest pixel) and cropped by
/// the [`Framing`], as the video's own images were.
#[derive(Clone, Debug)]
pub struct MaskFolder {
    folder: PathBuf,
    framing: Framing,
    memory_limit: Option<u64>,
}

impl MaskFolder {
    /// Opens a folder of masks made for a video whose frames are resized and cropped by `framing`.
    ///
    /// # Errors
    /// If `folder` cannot be read, is not a folder, or contains no `.png` or `.json` files, or if `framing` resizes to
    /// more than 2²⁶ pixels.
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
                return Ok(Self { folder, framing, memory_limit: None });
            }
        }
        Err(SegmenterError::NoMasks { path: folder })
    }

    /// Limits the memory for the masks of one frame, in bytes. The default is the limit of the process,
    /// [`MemoryLimit::in_force`].
    #[must_use]
    pub fn with_memory_limit(mut self, bytes: u64) -> Self {
        self.memory_limit = Some(bytes);
        self
    }
}

impl Segmenter for MaskFolder {
    fn name(&self) -> &str {
        "masks"
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        // Frame names may contain dots, so the extension is appended instead of replaced.
        let places = |name: &str| ["png", "json"].map(|extension| self.folder.join(format!("{name}.{extension}")));
        let names = [frame.name(), &padded_number(frame.name()), unpadded_number(frame.name())];
        let stored = names.map(places).into_iter().find(|[png, json]| png.exists() || json.exists());
        let [png, json] = stored.unwrap_or_else(|| places(frame.name()));
        let frame_size = (frame.width(), frame.height());
        let memory_limit = self.memory_limit.unwrap_or_else(MemoryLimit::in_force);
        let read =
            |path| FrameMasks { path, framing: self.framing, frame_size, memory_limit, masks: Vec::new(), bytes: 0 };
        let masks = if png.exists() {
            read(&png).read_ids()
        } else if json.exists() {
            read(&json).read_annotations()
        } else {
            Err(SegmenterError::MissingFrame { frame: frame.name().to_owned(), png, json })
        };
        masks.map(Segmentation::from)
    }
}

/// Reads the masks of a frame from a file. Each mask is brought to the frame's size before the next one is read, and
/// its size is checked before memory is allocated.
struct FrameMasks<'a> {
    path: &'a Path,
    framing: Framing,
    frame_size: (usize, usize),
    /// Memory limit for the masks, bytes.
    memory_limit: u64,
    masks: Vec<ScoredMask>,
    /// Memory used by `masks`, bytes.
    bytes: u64,
}

impl FrameMasks<'_> {
    fn read_ids(mut self) -> Result<Vec<ScoredMask>, SegmenterError> {
        let image_error = |error| SegmenterError::IdImage(Box::new(error));
        let mut ids = read_segments_png(self.path).map_err(image_error)?;
        if ids.size() != self.frame_size {
            self.check_framed(ids.size())?;
            ids = self.framing.apply_to_labels(ids).map_err(image_error)?;
        }
        for (_, mask) in Mask::of_segments(&ids) {
            self.push(mask, 1.0)?;
        }
        Ok(self.masks)
    }

    fn read_annotations(mut self) -> Result<Vec<ScoredMask>, SegmenterError> {
        let path = self.path;
        let text = read_file(path, MAX_ANNOTATION_BYTES)
            .map_err(|source| SegmenterError::Read { path: path.to_owned(), source })?;
        let mut source = SourcePixels::default();
        let wrap = |error| SegmenterError::MaskFile { path: path.to_owned(), source: Box::new(error) };
        read_mask_file(&text, MAX_PIXELS, &wrap, &mut |index, runs, score| {
            let stored = (runs.width, runs.height);
            if source.size != stored {
                source = self.source_pixels(stored)?;
            }
            let mask = runs.decode_at(&source.columns, &source.rows);
            let mask = mask.map_err(|source| wrap(MaskFileError::Rle { index, source }))?;
            self.push(mask, score)
        })?;
        Ok(self.masks)
    }

    /// The pixels to sample from masks of size `stored`.
    fn source_pixels(&self, stored: (usize, usize)) -> Result<SourcePixels, SegmenterError> {
        let framing = if stored == self.frame_size {
            Framing::default()
        } else {
            self.check_framed(stored)?;
            self.framing
        };
        let (columns, rows) = framing.source_pixels(stored)?;
        Ok(SourcePixels { size: stored, columns, rows })
    }

    /// Checks that masks of size `stored` have the frame's size after resizing and cropping.
    fn check_framed(&self, stored: (usize, usize)) -> Result<(), SegmenterError> {
        // If the crop leaves no pixels, the size (0, 0) never equals the frame's.
        let found = self.framing.check(stored).unwrap_or((0, 0));
        if found == self.frame_size {
            return Ok(());
        }
        Err(SegmenterError::WrongSize { path: self.path.to_owned(), stored, found, expected: self.frame_size })
    }

    /// Adds a mask of the frame's size, unless it is empty.
    fn push(&mut self, mask: Mask, score: f32) -> Result<(), SegmenterError> {
        if mask.is_empty() {
            return Ok(());
        }
        let path = || self.path.to_owned();
        if self.masks.len() == MAX_MASKS {
            return Err(SegmenterError::TooManyMasks { path: path(), limit: MAX_MASKS });
        }
        self.bytes += (mask.memory_bytes() + size_of::<ScoredMask>()) as u64;
        if self.bytes > self.memory_limit {
            let (masks, limit) = (self.masks.len() + 1, self.memory_limit);
            return Err(SegmenterError::TooMuchMemory { path: path(), masks, bytes: self.bytes, limit });
        }
        self.masks.push(ScoredMask { mask, score });
        Ok(())
    }
}

/// The columns and rows to sample from stored masks, one for each column and row of the frame.
#[derive(Default)]
struct SourcePixels {
    /// Size of the stored masks.
    size: (usize, usize),
    columns: Vec<usize>,
    rows: Vec<usize>,
}
