//! Sizes of the network's input, and cubic interpolation: of images, and of position embeddings.

use rayon::prelude::*;
use splatseg_geometry::CowImage;

/// Mean and standard deviation of the images that the networks were trained with, of channels from 0 to 1.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const DEVIATION: [f32; 3] = [0.229, 0.224, 0.225];

/// The long side of the input is at most this many times the short one.
const MAX_ASPECT: usize = 4;

/// The size `(width, height)` at which an image of `size` is processed: the short side is `short_side`, a multiple of
/// `patch`, and the long one the multiple that keeps the aspect ratio best, as in the official code.
pub(super) fn input_size((width, height): (usize, usize), short_side: usize, patch: usize) -> (usize, usize) {
    let short_side = (short_side / patch).max(1) * patch;
    let (short, long) = (width.min(height).max(1), width.max(height));
    let patches = (long as f64 * short_side as f64 / (short * patch) as f64).round_ties_even() as usize;
    let long_side = (patches * patch).clamp(short_side, MAX_ASPECT * short_side);
    if width <= height { (short_side, long_side) } else { (long_side, short_side) }
}

/// Weighted sources of one target position.
pub(super) type Taps = Vec<(usize, f32)>;

/// Cubic convolution with the parameter `a`.
fn cubic(a: f64, x: f64) -> f64 {
    let x = x.abs();
    match () {
        () if x < 1.0 => ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0,
        () if x < 2.0 => (((x - 5.0) * x + 8.0) * x - 4.0) * a,
        () => 0.0,
    }
}

/// Taps of PyTorch's `interpolate` with `mode="bicubic"`, whose factor of the size is `factor`: the border is repeated.
pub(super) fn plain_taps(source: usize, target: usize, factor: f64) -> Vec<Taps> {
    let taps = |position: usize| {
        let centre = (position as f64 + 0.5) / factor - 0.5;
        let first = centre.floor();
        let tap = |offset: i32| {
            let at = first + f64::from(offset);
            (at.clamp(0.0, (source - 1) as f64) as usize, cubic(-0.75, centre - at) as f32)
        };
        (-1..=2).map(tap).collect()
    };
    (0..target).map(taps).collect()
}

/// Taps of a filter that widens when the image is reduced, as in Pillow and in Hugging Face's processor.
fn widened_taps(source: usize, target: usize) -> Vec<Taps> {
    let scale = source as f64 / target as f64;
    let widening = scale.max(1.0);
    let taps = |position: usize| {
        let centre = (position as f64 + 0.5) * scale;
        let first = (centre - 2.0 * widening + 0.5).max(0.0) as usize;
        let end = ((centre + 2.0 * widening + 0.5) as usize).min(source);
        let raw: Vec<f64> = (first..end).map(|at| cubic(-0.5, (at as f64 - centre + 0.5) / widening)).collect();
        let sum: f64 = raw.iter().sum();
        (first..end).zip(raw.iter().map(|weight| (weight / sum) as f32)).collect()
    };
    (0..target).map(taps).collect()
}

/// Interpolates `values` `[height, width, channels]` along rows and then along columns: `[rows, columns, channels]`.
pub(super) fn interpolate(values: &[f32], width: usize, channels: usize, columns: &[Taps], rows: &[Taps]) -> Vec<f32> {
    let mut wide = vec![0.0; values.len() / width * columns.len()];
    let lines = wide.par_chunks_mut(columns.len() * channels).zip(values.par_chunks(width * channels));
    lines.for_each(|(out, line)| {
        for (out, taps) in out.chunks_exact_mut(channels).zip(columns) {
            for (at, weight) in taps {
                let pixel = &line[at * channels..][..channels];
                out.iter_mut().zip(pixel).for_each(|(out, value)| *out += weight * value);
            }
        }
    });
    let line = columns.len() * channels;
    let mut result = vec![0.0; rows.len() * line];
    result.par_chunks_mut(line).zip(rows).for_each(|(out, taps)| {
        for (at, weight) in taps {
            let values = &wide[at * line..][..line];
            out.iter_mut().zip(values).for_each(|(out, value)| *out += weight * value);
        }
    });
    result
}

/// An image at the network's size `(width, height)`, normalised: `[height, width, 3]`.
pub(super) fn input(image: &CowImage<'_, [u8; 3]>, (width, height): (usize, usize)) -> Vec<f32> {
    let normalised = |pixel: &[u8; 3]| -> [f32; 3] {
        std::array::from_fn(|channel| (f32::from(pixel[channel]) / 255.0 - MEAN[channel]) / DEVIATION[channel])
    };
    let values: Vec<f32> = image.pixels().iter().flat_map(normalised).collect();
    if image.size() == (width, height) {
        return values;
    }
    let (columns, rows) = (widened_taps(image.width(), width), widened_taps(image.height(), height));
    interpolate(&values, image.width(), 3, &columns, &rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_short_side_is_kept_and_the_long_one_follows() {
        assert_eq!(input_size((640, 480), 518, 14), (686, 518));
        assert_eq!(input_size((480, 640), 250, 14), (238, 322));
        assert_eq!(input_size((100, 100), 3, 14), (14, 14));
        assert_eq!(input_size((10_000, 10), 28, 14), (112, 28));
    }

    #[test]
    fn a_plane_stays_a_plane() {
        let plane = |x: f32, y: f32| 0.5 * x - 0.25 * y + 3.0;
        let values: Vec<f32> = (0..24 * 32).map(|at| plane((at % 32) as f32, (at / 32) as f32)).collect();
        let found = interpolate(&values, 32, 1, &widened_taps(32, 16), &widened_taps(24, 30));
        for (row, column) in [(10, 5), (15, 8), (20, 11)] {
            let expected = plane((column as f32 + 0.5) * 2.0 - 0.5, (row as f32 + 0.5) * 0.8 - 0.5);
            let found = found[row * 16 + column];
            assert!((found - expected).abs() < 1e-3, "{row}, {column}: {found}, expected {expected}");
        }
    }

    /// PyTorch's parameter -0.75 keeps constants and, unlike -0.5, no slopes.
    #[test]
    fn a_constant_stays_a_constant() {
        for (source, target) in [(37, 18), (37, 52), (3, 7)] {
            for taps in plain_taps(source, target, target as f64 / source as f64) {
                let sum: f32 = taps.iter().map(|(_, weight)| weight).sum();
                assert!((sum - 1.0).abs() < 1e-6 && taps.iter().all(|(at, _)| *at < source), "{taps:?}");
            }
        }
    }
}
