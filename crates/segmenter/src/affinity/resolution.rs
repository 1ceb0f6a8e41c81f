//! Downscaling of large frames.

use rayon::prelude::*;
use splatseg_geometry::{CameraFrame, CowImage, Image, Intrinsics};

/// A frame at its own or a lower resolution.
pub(super) struct ScaledFrame<'a> {
    pub color: CowImage<'a, [u8; 3]>,
    /// z-depth, metres; 0 where missing.
    pub depth: CowImage<'a, f32>,
    pub camera: Intrinsics,
}

impl<'a> ScaledFrame<'a> {
    /// Reduces the frame to at most `max_pixels`, keeping its aspect ratio. Colour is averaged over the area of each
    /// pixel. Depth is that of the pixel nearest to the new one's centre, halfway the left or upper one, since a mean would
    /// invent depths between an object and its background.
    pub fn new(frame: &'a CameraFrame<'_>, max_pixels: usize) -> Self {
        let (width, height) = (frame.width(), frame.height());
        if width * height <= max_pixels {
            let (color, depth) = (frame.color().as_borrowed(), frame.depth().as_borrowed());
            return Self { color, depth, camera: *frame.intrinsics() };
        }
        let scale = (max_pixels as f64 / (width * height) as f64).sqrt();
        let smaller = |size: usize| ((size as f64 * scale) as usize).max(1);
        let (small_width, small_height) = (smaller(width), smaller(height));
        let (columns, rows) = (nearest(width, small_width), nearest(height, small_height));
        let depth =
            Image::from_fn(small_width, small_height, |column, row| frame.depth()[(columns[column], rows[row])]);
        let color = area_means(frame.color(), small_width, small_height);
        Self { color, depth, camera: frame.intrinsics().resized(small_width, small_height) }
    }
}

/// For each pixel of an axis with `to` pixels, the nearest one of the same axis with `from`; halfway the first.
fn nearest(from: usize, to: usize) -> Vec<usize> {
    (0..to).map(|pixel| ((2 * pixel + 1) * from - 1) / (2 * to)).collect()
}

/// Scales the colour image down to the rounded mean over the area of each new pixel.
fn area_means(color: &CowImage<'_, [u8; 3]>, width: usize, height: usize) -> Image<[u8; 3]> {
    let columns: Vec<Span> = (0..width).map(|index| Span::new(index, color.width(), width)).collect();
    let mut pixels = vec![[0; 3]; width * height];
    pixels.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
        let rows = Span::new(row, color.height(), height);
        let mut sums = vec![0.0; 3 * color.width()];
        for (source, weight) in rows.weights() {
            for (sum, value) in sums.iter_mut().zip(color.row(source).as_flattened()) {
                *sum += weight * f32::from(*value);
            }
        }
        let sums = sums.as_chunks::<3>().0;
        for (out, span) in out.iter_mut().zip(&columns) {
            let mut mean = [0.5; 3];
            for (column, weight) in span.weights() {
                (0..3).for_each(|channel| mean[channel] += weight * sums[column][channel]);
            }
            *out = mean.map(|mean| mean as u8);
        }
    });
    Image::from_pixels(width, height, pixels).unwrap_or_else(|_| Image::filled(0, 0, [0; 3]))
}

/// The interval of an image axis covered by one pixel of a smaller image.
struct Span {
    start: f32,
    end: f32,
}

impl Span {
    fn new(index: usize, from: usize, to: usize) -> Self {
        let scale = from as f64 / to as f64;
        let end = ((index + 1) as f64 * scale).min(from as f64);
        Self { start: (index as f64 * scale) as f32, end: end as f32 }
    }

    /// The pixels of the larger image with their fractions of the span.
    fn weights(&self) -> impl Iterator<Item = (usize, f32)> + use<> {
        let Self { start, end } = *self;
        let pixels = start as usize..end.ceil() as usize;
        pixels.map(move |pixel| {
            let covered = end.min((pixel + 1) as f32) - start.max(pixel as f32);
            (pixel, covered.max(0.0) / (end - start))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec2;

    #[test]
    fn depth_and_camera_show_the_same_place() {
        let camera = Intrinsics { fx: 400.0, fy: 400.0, cx: 330.0, cy: 190.0, width: 640, height: 400 };
        let color = Image::filled(640, 400, [9; 3]);
        // The pixel of each depth.
        let depth = Image::from_fn(640, 400, |column, row| (1 + column + 640 * row) as f32);
        let frame = CameraFrame::new("0", color, depth, camera).unwrap();
        // Reduced by 2, about 2.9 and about 4.3.
        for (max_pixels, width) in [(320 * 200, 320), (30_000, 219), (14_000, 149)] {
            let small = ScaledFrame::new(&frame, max_pixels);
            assert_eq!(small.depth.width(), width);
            let (mut sum, mut largest) = (Vec2::ZERO, 0.0_f32);
            for row in 0..small.depth.height() {
                for column in 0..width {
                    let place = small.depth[(column, row)] as usize - 1;
                    let seen = camera.unproject(Vec2::new((place % 640) as f32, (place / 640) as f32), 1.0);
                    let shift = small.camera.project(seen).unwrap() - Vec2::new(column as f32, row as f32);
                    sum += shift;
                    largest = largest.max(shift.abs().max_element());
                }
            }
            // Half a pixel of the frame at most, since there is none in between; on average less, except at 2.
            assert!(largest <= 0.5 * width as f32 / 640.0 + 0.01, "{max_pixels}: {largest}");
            let mean = (sum / (width * small.depth.height()) as f32).abs().max_element();
            assert!(width == 320 || mean < 0.06, "{max_pixels}: {mean}");
        }
    }

    #[test]
    fn the_first_of_two_equally_near_pixels_is_taken() {
        assert_eq!(nearest(8, 4), [0, 2, 4, 6]);
        assert_eq!(nearest(9, 3), [1, 4, 7]);
        assert_eq!(nearest(3, 2), [0, 2]);
        assert_eq!(nearest(8, 2), [1, 5]);
    }

    #[test]
    fn colors_are_means_over_areas() {
        let color = Image::from_fn(5, 2, |column, row| [(column * 10) as u8, (row * 100) as u8, 7]);
        // The left pixel covers columns 0, 1 and half of column 2.
        assert_eq!(area_means(&color, 2, 1).pixels(), [[8, 50, 7], [32, 50, 7]]);
        let even = Image::from_fn(4, 4, |column, row| [(10 * column + row) as u8; 3]);
        assert_eq!(area_means(&even, 2, 2).pixels()[3], [28; 3]);
    }
}
