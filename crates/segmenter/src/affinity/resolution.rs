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
    /// pixel. Depth is sampled, since a mean would invent depths between an object and its background.
    pub fn new(frame: &'a CameraFrame<'_>, max_pixels: usize) -> Self {
        let (width, height) = (frame.width(), frame.height());
        if width * height <= max_pixels {
            let (color, depth) = (frame.color().as_borrowed(), frame.depth().as_borrowed());
            return Self { color, depth, camera: *frame.intrinsics() };
        }
        let scale = (max_pixels as f64 / (width * height) as f64).sqrt();
        let smaller = |size: usize| ((size as f64 * scale) as usize).max(1);
        let (small_width, small_height) = (smaller(width), smaller(height));
        let depth = Image::from_fn(small_width, small_height, |column, row| {
            frame.depth()[(column * width / small_width, row * height / small_height)]
        });
        let color = area_means(frame.color(), small_width, small_height);
        Self { color, depth, camera: frame.intrinsics().resized(small_width, small_height) }
    }
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

    #[test]
    fn colors_are_means_over_areas() {
        let color = Image::from_fn(5, 2, |column, row| [(column * 10) as u8, (row * 100) as u8, 7]);
        // The left pixel covers columns 0, 1 and half of column 2.
        assert_eq!(area_means(&color, 2, 1).pixels(), [[8, 50, 7], [32, 50, 7]]);
        let even = Image::from_fn(4, 4, |column, row| [(10 * column + row) as u8; 3]);
        assert_eq!(area_means(&even, 2, 2).pixels()[3], [28; 3]);
    }
}
