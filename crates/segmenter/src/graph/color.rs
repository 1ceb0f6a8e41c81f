//! Edge-preserving smoothing in CIELAB.

use rayon::prelude::*;
use splatseg_geometry::{CowImage, Image};

/// CIELAB colour (D65 white): L in [0, 100], a and b about [-100, 100].
pub(super) type Lab = [f32; 3];

/// Euclidean distance of two colours (CIE76 ΔE). The difference in lightness is multiplied by `lightness`, since
/// shading changes the lightness within an object.
pub(super) fn difference(first: Lab, second: Lab, lightness: f32) -> f32 {
    let [l, a, b] = [0, 1, 2].map(|channel| first[channel] - second[channel]);
    (l * l * lightness * lightness + a * a + b * b).sqrt()
}

/// Converts the image to CIELAB and smooths it. Every pixel becomes a weighted mean of its 5×5 neighbourhood. Weights
/// decrease to 0 at a colour distance of `range` (Tukey's biweight).
pub(super) fn smoothed_lab(color: &CowImage<'_, [u8; 3]>, range: f32) -> Image<Lab> {
    let (width, height) = color.size();
    let linear: Vec<f32> = (0..256).map(|value| linear_from_srgb(value as f32 / 255.0)).collect();
    let lab: Vec<Lab> = color.pixels().par_iter().with_min_len(4096).map(|rgb| lab_from_rgb(*rgb, &linear)).collect();
    let mut smooth = Image::filled(width, height, [0.0; 3]);
    let inverse_range = 1.0 / (range * range);
    smooth.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, line)| {
        for (column, out) in line.iter_mut().enumerate() {
            let center = lab[row * width + column];
            let (mut sum, mut total) = ([0.0f32; 3], 0.0f32);
            for near_row in row.saturating_sub(2)..(row + 3).min(height) {
                let start = near_row * width;
                for near in &lab[start + column.saturating_sub(2)..start + (column + 3).min(width)] {
                    let [l, a, b] = [near[0] - center[0], near[1] - center[1], near[2] - center[2]];
                    let closeness = (1.0 - (l * l + a * a + b * b) * inverse_range).max(0.0);
                    let weight = closeness * closeness;
                    for channel in 0..3 {
                        sum[channel] += weight * near[channel];
                    }
                    total += weight;
                }
            }
            // The pixel itself always has weight 1.
            *out = sum.map(|channel| channel / total);
        }
    });
    smooth
}

fn linear_from_srgb(value: f32) -> f32 {
    if value <= 0.04045 { value / 12.92 } else { ((value + 0.055) / 1.055).powf(2.4) }
}

fn lab_from_rgb(rgb: [u8; 3], linear: &[f32]) -> Lab {
    let [r, g, b] = rgb.map(|value| linear[usize::from(value)]);
    // Rows of the sRGB to XYZ matrix, divided by the D65 white point.
    let x = 0.433_953 * r + 0.376_219 * g + 0.189_828 * b;
    let y = 0.212_671 * r + 0.715_160 * g + 0.072_169 * b;
    let z = 0.017_758 * r + 0.109_477 * g + 0.872_765 * b;
    let [fx, fy, fz] = [x, y, z].map(|t| if t > 0.008_856 { t.cbrt() } else { 7.787 * t + 16.0 / 116.0 });
    [116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_colors() {
        let image = Image::from_pixels(3, 1, vec![[255, 255, 255], [0, 0, 0], [255, 0, 0]]).unwrap();
        let lab = smoothed_lab(&image, 10.0);
        let expected = [[100.0, 0.0, 0.0], [0.0, 0.0, 0.0], [53.24, 80.09, 67.2]];
        for (found, expected) in lab.pixels().iter().zip(expected) {
            assert!(difference(*found, expected, 1.0) < 0.2, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn smoothing_keeps_edges_and_removes_noise() {
        let image = Image::from_fn(12, 6, |column, row| {
            let noise = if (column + row) % 2 == 0 { 3 } else { 0 };
            if column < 6 { [60 + noise; 3] } else { [160 + noise; 3] }
        });
        let lab = smoothed_lab(&image, 12.0);
        assert!((lab[(2, 3)][0] - lab[(3, 3)][0]).abs() < 0.3);
        assert!(lab[(6, 3)][0] - lab[(5, 3)][0] > 35.0);
    }
}
