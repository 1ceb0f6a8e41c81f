//! Resizing of frames and masks, with the filters and rounding of the official code.

use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image};

/// A size in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Size {
    pub width: usize,
    pub height: usize,
}

/// Weighted sources of one target position: `weights[i]` belongs to source `first + i`.
struct Taps {
    first: usize,
    weights: Vec<f64>,
}

/// Taps of a filter with the given `support`, widened if the target is smaller (as in Pillow, and in PyTorch with
/// `antialias`).
fn antialiased_taps(source: usize, target: usize, support: f64, filter: impl Fn(f64) -> f64) -> Vec<Taps> {
    let scale = source as f64 / target as f64;
    let widening = scale.max(1.0);
    let reach = support * widening;
    let taps = |position: usize| {
        let centre = (position as f64 + 0.5) * scale;
        let first = (centre - reach + 0.5).max(0.0) as usize;
        let end = ((centre + reach + 0.5) as usize).min(source);
        let raw: Vec<f64> = (first..end).map(|at| filter((at as f64 - centre + 0.5) / widening)).collect();
        let sum: f64 = raw.iter().sum();
        Taps { first, weights: raw.iter().map(|weight| weight / sum).collect() }
    };
    (0..target).map(taps).collect()
}

fn triangle(x: f64) -> f64 {
    (1.0 - x.abs()).max(0.0)
}

/// Cubic convolution with a = -0.5.
fn cubic(x: f64) -> f64 {
    const A: f64 = -0.5;
    let x = x.abs();
    if x < 1.0 {
        ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0
    } else if x < 2.0 {
        (((x - 5.0) * x + 8.0) * x - 4.0) * A
    } else {
        0.0
    }
}

/// Pillow's bicubic resize of an 8-bit image to a square, in fixed point: rows first, rounded to 8 bits, then columns.
pub(super) fn resize_frame(image: &CowImage<'_, [u8; 3]>, side: usize) -> Image<[u8; 3]> {
    const PRECISION: u32 = 22;
    let fixed = |taps: Vec<Taps>| -> Vec<(usize, Vec<i64>)> {
        let round = |weight: &f64| (weight * f64::from(1u32 << PRECISION)).round() as i64;
        taps.iter().map(|taps| (taps.first, taps.weights.iter().map(round).collect())).collect()
    };
    let columns = fixed(antialiased_taps(image.width(), side, 2.0, cubic));
    let rows = fixed(antialiased_taps(image.height(), side, 2.0, cubic));
    let finish = |sum: i64| (sum >> PRECISION).clamp(0, 255) as u8;
    const HALF: i64 = 1 << (PRECISION - 1);

    let mut narrow = vec![[0u8; 3]; image.height() * side];
    narrow.par_chunks_mut(side).enumerate().for_each(|(row, out)| {
        let line = image.row(row);
        for (out, (first, weights)) in out.iter_mut().zip(&columns) {
            let mut sums = [HALF; 3];
            for (pixel, weight) in line[*first..].iter().zip(weights) {
                (0..3).for_each(|channel| sums[channel] += i64::from(pixel[channel]) * weight);
            }
            *out = sums.map(finish);
        }
    });
    let mut out = vec![[0u8; 3]; side * side];
    out.par_chunks_mut(side).zip(&rows).for_each(|(out, (first, weights))| {
        for (column, out) in out.iter_mut().enumerate() {
            let mut sums = [HALF; 3];
            for (line, weight) in narrow[first * side..].chunks_exact(side).zip(weights) {
                (0..3).for_each(|channel| sums[channel] += i64::from(line[column][channel]) * weight);
            }
            *out = sums.map(finish);
        }
    });
    // `out` was made with side times side values.
    Image::from_pixels(side, side, out).expect("one pixel per position")
}

/// Mean and standard deviation of colours used in training.
const MEAN: [f32; 3] = [0.485, 0.456, 0.406];
const STD: [f32; 3] = [0.229, 0.224, 0.225];

/// Normalises a frame of the network's size to its input, `[3, height, width]`.
pub(super) fn normalise(image: &CowImage<'_, [u8; 3]>) -> Vec<f32> {
    let plane = |channel: usize| {
        image.pixels().iter().map(move |pixel| (f32::from(pixel[channel]) / 255.0 - MEAN[channel]) / STD[channel])
    };
    (0..3).flat_map(plane).collect()
}

/// Bilinear resize of a `[height, width]` map, with the filter widened when shrinking (PyTorch's `antialias`).
pub(super) fn resize_antialiased(map: &[f32], from: Size, to: Size) -> Vec<f32> {
    let columns = antialiased_taps(from.width, to.width, 1.0, triangle);
    let rows = antialiased_taps(from.height, to.height, 1.0, triangle);
    let along = |taps: &Taps, value: &dyn Fn(usize) -> f32| -> f32 {
        taps.weights.iter().enumerate().map(|(tap, weight)| value(taps.first + tap) * *weight as f32).sum()
    };
    let narrow: Vec<f32> = map
        .chunks_exact(from.width)
        .flat_map(|line| columns.iter().map(move |taps| along(taps, &|at| line[at])))
        .collect();
    rows.iter()
        .flat_map(|taps| {
            let narrow = &narrow;
            (0..to.width).map(move |column| along(taps, &|at| narrow[at * to.width + column]))
        })
        .collect()
}

/// Bilinear resize of a `[height, width]` map, pixel centres aligned, border repeated (PyTorch without `antialias`).
pub(super) fn resize_bilinear(map: &[f32], from: Size, to: Size) -> Vec<f32> {
    let columns = bilinear_taps(from.width, to.width);
    let rows = bilinear_taps(from.height, to.height);
    let mut out = Vec::with_capacity(to.width * to.height);
    for (upper, lower, down) in rows {
        let (upper, lower) = (&map[upper * from.width..], &map[lower * from.width..]);
        for (left, right, across) in &columns {
            let above = upper[*left] * (1.0 - across) + upper[*right] * across;
            let below = lower[*left] * (1.0 - across) + lower[*right] * across;
            out.push(above * (1.0 - down) + below * down);
        }
    }
    out
}

/// The two source positions of every target position, and the weight of the second.
fn bilinear_taps(source: usize, target: usize) -> Vec<(usize, usize, f32)> {
    let scale = source as f32 / target as f32;
    let taps = |position: usize| {
        let at = ((position as f32 + 0.5) * scale - 0.5).max(0.0);
        let first = (at as usize).min(source - 1);
        (first, (first + 1).min(source - 1), at - first as f32)
    };
    (0..target).map(taps).collect()
}
