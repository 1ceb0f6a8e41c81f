//! Positional encodings: sines over a map, random Fourier features, one-dimensional sines, and the
//! trunk's learned embedding (official `position_encoding.py`, `hieradet.py`).

use std::f32::consts::TAU;

/// Frequencies fall from 1 to 1 / TEMPERATURE.
const TEMPERATURE: f32 = 10000.0;

/// Divisor of positions in channel `channel` of `channels`.
fn wavelength(channel: usize, channels: usize) -> f32 {
    TEMPERATURE.powf(2.0 * (channel / 2) as f32 / channels as f32)
}

/// Sine encoding of a map's positions, normalised to 2π: `[height · width, channels]`, the first half of the channels
/// for rows and the second for columns, sines and cosines alternating.
pub fn sine_2d(height: usize, width: usize, channels: usize) -> Vec<f32> {
    let half = channels / 2;
    let wavelengths: Vec<f32> = (0..half).map(|channel| wavelength(channel, half)).collect();
    let axis = |length: usize| -> Vec<Vec<f32>> {
        (1..=length)
            .map(|position| {
                let position = position as f32 / (length as f32 + 1e-6) * TAU;
                let angles = wavelengths.iter().map(|wavelength| position / wavelength).enumerate();
                angles.map(|(channel, angle)| if channel % 2 == 0 { angle.sin() } else { angle.cos() }).collect()
            })
            .collect()
    };
    let (rows, columns) = (axis(height), axis(width));
    rows.iter().flat_map(|row| columns.iter().flat_map(|column| [row.as_slice(), column].concat())).collect()
}

/// Sine encoding of one number: all sines, then all cosines.
pub fn sine_1d(position: f32, channels: usize) -> Vec<f32> {
    let half = channels / 2;
    let angles: Vec<f32> = (0..half).map(|channel| position / wavelength(channel, half)).collect();
    angles.iter().map(|angle| angle.sin()).chain(angles.iter().map(|angle| angle.cos())).collect()
}

/// Random Fourier features of a point (x, y) in the unit square; `gaussian` is `[2, channels / 2]`.
pub fn random_fourier(x: f32, y: f32, gaussian: &[f32]) -> Vec<f32> {
    let (for_x, for_y) = gaussian.split_at(gaussian.len() / 2);
    let (x, y) = (2.0 * x - 1.0, 2.0 * y - 1.0);
    let angles: Vec<f32> = for_x.iter().zip(for_y).map(|(gx, gy)| TAU * (x * gx + y * gy)).collect();
    angles.iter().map(|angle| angle.sin()).chain(angles.iter().map(|angle| angle.cos())).collect()
}

/// The trunk's position embedding for a square map of `side` tokens, `[side · side, channels]`: `background`
/// (`[channels, size, size]`) enlarged by bicubic interpolation, plus `window` (`[channels, tile, tile]`) repeated.
pub fn windowed_embedding(background: &[f32], window: &[f32], channels: usize, side: usize) -> Vec<f32> {
    let tile = (window.len() / channels).isqrt();
    let mut embedding = enlarged_embedding(background, channels, side);
    for (token, values) in embedding.chunks_exact_mut(channels).enumerate() {
        let (row, column) = (token / side, token % side);
        for (channel, value) in values.iter_mut().enumerate() {
            *value += window[(channel * tile + row % tile) * tile + column % tile];
        }
    }
    embedding
}

/// A position embedding `[channels, size, size]`, enlarged by bicubic interpolation to a square map of `side` tokens,
/// `[side · side, channels]`.
pub fn enlarged_embedding(background: &[f32], channels: usize, side: usize) -> Vec<f32> {
    let size = (background.len() / channels).isqrt();
    let taps: Vec<_> = (0..side).map(|position| bicubic_taps(position, size, side)).collect();
    let mut embedding = Vec::with_capacity(side * side * channels);
    for row_taps in &taps {
        for column_taps in &taps {
            for channel in 0..channels {
                let plane = &background[channel * size * size..];
                let mut value = 0.0;
                for (source_row, row_weight) in row_taps {
                    let line = &plane[source_row * size..];
                    let along: f32 = column_taps.iter().map(|(source, weight)| line[*source] * weight).sum();
                    value += along * row_weight;
                }
                embedding.push(value);
            }
        }
    }
    embedding
}

/// Returns the four source positions and weights of cubic convolution with a = -0.75, pixel centres aligned, border
/// repeated.
fn bicubic_taps(position: usize, source: usize, target: usize) -> [(usize, f32); 4] {
    const A: f32 = -0.75;
    let at = source as f32 / target as f32 * (position as f32 + 0.5) - 0.5;
    let first = at.floor();
    let near = |x: f32| ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0;
    let far = |x: f32| ((A * x - 5.0 * A) * x + 8.0 * A) * x - 4.0 * A;
    let t = at - first;
    let weights = [far(t + 1.0), near(t), near(1.0 - t), far(2.0 - t)];
    std::array::from_fn(|tap| {
        let index = first as isize + tap as isize - 1;
        (index.clamp(0, source as isize - 1) as usize, weights[tap])
    })
}
