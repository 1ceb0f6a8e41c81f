//! A small colour image of a keyframe, as a JPEG file: for people, for names of objects, and for meshes. Tracking does not
//! use it.

use splatseg_geometry::{CowImage, Image};
use splatseg_jpeg::{Jpeg, encode};

/// Maximum width and height, pixels. An object of 10 cm at a distance of 2 m is 13 pixels wide in a usual camera.
const MAX_SIDE: usize = 320;

/// An image of a room takes about 13 kB.
const QUALITY: u8 = 75;

/// A file is larger than this only if it is not an image of [`encoded`]: three bytes for each pixel of the largest one.
const MAX_BYTES: usize = 3 * MAX_SIDE * MAX_SIDE;

/// Reduces an image until no side is longer than [`MAX_SIDE`], and compresses it. Pixels are means of square blocks.
pub(crate) fn encoded(color: &CowImage<'_, [u8; 3]>) -> Vec<u8> {
    let step = color.width().max(color.height()).div_ceil(MAX_SIDE).max(1);
    let (width, height) = ((color.width() / step).max(1), (color.height() / step).max(1));
    let small = Image::from_fn(width, height, |column, row| mean(color, column * step, row * step, step));
    // The size is one that the format knows.
    encode(small.pixels(), width, height, QUALITY).unwrap_or_default()
}

/// Mean of the colours in a square block, or in the part of it that is inside the image.
fn mean(color: &CowImage<'_, [u8; 3]>, left: usize, top: usize, side: usize) -> [u8; 3] {
    let (right, bottom) = ((left + side).min(color.width()), (top + side).min(color.height()));
    let mut sum = [0u32; 3];
    for row in top..bottom {
        for pixel in &color.row(row)[left..right] {
            sum.iter_mut().zip(pixel).for_each(|(sum, channel)| *sum += u32::from(*channel));
        }
    }
    let count = ((right - left) * (bottom - top)).max(1) as u32;
    sum.map(|sum| ((sum + count / 2) / count) as u8)
}

/// True for files with a size that [`encoded`] gives.
pub(crate) fn is_possible(file: &[u8]) -> bool {
    let is_small = |(width, height): (u32, u32)| width.max(height) as usize <= MAX_SIDE && width.min(height) > 0;
    file.len() <= MAX_BYTES && Jpeg::read_header(file).is_ok_and(|jpeg| is_small(jpeg.size()))
}

/// Decompresses an image, sRGB, `[height, width]`. `None` if the file is damaged.
pub(crate) fn decoded(file: &[u8]) -> Option<Image<[u8; 3]>> {
    if !is_possible(file) {
        return None;
    }
    let jpeg = Jpeg::read_header(file).ok()?;
    let (width, height) = jpeg.size();
    Image::from_pixels(width as usize, height as usize, jpeg.decode().ok()?).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(width: usize, height: usize) -> Image<[u8; 3]> {
        Image::from_fn(width, height, |column, row| [(column * 255 / width) as u8, (row * 255 / height) as u8, 90])
    }

    #[test]
    fn colours_are_kept_at_no_more_than_320_pixels() {
        for (size, expected) in [
            ((640, 480), (320, 240)),
            ((320, 240), (320, 240)),
            ((1440, 1920), (240, 320)),
            ((160, 120), (160, 120)),
            ((321, 7), (160, 3)),
            ((100_000, 2), (319, 1)),
            ((1, 1), (1, 1)),
        ] {
            let image = decoded(&encoded(&room(size.0, size.1))).unwrap();
            assert_eq!(image.size(), expected, "{size:?}");
        }
        let image = decoded(&encoded(&room(640, 480))).unwrap();
        let expected = room(320, 240);
        let differences = image.pixels().as_flattened().iter().zip(expected.pixels().as_flattened());
        assert!(differences.map(|(one, other)| one.abs_diff(*other)).max() < Some(8));
    }

    #[test]
    fn other_files_are_no_images() {
        let file = encoded(&room(64, 48));
        assert!(is_possible(&file) && !is_possible(&[]) && !is_possible(b"text"));
        let large = encode(&[[0; 3]; 400 * 10], 400, 10, QUALITY).unwrap();
        assert!(!is_possible(&large) && decoded(&large).is_none());
        assert!(decoded(&file[..file.len() / 2]).is_none(), "no part of a damaged image is returned");
    }
}
