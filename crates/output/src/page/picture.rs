//! The frames' pictures without overlay, for the page.

use crate::OutputError;
use image::{ImageBuffer, Rgb, imageops};
use splatseg_geometry::{CowImage, Image};
use std::path::Path;

/// Maximum width of a picture, pixels.
const MAX_WIDTH: usize = 640;
const JPEG_QUALITY: u8 = 80;

/// Encodes a colour image, sRGB, as a JPEG of at most 640 columns. `path` is named in errors.
///
/// # Errors
/// [`OutputError::EncodeJpeg`].
pub fn small_jpeg(path: &Path, color: &CowImage<'_, [u8; 3]>) -> Result<Vec<u8>, OutputError> {
    let small = reduced(color);
    let (width, height) = small.as_ref().map_or(color.size(), Image::size);
    let pixels = small.as_ref().map_or(color.pixels(), Image::pixels);
    splatseg_jpeg::encode(pixels, width, height, JPEG_QUALITY)
        .map_err(|source| OutputError::EncodeJpeg { path: path.to_owned(), source })
}

/// The image with [`MAX_WIDTH`] columns; `None` if it has no more than that.
fn reduced(color: &CowImage<'_, [u8; 3]>) -> Option<Image<[u8; 3]>> {
    let (width, height) = color.size();
    if width <= MAX_WIDTH {
        return None;
    }
    let (columns, rows) = (MAX_WIDTH, (height * MAX_WIDTH).div_ceil(width));
    let large: ImageBuffer<Rgb<u8>, &[u8]> =
        ImageBuffer::from_raw(u32::try_from(width).ok()?, u32::try_from(height).ok()?, color.pixels().as_flattened())?;
    let small = imageops::thumbnail(&large, u32::try_from(columns).ok()?, u32::try_from(rows).ok()?);
    Image::from_pixels(columns, rows, small.pixels().map(|pixel| pixel.0).collect()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_pictures_have_640_columns() {
        let size = |width, height| {
            let color = Image::from_fn(width, height, |column, row| [column as u8, row as u8, 7]);
            let bytes = small_jpeg(Path::new("picture.jpg"), &color).unwrap();
            let found = image::load_from_memory(&bytes).unwrap();
            (found.width(), found.height())
        };
        assert_eq!(size(1280, 719), (640, 360));
        assert_eq!(size(320, 240), (320, 240));
    }
}
