//! Letterboxing: from an image to the network's input.

use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image};

/// Sides of the network's input are multiples of this.
pub(super) const INPUT_MULTIPLE: usize = 32;

/// Grey level of the padding.
const PADDING: u8 = 114;

/// Bits of the fixed-point weights of the resize.
const WEIGHT_ONE: f32 = 2048.0;

/// Scales an image to fit a square and pads it to the network's input, like Ultralytics' `LetterBox` (`rect`: pads only
/// to the next multiple of 32).
///
/// `image_size` is the side of the square in pixels; small images are scaled up.
pub fn letterbox(image: &CowImage<'_, [u8; 3]>, image_size: usize) -> Image<[u8; 3]> {
    let (width, height) = image.size();
    let ratio = (image_size as f64 / height as f64).min(image_size as f64 / width as f64);
    // Python rounds halves to even.
    let scaled = |side: usize| ((side as f64 * ratio).round_ties_even() as usize).clamp(1, image_size);
    let (new_width, new_height) = (scaled(width), scaled(height));
    let padding = |side: usize| {
        let half = ((image_size - side) % INPUT_MULTIPLE) as f64 / 2.0;
        [(half - 0.1).round_ties_even() as usize, (half + 0.1).round_ties_even() as usize]
    };
    let ([left, right], [top, bottom]) = (padding(new_width), padding(new_height));
    let resized =
        if (new_width, new_height) == (width, height) { image } else { &resize(image, new_width, new_height) };
    let mut padded = Image::filled(new_width + left + right, new_height + top + bottom, [PADDING; 3]);
    let padded_width = padded.width();
    for row in 0..new_height {
        let start = (row + top) * padded_width + left;
        padded.pixels_mut()[start..start + new_width].copy_from_slice(resized.row(row));
    }
    padded
}

/// Converts the letterboxed image to the network's input: RGB planes `[3, height, width]` in [0, 1].
pub fn input_values(image: &CowImage<'_, [u8; 3]>) -> Vec<f32> {
    (0..3).flat_map(|channel| image.pixels().iter().map(move |pixel| f32::from(pixel[channel]) / 255.0)).collect()
}

/// Two neighbouring samples and their weights, which sum to 2048 up to rounding.
#[derive(Clone, Copy, Debug)]
struct Tap {
    first: i64,
    weights: [i32; 2],
}

/// Returns the taps of OpenCV's linear resize of a line from `from` pixels to `to`.
fn taps(from: usize, to: usize) -> Vec<Tap> {
    let scale = 1.0 / (to as f64 / from as f64);
    (0..to)
        .map(|pixel| {
            let position = ((pixel as f64 + 0.5) * scale - 0.5) as f32;
            let first = position.floor();
            let fraction = position - first;
            let weight = |share: f32| (share * WEIGHT_ONE).round_ties_even() as i32;
            Tap { first: first as i64, weights: [weight(1.0 - fraction), weight(fraction)] }
        })
        .collect()
}

/// `cv2.resize(…, INTER_LINEAR)` on 8-bit pixels, bit for bit: 11-bit weights, with intermediate results rounded down.
fn resize(image: &CowImage<'_, [u8; 3]>, width: usize, height: usize) -> Image<[u8; 3]> {
    let last_column = image.width() as i64 - 1;
    let columns: Vec<(usize, usize, [i32; 2])> = taps(image.width(), width)
        .into_iter()
        .map(|tap| match tap.first {
            // At the border, one column has all the weight. Rows (below) keep both weights, applied to the same pixel.
            first if first < 0 => (0, 0, [WEIGHT_ONE as i32, 0]),
            first if first >= last_column => (last_column as usize, last_column as usize, [WEIGHT_ONE as i32, 0]),
            first => (first as usize, first as usize + 1, tap.weights),
        })
        .collect();
    let last_row = image.height() as i64 - 1;
    let rows = taps(image.height(), height);
    let mut resized = Image::filled(width, height, [0; 3]);
    resized.pixels_mut().par_chunks_mut(width).zip(rows).for_each(|(output, tap)| {
        let source = |row: i64| image.row(row.clamp(0, last_row) as usize);
        let (above, below) = (source(tap.first), source(tap.first + 1));
        for (pixel, (first, second, weights)) in output.iter_mut().zip(&columns) {
            for channel in 0..3 {
                let across = |row: &[[u8; 3]]| {
                    weights[0] * i32::from(row[*first][channel]) + weights[1] * i32::from(row[*second][channel])
                };
                let part = |weight: i32, row: &[[u8; 3]]| (weight * (across(row) >> 4)) >> 16;
                let value = (part(tap.weights[0], above) + part(tap.weights[1], below) + 2) >> 2;
                pixel[channel] = value.clamp(0, 255) as u8;
            }
        }
    });
    resized
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn sizes_match_the_reference() {
        for (size, image_size, expected) in [
            ((310, 230), 640, (640, 480)),
            ((310, 230), 1024, (1024, 768)),
            ((640, 480), 640, (640, 480)),
            ((320, 240), 320, (320, 256)),
            ((1, 4000), 320, (32, 320)),
        ] {
            assert_eq!(letterbox(&Image::filled(size.0, size.1, [7; 3]), image_size).size(), expected);
        }
    }

    proptest! {
        #[test]
        fn inputs_are_padded_to_multiples_of_32_and_keep_flat_colours(
            width in 1usize..90, height in 1usize..90, image_size in 1usize..6,
        ) {
            let input = letterbox(&Image::filled(width, height, [9, 120, 255]), 32 * image_size);
            prop_assert!(input.width().is_multiple_of(32) && input.height().is_multiple_of(32));
            prop_assert_eq!(input.width().max(input.height()), 32 * image_size);
            prop_assert!(input.pixels().iter().all(|pixel| *pixel == [9, 120, 255] || *pixel == [PADDING; 3]));
        }
    }
}
