//! Predictions on disk.

use crate::coco::{EncodedMask, read_document, read_masks};
use crate::panoptic::{self, PanopticFrames};
use crate::{AnnotationError, PredictionChoice, SelectedFrames};
use splatseg_dataset::{Framing, read_segments_png};
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Maximum number of ids in an id image. An image with more is a photo: no frame has that many segments.
const MAX_IDS: usize = 4096;

/// The predictions of a video.
#[derive(Debug)]
pub enum Predictions {
    /// A folder with one id image per frame.
    Images {
        /// The folder.
        folder: PathBuf,
        /// File name of each frame, without `.png`, by frame name.
        names: BTreeMap<String, String>,
    },
    /// A JSON file in COCO's panoptic format, and its images.
    Panoptic {
        /// The file.
        path: PathBuf,
        /// The images.
        images: PanopticFrames,
    },
    /// A JSON file with run-length encoded masks.
    Masks {
        /// The file.
        path: PathBuf,
        /// Masks by frame name.
        frames: BTreeMap<String, Vec<EncodedMask>>,
    },
}

/// The predictions of one frame.
#[derive(Debug)]
pub enum Prediction {
    /// One id per pixel.
    Map(SegmentMap),
    /// Masks that may overlap.
    Masks(Vec<(SegmentId, Mask)>),
}

/// Fits predictions to the size of the framed ground truth. Predictions of that size are used unchanged. Predictions of
/// the original images' size are framed like the ground truth.
#[derive(Clone, Copy, Debug)]
pub struct Fit {
    /// Framing of the ground truth.
    pub framing: Framing,
    /// Size of the ground truth before framing, `(width, height)`.
    pub original: (usize, usize),
    /// Size of the ground truth after framing, `(width, height)`.
    pub framed: (usize, usize),
}

impl Predictions {
    /// Opens a folder of id images, a folder with such a folder per video, the folder of a run, or a JSON file.
    ///
    /// # Errors
    /// [`AnnotationError::Unusable`] names the file and the problem.
    pub fn open(path: &Path, frames: &SelectedFrames, choice: &PredictionChoice<'_>) -> Result<Self, AnnotationError> {
        let wrong = |error: &dyn std::fmt::Display| AnnotationError::at(path, error);
        let metadata = std::fs::metadata(path).map_err(|error| wrong(&error))?;
        if !metadata.is_dir() {
            let document = read_document(path)?;
            if panoptic::is_panoptic(&document) {
                let images = panoptic::read(document, path, frames, choice).map_err(|error| wrong(&error))?;
                return Ok(Self::Panoptic { path: path.to_owned(), images });
            }
            let frames = read_masks(document, frames, choice).map_err(|error| wrong(&error))?;
            return Ok(Self::Masks { path: path.to_owned(), frames });
        }
        let folder = find_video_folder(path, choice).map_err(|error| wrong(&error))?;
        let mut files = Vec::new();
        for entry in std::fs::read_dir(&folder).map_err(|error| wrong(&error))? {
            let name = entry.map_err(|error| wrong(&error))?.file_name();
            files.extend(name.to_str().and_then(|name| name.strip_suffix(".png")).map(str::to_owned));
        }
        let names = files_of_frames(files, frames).map_err(|error| AnnotationError::at(&folder, error))?;
        if names.is_empty() {
            return Err(wrong(&"the folder has no .png files, expected one per frame, named after it"));
        }
        Ok(Self::Images { folder, names })
    }

    /// Path of the folder or file.
    pub fn path(&self) -> &Path {
        match self {
            Self::Images { folder, .. } => folder,
            Self::Masks { path, .. } | Self::Panoptic { path, .. } => path,
        }
    }

    /// Returns true if there is a prediction for this frame, even an empty one.
    pub fn has(&self, name: &str) -> bool {
        match self {
            Self::Images { names, .. } => names.contains_key(name),
            Self::Panoptic { images, .. } => images.frames.contains_key(name),
            Self::Masks { frames, .. } => frames.contains_key(name),
        }
    }

    /// The id image of a frame; `None` if there is none, or predictions are no folder of images.
    pub fn image_of(&self, name: &str) -> Option<PathBuf> {
        match self {
            Self::Images { folder, names } => Some(folder.join(format!("{}.png", names.get(name)?))),
            Self::Masks { .. } | Self::Panoptic { .. } => None,
        }
    }

    /// Names of the frames with predictions.
    pub fn names(&self) -> Box<dyn Iterator<Item = &str> + '_> {
        match self {
            Self::Images { names, .. } => Box::new(names.keys().map(String::as_str)),
            Self::Panoptic { images, .. } => Box::new(images.frames.keys().map(String::as_str)),
            Self::Masks { frames, .. } => Box::new(frames.keys().map(String::as_str)),
        }
    }

    /// Reads the prediction of a frame. Returns an empty prediction if there is none.
    ///
    /// # Errors
    /// If it cannot be read, or its size is neither that of the framed ground truth nor the original one.
    pub fn read(&self, name: &str, fit: &Fit) -> Result<Prediction, AnnotationError> {
        match self {
            Self::Images { folder, names } => {
                let Some(file) = names.get(name) else { return Ok(Prediction::empty(fit)) };
                let path = folder.join(format!("{file}.png"));
                let map = read_segments_png(&path)?;
                let ids = map.areas().len();
                if ids > MAX_IDS {
                    let text = format!("has {ids} ids, expected at most {MAX_IDS}: is it an id image?");
                    return Err(AnnotationError::at(&path, text));
                }
                fit.map(map).map(Prediction::Map).map_err(|text| AnnotationError::at(&path, text))
            }
            Self::Panoptic { images, .. } => {
                let Some(frame) = images.frames.get(name) else { return Ok(Prediction::empty(fit)) };
                let wrong = |text| AnnotationError::at(&frame.path, text);
                let map = frame.ids(&read_segments_png(&frame.path)?).map_err(wrong)?;
                fit.map(map).map(Prediction::Map).map_err(wrong)
            }
            Self::Masks { path, frames } => {
                let wrong = |text: String| AnnotationError::at(path, format!("frame {name}: {text}"));
                let masks = frames.get(name).map(Vec::as_slice).unwrap_or_default();
                let decoded = masks.iter().map(|mask| Ok((mask.id, fit.mask(mask)?)));
                Ok(Prediction::Masks(decoded.collect::<Result<_, String>>().map_err(wrong)?))
            }
        }
    }
}

/// The file of each frame, without `.png`, by frame name. A file with exactly the frame's name has priority.
fn files_of_frames(mut files: Vec<String>, frames: &SelectedFrames) -> Result<BTreeMap<String, String>, String> {
    // A folder is listed in any order.
    files.sort_unstable();
    let mut names: BTreeMap<String, String> = BTreeMap::new();
    let mut conflicts = Vec::new();
    for file in files {
        let frame = frames.resolve(&file).unwrap_or(&file).to_owned();
        match names.get(&frame) {
            Some(other) if *other == frame => {}
            Some(other) if file != frame => conflicts.push((frame, other.clone(), file)),
            _ => {
                names.insert(frame, file);
            }
        }
    }
    match conflicts.into_iter().find(|(frame, ..)| names[frame] != *frame) {
        Some((frame, first, second)) => {
            Err(format!("{first}.png and {second}.png are both of frame {frame}, expected one file {frame}.png"))
        }
        None => Ok(names),
    }
}

/// Finds the folder with a video's images: a run's `segments`, a folder named after the video, or `path` itself.
fn find_video_folder(path: &Path, choice: &PredictionChoice<'_>) -> Result<PathBuf, String> {
    if choice.video.is_none() && path.join("segments").is_dir() {
        return Ok(path.join("segments"));
    }
    let video = choice.folder();
    let is_plain = !video.is_empty() && !video.contains(['/', '\\']) && video != "..";
    let places = ["", "pan_pred", "panomasksRGB"].map(|folder| path.join(folder).join(video));
    match places.into_iter().find(|place| is_plain && place.is_dir()) {
        Some(place) => Ok(place),
        None if choice.video.is_some() => Err(format!("has no folder {video}")),
        None => Ok(path.to_owned()),
    }
}

impl Prediction {
    /// Returns the prediction of a frame without segments.
    fn empty(fit: &Fit) -> Self {
        Self::Map(SegmentMap::filled(fit.framed.0, fit.framed.1, 0))
    }
}

impl Fit {
    fn check(&self, found: (usize, usize)) -> Result<(), String> {
        if found == self.framed || found == self.original {
            return Ok(());
        }
        let ((width, height), (framed_width, framed_height)) = (self.original, self.framed);
        let expected = if self.original == self.framed {
            format!("{width}x{height}")
        } else {
            format!("{framed_width}x{framed_height} (or {width}x{height}, the original size)")
        };
        Err(format!("the prediction has {}x{} pixels, expected {expected} like the ground truth", found.0, found.1))
    }

    fn map(&self, map: SegmentMap) -> Result<SegmentMap, String> {
        self.check(map.size())?;
        if map.size() == self.framed {
            return Ok(map);
        }
        self.framing.apply_to_labels(map).map_err(|error| error.to_string())
    }

    fn mask(&self, encoded: &EncodedMask) -> Result<Mask, String> {
        let size = (encoded.runs.width, encoded.runs.height);
        // Checked before decoding, as a file may state any size.
        self.check(size)?;
        let wrong = |error: &dyn std::fmt::Display| format!("mask of id {}: {error}", encoded.id);
        if size == self.framed {
            return encoded.runs.decode().map_err(|error| wrong(&error));
        }
        let (columns, rows) = self.framing.source_pixels(size).map_err(|error| error.to_string())?;
        encoded.runs.decode_at(&columns, &rows).map_err(|error| wrong(&error))
    }
}
