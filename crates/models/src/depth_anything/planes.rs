//! Images with a plane per channel, `[channels, height, width]`, between the layers of the decoder.

use rayon::prelude::*;
use splatseg_kernels::Activation;
use splatseg_kernels::convolution::PackedConvolution;

/// An image of several channels.
#[derive(Clone, Debug)]
pub(super) struct Planes {
    pub values: Vec<f32>,
    /// Height and width.
    pub size: [usize; 2],
}

impl Planes {
    /// From pixels `[height, width, channels · scale²]`, whose numbers are the squares of `scale` × `scale` pixels of each
    /// channel: `[channels, height · scale, width · scale]`.
    pub fn from_pixels(pixels: &[f32], [height, width]: [usize; 2], scale: usize) -> Self {
        let numbers = pixels.len() / (height * width);
        let square = scale * scale;
        let mut values = vec![0.0; pixels.len()];
        values.par_chunks_mut(height * width * square).enumerate().for_each(|(channel, plane)| {
            for (y, row) in plane.chunks_exact_mut(width * scale).enumerate() {
                for (x, value) in row.iter_mut().enumerate() {
                    let pixel = y / scale * width + x / scale;
                    *value = pixels[pixel * numbers + channel * square + y % scale * scale + x % scale];
                }
            }
        });
        Self { values, size: [height * scale, width * scale] }
    }

    /// The result of a convolution that keeps `outputs` channels and has the size `size`.
    pub fn convolved(&self, layer: &PackedConvolution, outputs: usize, size: [usize; 2]) -> Self {
        let mut values = vec![0.0; outputs * size[0] * size[1]];
        layer.forward(&[&self.values], self.size, &mut values);
        Self { values, size }
    }

    /// max(x, 0) of a copy.
    pub fn rectified(&self) -> Self {
        let mut copy = self.clone();
        Activation::Relu.apply_parallel(&mut copy.values);
        copy
    }

    /// Adds another image of the same shape.
    pub fn add(&mut self, other: &Self) {
        let pairs = self.values.par_chunks_mut(1 << 14).zip(other.values.par_chunks(1 << 14));
        pairs.for_each(|(values, others)| values.iter_mut().zip(others).for_each(|(value, other)| *value += other));
    }

    /// Bilinear interpolation to another size with the corners of both images at the same place: PyTorch's `interpolate`
    /// with `align_corners=True`.
    pub fn resized(&self, [height, width]: [usize; 2]) -> Self {
        let [own_height, own_width] = self.size;
        if self.size == [height, width] {
            return self.clone();
        }
        let (columns, rows) = (samples(own_width, width), samples(own_height, height));
        let channels = self.values.len() / (own_height * own_width);
        let mut values = vec![0.0; channels * height * width];
        let planes = values.par_chunks_mut(height * width).zip(self.values.par_chunks(own_height * own_width));
        planes.for_each_init(Vec::new, |wide, (out, plane)| {
            wide.clear();
            for row in plane.chunks_exact(own_width) {
                wide.extend(columns.iter().map(|sample| sample.between(row[sample.low], row[sample.high])));
            }
            for (out, sample) in out.chunks_exact_mut(width).zip(&rows) {
                let [low, high] = [sample.low, sample.high].map(|row| &wide[row * width..][..width]);
                for ((out, low), high) in out.iter_mut().zip(low).zip(high) {
                    *out = sample.between(*low, *high);
                }
            }
        });
        Self { values, size: [height, width] }
    }
}

/// An interpolation between two values.
struct Sample {
    low: usize,
    high: usize,
    weight: f32,
}

impl Sample {
    fn between(&self, low: f32, high: f32) -> f32 {
        (1.0 - self.weight) * low + self.weight * high
    }
}

fn samples(source: usize, target: usize) -> Vec<Sample> {
    let step = if target > 1 { (source - 1) as f32 / (target - 1) as f32 } else { 0.0 };
    (0..target)
        .map(|index| {
            let place = index as f32 * step;
            let low = (place as usize).min(source - 1);
            Sample { low, high: (low + 1).min(source - 1), weight: place - low as f32 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_stay_and_the_middle_is_interpolated() {
        let image = Planes { values: vec![0.0, 2.0, 4.0, 6.0], size: [2, 2] };
        let found = image.resized([3, 5]);
        assert_eq!(found.values[..5], [0.0, 0.5, 1.0, 1.5, 2.0]);
        assert_eq!(found.values[10..], [4.0, 4.5, 5.0, 5.5, 6.0]);
        assert_eq!(found.values[7], 3.0);
        assert_eq!(image.resized([1, 1]).values, [0.0]);
    }

    #[test]
    fn squares_of_pixels_are_put_into_planes() {
        // Two pixels in a row, with two channels of 2 x 2 pixels each.
        let pixels: Vec<f32> = (0..16).map(|value| value as f32).collect();
        let found = Planes::from_pixels(&pixels, [1, 2], 2);
        assert_eq!(found.size, [2, 4]);
        assert_eq!(found.values[..8], [0.0, 1.0, 8.0, 9.0, 2.0, 3.0, 10.0, 11.0]);
        assert_eq!(found.values[8..12], [4.0, 5.0, 12.0, 13.0]);
    }
}
