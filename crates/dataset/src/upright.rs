//! Photographs as they are seen: phones store them as the sensor lies, and state in EXIF how to turn them.

use crate::DatasetError;
use crate::decode::{decode_color, encoded_size, orientation, read_image_file};
use crate::error::COLOR_IMAGE;
use image::metadata::Orientation;
use image::{DynamicImage, RgbImage};
use splatseg_geometry::Image;
use std::path::Path;

/// Reads a colour image, turned as it says, `[height, width]`.
pub(crate) fn read_upright(path: &Path) -> Result<Image<[u8; 3]>, DatasetError> {
    let bytes = read_image_file(path, COLOR_IMAGE)?;
    let color = decode_color(path, &bytes)?;
    Ok(match orientation(path, &bytes) {
        Orientation::NoTransforms => color,
        orientation => turned(color, orientation),
    })
}

/// Reads the `(width, height)` of a colour image, turned as it says.
pub(crate) fn upright_size(path: &Path) -> Result<(usize, usize), DatasetError> {
    let bytes = read_image_file(path, COLOR_IMAGE)?;
    let (width, height) = encoded_size(path, COLOR_IMAGE, &bytes)?;
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    Ok(match orientation(path, &bytes) {
        Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH => (height, width),
        _ => (width, height),
    })
}

fn turned(color: Image<[u8; 3]>, orientation: Orientation) -> Image<[u8; 3]> {
    let (width, height) = color.size();
    let bytes = color.pixels().as_flattened().to_vec();
    let Some(pixels) = RgbImage::from_raw(width as u32, height as u32, bytes) else { return color };
    let mut pixels = DynamicImage::ImageRgb8(pixels);
    pixels.apply_orientation(orientation);
    let pixels = pixels.into_rgb8();
    let (width, height) = (pixels.width() as usize, pixels.height() as usize);
    let turned = pixels.into_raw().as_chunks::<3>().0.to_vec();
    Image::from_pixels(width, height, turned).unwrap_or(color)
}
