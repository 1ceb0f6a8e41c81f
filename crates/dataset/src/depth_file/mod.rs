//! Depth images in files: PNG, TIFF, NumPy, OpenEXR and PFM, told apart by their content.
//!
//! Integers have the unit of the recording, usually millimetres. Numbers with fractions are in metres, unless the recording
//! or a setting states a unit. NaN, infinite, negative and absurdly large depth is missing.

mod exr;
mod exr_header;
mod npy;
mod pfm;
mod tiff;

use crate::DatasetError;
use crate::decode::{check_stated_size, decode_depth, encoded_size, read_image_file};
use crate::depth_scale::DepthScale;
use crate::error::DEPTH_IMAGE;
use crate::files::is_there;
use splatseg_geometry::Image;
use std::path::{Path, PathBuf};

/// Extensions of depth images, the usual one first.
pub(crate) const DEPTH_ENDINGS: &[&str] = &["png", "tiff", "tif", "npy", "exr", "pfm"];

/// [`DEPTH_ENDINGS`], for messages.
pub(crate) const DEPTH_FILE_NAMES: &str = "<name>.png, .tiff, .npy, .exr or .pfm";

/// [`DEPTH_ENDINGS`] of files that are named by a number.
pub(crate) const DEPTH_SUFFIXES: &[&str] = &[".png", ".tiff", ".tif", ".npy", ".exr", ".pfm"];

/// Reads a depth image, `[height, width]`, metres, 0 where missing.
///
/// # Errors
/// If the file cannot be read, is damaged, has another kind of pixels than 16-bit integers or floating-point numbers, or is
/// too large to be a frame of a video.
pub(crate) fn read_depth(path: &Path, scale: DepthScale) -> Result<Image<f32>, DatasetError> {
    decode_depth_file(path, &read_image_file(path, DEPTH_IMAGE)?, scale)
}

/// Reads the `(width, height)` stated in a depth image's header.
pub(crate) fn depth_size(path: &Path) -> Result<(usize, usize), DatasetError> {
    let bytes = read_image_file(path, DEPTH_IMAGE)?;
    let file = DepthFile { path, bytes: &bytes };
    match Container::of(&bytes) {
        Container::Npy => npy::size(&file),
        Container::Exr => exr::size(&file),
        Container::Pfm => pfm::size(&file),
        Container::Tiff => tiff::size(&file),
        Container::Other => encoded_size(path, DEPTH_IMAGE, &bytes),
    }
}

/// Returns the depth image of a frame in a folder: the first of [`DEPTH_ENDINGS`] that is there, `<stem>.png` if none is.
pub(crate) fn depth_path(folder: &Path, stem: &str) -> PathBuf {
    let with = |ending: &&str| folder.join(format!("{stem}.{ending}"));
    DEPTH_ENDINGS.iter().map(with).find(|path| is_there(path)).unwrap_or_else(|| with(&"png"))
}

/// Like [`read_depth`], but from a file's bytes. `path` is named in errors.
fn decode_depth_file(path: &Path, bytes: &[u8], scale: DepthScale) -> Result<Image<f32>, DatasetError> {
    let file = DepthFile { path, bytes };
    let stored = match Container::of(bytes) {
        Container::Npy => npy::read(&file)?,
        Container::Exr => exr::read(&file)?,
        Container::Pfm => pfm::read(&file)?,
        Container::Tiff => tiff::read(&file)?,
        Container::Other => return decode_depth(path, bytes, scale),
    };
    Ok(stored.metres(scale))
}

/// Kinds of files, by their first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Container {
    Npy,
    Exr,
    Pfm,
    Tiff,
    /// PNG, or nothing that is known.
    Other,
}

impl Container {
    fn of(bytes: &[u8]) -> Self {
        match bytes {
            [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Self::Npy,
            [0x76, 0x2F, 0x31, 0x01, ..] => Self::Exr,
            [b'P', b'f' | b'F', space, ..] if space.is_ascii_whitespace() => Self::Pfm,
            // TIFF and BigTIFF.
            [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Self::Tiff,
            _ => Self::Other,
        }
    }
}

/// Depth as it is stored, `[height, width]`.
#[derive(Debug)]
enum StoredDepth {
    Integers(Image<u16>),
    Floats(Image<f32>),
}

impl StoredDepth {
    fn metres(&self, scale: DepthScale) -> Image<f32> {
        match self {
            Self::Integers(stored) => stored.map(|stored| scale.metres(*stored)),
            Self::Floats(stored) => stored.map(|stored| scale.of_floats().measured(*stored)),
        }
    }
}

/// A depth image as read from disk.
struct DepthFile<'a> {
    /// Named in errors.
    path: &'a Path,
    bytes: &'a [u8],
}

impl DepthFile<'_> {
    fn wrong(&self, field: &str, found: impl Into<String>, expected: impl Into<String>) -> DatasetError {
        DatasetError::Field {
            path: self.path.to_owned(),
            field: format!("{DEPTH_IMAGE}, {field}"),
            found: found.into(),
            expected: expected.into(),
        }
    }

    /// Returns `len` bytes from `start`. `what` names them in errors.
    fn slice(&self, what: &str, start: usize, len: usize) -> Result<&[u8], DatasetError> {
        let part = start.checked_add(len).and_then(|end| self.bytes.get(start..end));
        part.ok_or_else(|| DatasetError::EndsEarly {
            path: self.path.to_owned(),
            what: what.to_owned(),
            end: (start as u64).saturating_add(len as u64),
            bytes: self.bytes.len() as u64,
        })
    }

    /// Checks a size that a header states, `(width, height)`, before memory is taken for it.
    fn check_size(&self, (width, height): (usize, usize)) -> Result<(usize, usize), DatasetError> {
        let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
        check_stated_size(self.path, DEPTH_IMAGE, self.bytes.len(), (side(width), side(height)))?;
        if width == 0 || height == 0 {
            return Err(self.wrong("size", format!("{width}x{height} pixels"), "at least one"));
        }
        Ok((width, height))
    }

    /// Makes an image of `[height, width]` values.
    fn image<T: Clone>(&self, (width, height): (usize, usize), values: Vec<T>) -> Result<Image<T>, DatasetError> {
        let found = values.len();
        Image::from_pixels(width, height, values)
            .map_err(|_| self.wrong("pixels", found.to_string(), format!("{width}x{height}")))
    }
}

/// Reads numbers of `N` bytes.
fn numbers<const N: usize, T>(bytes: &[u8], number: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|bytes| number(*bytes)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A file of each kind, small enough to be cut off at every length.
    fn samples() -> Vec<(&'static str, Vec<u8>)> {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/depth_files");
        let mut names: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        names.sort();
        let sample = |name: std::ffi::OsString| {
            let bytes = std::fs::read(folder.join(&name)).unwrap();
            (&*name.into_string().unwrap().leak(), bytes)
        };
        names.into_iter().map(sample).filter(|(name, _)| !name.ends_with(".json")).collect()
    }

    #[test]
    fn files_that_are_cut_off_are_errors() {
        for (name, bytes) in samples() {
            let path = Path::new(name);
            let whole = decode_depth_file(path, &bytes, DepthScale::MILLIMETRES).is_ok();
            for keep in 0..bytes.len() {
                let cut = decode_depth_file(path, &bytes[..keep], DepthScale::MILLIMETRES);
                // A TIFF may end with something that is not needed, and PNG with a checksum.
                let may_do = name.ends_with(".tiff") || keep + 24 > bytes.len();
                assert!(cut.is_err() || whole && may_do, "{name} of {keep} bytes");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn damaged_files_never_panic(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6)) {
            for (name, mut bytes) in samples() {
                for (at, value) in &changes {
                    let at = at.index(bytes.len());
                    bytes[at] = *value;
                }
                let read = decode_depth_file(Path::new(name), &bytes, DepthScale::MILLIMETRES);
                if let Ok(depth) = read {
                    prop_assert!(depth.pixels().iter().all(|depth| (0.0..1e5).contains(depth)), "{}", name);
                }
            }
        }
    }
}
