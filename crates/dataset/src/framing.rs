//! Depth limit, resizing and cropping of frames and labels.

use crate::DatasetError;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{CameraFrame, CowImage, Image, SegmentMap};
use splatseg_imaging::{ImageMap, resample_color, resample_depth, resample_labels};
use splatseg_settings::{Allowed, SettingError, SettingValue};
use std::fmt;
use std::str::FromStr;
use thiserror::Error;

/// The largest width or height, in pixels, that frames can be resized to.
const MAX_SIDE: usize = 4096;

/// Framing of images: far depth is removed, then they are resized, then cropped. Intrinsics are adjusted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Framing {
    /// Depth from here on is missing, metres; none if left out.
    pub max_depth: Option<f32>,
    /// Size to resize to, if any.
    pub resize: Option<ImageSize>,
    /// Without `resize`: images of more pixels than this are downscaled, keeping the aspect ratio.
    pub max_pixels: Option<usize>,
    /// Pixels to remove on each side after resizing.
    pub crop_border: usize,
}

impl Framing {
    /// Returns the size, `(width, height)`, of an image of size `original` after framing.
    ///
    /// # Errors
    /// [`SettingError`] if nothing would be left.
    pub fn check(&self, original: (usize, usize)) -> Result<(usize, usize), SettingError> {
        let (width, height) = self.resized(original);
        let left = |side: usize| self.crop_border.checked_mul(2).and_then(|cut| side.checked_sub(cut)).unwrap_or(0);
        if left(width) == 0 || left(height) == 0 {
            return Err(SettingError {
                key: "dataset.crop_border".to_owned(),
                found: self.crop_border.to_string(),
                expected: format!("less than half of {width}x{height} pixels, the frame's size"),
            });
        }
        Ok((left(width), left(height)))
    }

    /// Returns the size, `(width, height)`, of an image of size `original` after resizing and before cropping.
    pub(crate) fn resized(&self, original: (usize, usize)) -> (usize, usize) {
        if let Some(size) = self.resize {
            return (size.width, size.height);
        }
        let pixels = original.0 as f64 * original.1 as f64;
        match self.max_pixels.map(|max| max as f64) {
            Some(max) if pixels > max => {
                let scale = (max / pixels).sqrt();
                let scaled = |side: usize| ((side as f64 * scale) as usize).max(1);
                (scaled(original.0), scaled(original.1))
            }
            _ => original,
        }
    }

    /// Returns [`Framing::resized`] if it differs from `original`.
    fn other_size(&self, original: (usize, usize)) -> Option<(usize, usize)> {
        Some(self.resized(original)).filter(|size| *size != original)
    }

    /// Removes the far depth of a frame, resizes and crops it. Colour is low-pass filtered when it shrinks. Each depth pixel becomes the nearest
    /// valid measurement under it, never a mixture.
    ///
    /// # Errors
    /// [`SettingError`] if nothing would be left.
    pub fn apply<'a>(&self, frame: CameraFrame<'a>) -> Result<CameraFrame<'a>, DatasetError> {
        let original = (frame.width(), frame.height());
        self.check(original)?;
        let frame = match self.max_depth {
            Some(limit) => frame.without_depth_from(limit),
            None => frame,
        };
        let mut intrinsics = *frame.intrinsics();
        let resize = self.other_size(original);
        if resize.is_none() && self.crop_border == 0 {
            return Ok(frame);
        }
        let (color, depth, predicted) = match resize {
            Some(size) => {
                intrinsics = intrinsics.resized(size.0, size.1);
                let map = ImageMap::resize(original, size);
                // Pixels keep their origin approximately: a reduced pixel's depth is one of those under it.
                let predicted = frame.predicted().map(|predicted| {
                    Image::from_fn(size.0, size.1, |column, row| {
                        map.nearest(column, row).is_some_and(|at| predicted[at])
                    })
                });
                (resample_color(frame.color(), &map), resample_depth(frame.depth(), &map), predicted)
            }
            None => {
                let predicted = frame.predicted().map(CowImage::as_borrowed);
                (frame.color().as_borrowed(), frame.depth().as_borrowed(), predicted)
            }
        };
        let border = self.crop_border;
        let (color, depth) = (color.crop_border(border), depth.crop_border(border));
        let framed = match predicted {
            Some(predicted) => CameraFrame::new(frame.name(), color, depth.clone(), intrinsics.cropped(border))
                .and_then(|framed| framed.with_predicted_depth(depth, predicted.crop_border(border))),
            None => CameraFrame::new(frame.name(), color, depth, intrinsics.cropped(border)),
        };
        framed
            .map(|framed| framed.with_timestamp(frame.timestamp()))
            .map_err(|source| DatasetError::Frame { name: frame.name().to_owned(), source })
    }

    /// Resizes labels (by nearest neighbour) and crops them like their frame.
    ///
    /// # Errors
    /// [`SettingError`] if nothing would be left.
    pub fn apply_to_labels(&self, labels: SegmentMap) -> Result<SegmentMap, DatasetError> {
        let original = labels.size();
        self.check(original)?;
        let resized = match self.other_size(original) {
            Some(size) => resample_labels(&labels, &ImageMap::resize(original, size)),
            None => labels,
        };
        Ok(if self.crop_border == 0 { resized } else { resized.crop_border(self.crop_border) })
    }

    /// Returns the columns and rows of an original image that remain in its labels after framing. `original` is its
    /// size. Pixel `(x, y)` of the framed labels is pixel `(columns[x], rows[y])` of the image.
    ///
    /// # Errors
    /// [`SettingError`] if nothing would be left.
    pub fn source_pixels(&self, original: (usize, usize)) -> Result<(Vec<usize>, Vec<usize>), SettingError> {
        let (width, height) = self.check(original)?;
        let map = ImageMap::resize(original, self.resized(original));
        let border = self.crop_border;
        let columns = (border..border + width).filter_map(|column| map.nearest(column, border));
        let rows = (border..border + height).filter_map(|row| map.nearest(border, row));
        Ok((columns.map(|(column, _)| column).collect(), rows.map(|(_, row)| row).collect()))
    }
}

/// An image size in pixels, written `WIDTHxHEIGHT`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ImageSize {
    /// Width, pixels.
    pub width: usize,
    /// Height, pixels.
    pub height: usize,
}

/// Error parsing an image size.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("image size: found {0:?}, expected WIDTHxHEIGHT in pixels, e.g. 320x240")]
pub struct ImageSizeTextError(String);

impl fmt::Display for ImageSize {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "{}x{}", self.width, self.height)
    }
}

impl FromStr for ImageSize {
    type Err = ImageSizeTextError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let sides = text.split_once(['x', 'X']).and_then(|(width, height)| {
            Some(Self { width: width.trim().parse().ok()?, height: height.trim().parse().ok()? })
        });
        sides.ok_or_else(|| ImageSizeTextError(text.to_owned()))
    }
}

impl SettingValue for ImageSize {
    fn text(&self) -> Option<String> {
        Some(format!("\"{self}\""))
    }

    fn is_text_of(text: &str) -> bool {
        text.parse::<Self>().is_ok()
    }

    fn is_allowed(&self, _: &Allowed) -> bool {
        [self.width, self.height].iter().all(|side| (1..=MAX_SIDE).contains(side))
    }
}

impl Serialize for ImageSize {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for ImageSize {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}
