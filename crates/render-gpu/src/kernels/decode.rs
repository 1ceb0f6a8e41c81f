//! Rendered features and the segments that they stand for (`splatseg_memory`'s `features/decoding.rs`).

use super::blend::pixel_of;
use super::camera::{View, round_half_up};
use super::expect::PixelSums;
use super::forget::GROWN;
use super::tile::{PixelReader, PixelReaderExpand, TilePairs, read_tile};
use cubecl::prelude::*;

/// No product of a finite feature is larger.
const LARGEST: f32 = 3e38;

/// The settings of the memory that decoding depends on; see `splatseg_memory::MemorySettings`.
#[derive(CubeLaunch, CubeType, Clone, Copy)]
pub(crate) struct DecodeRule {
    /// What lies up to this behind the frame's surface counts as that surface, metres.
    pub depth_disparity: f32,
    /// The best product must exceed this.
    pub threshold: f32,
    /// A feature whose square is below this has no product that exceeds the threshold, whatever is rounded.
    pub least_square: f32,
    /// Codes that belong to segments.
    pub used: u32,
}

/// The sum of the squares of a feature.
#[cube]
pub(crate) fn square_of(feature: &Array<f32>, #[comptime] dim: usize) -> f32 {
    let mut square = 0.0f32;
    for channel in 0..dim {
        square += feature[channel] * feature[channel];
    }
    square
}

/// The segment whose code has the largest product with a feature, the first of equal ones; 0 for none.
#[cube]
fn decoded(feature: &Array<f32>, codes: &[f32], rule: &DecodeRule, #[comptime] dim: usize) -> u32 {
    let mut segment = 0u32;
    if comptime!(dim == 1) {
        let id = round_half_up(feature[0]);
        if id >= 1.0 && id <= f32::cast_from(rule.used) {
            segment = u32::cast_from(id);
        }
    } else if square_of(feature, dim) >= rule.least_square {
        let mut best = rule.threshold;
        for code in 0..rule.used {
            let from = code as usize * dim;
            let mut product = 0.0f32;
            for channel in 0..dim {
                product += feature[channel] * codes[from + channel];
            }
            if product > best {
                best = product;
                segment = code + 1;
            }
        }
        if best > LARGEST {
            segment = 0u32;
        }
    }
    segment
}

/// The features of Gaussians, `[gaussians, dim]`.
#[derive(CubeLaunch, CubeType)]
pub(crate) struct FeatureColumn {
    pub features: Box<[f32]>,
}

/// The rendered feature of a pixel while it is summed up.
#[derive(CubeType)]
struct PixelFeature {
    sums: PixelSums,
    feature: Array<f32>,
    disparity: f32,
    #[cube(comptime)]
    dim: usize,
}

#[cube]
impl PixelReader for PixelFeature {
    type Remembered = FeatureColumn;

    fn add(&mut self, remembered: &FeatureColumn, gaussian: usize, weight: f32, depth: f32) {
        self.sums.add(weight, depth, self.disparity);
        let from = gaussian * self.dim;
        for channel in 0..self.dim {
            self.feature[channel] += weight * remembered.features[from + channel];
        }
    }
}

/// Blends each tile and decodes its features. Pairs that no pixel shows are dropped from `tiles`. `rendered` becomes `[height,
/// width, dim]`.
#[cube(launch)]
pub(crate) fn expect_features(
    tiles: TilePairs,
    remembered: FeatureColumn,
    codes: &[f32],
    depth: &[f32],
    images: &mut [u32],
    surfaces: &mut [u32],
    rendered: &mut [f32],
    view: View,
    rule: DecodeRule,
    #[comptime] dim: usize,
) {
    let pixel = pixel_of(CUBE_POS as u32, &view);
    let mut feature = Array::<f32>::new(dim);
    for channel in 0..dim {
        feature[channel] = 0.0f32;
    }
    let mut read = PixelFeature { sums: PixelSums::new(&pixel, depth), feature, disparity: rule.depth_disparity, dim };
    read_tile::<PixelFeature>(tiles, &view, &remembered, &mut read);
    if pixel.is_inside {
        let pixels = (view.width * view.height) as usize;
        let at = pixel.index;
        read.sums.write(at, pixels, images, surfaces);
        let segment = decoded(&read.feature, codes, &rule, dim);
        let mut confidence = f32::sqrt(square_of(&read.feature, dim));
        if comptime!(dim == 1) {
            // An integer id has no length: its confidence is 1 or 0.
            confidence = select(segment != 0, 1.0, 0.0);
        }
        images[at] = segment;
        images[pixels + at] = u32::reinterpret(confidence);
        for channel in 0..dim {
            rendered[at * dim + channel] = read.feature[channel];
        }
    }
}

/// The segment that each Gaussian shows by itself.
#[cube(launch)]
pub(crate) fn decode_gaussians(
    features: &[f32],
    codes: &[f32],
    segments: &mut [u32],
    rule: DecodeRule,
    count: u32,
    #[comptime] dim: usize,
) {
    if ABSOLUTE_POS < count as usize {
        let mut feature = Array::<f32>::new(dim);
        for channel in 0..dim {
            feature[channel] = features[ABSOLUTE_POS * dim + channel];
        }
        segments[ABSOLUTE_POS] = decoded(&feature, codes, &rule, dim);
    }
}

/// Writes the features of the Gaussians that have grown behind the first `first`: those of their `pixels` in `target`
/// `[2, height, width]`, a segment and its confidence.
#[cube(launch)]
pub(crate) fn first_features(
    pixels: &[u32],
    target: &[u32],
    codes: &[f32],
    features: &mut [f32],
    report: &[u32],
    image: u32,
    first: u32,
    #[comptime] dim: usize,
) {
    if ABSOLUTE_POS < report[GROWN] as usize {
        let to = (first as usize + ABSOLUTE_POS) * dim;
        let pixel = pixels[ABSOLUTE_POS] as usize;
        let segment = target[pixel];
        let mut confidence = 1.0f32;
        if !comptime!(dim == 1) {
            confidence = f32::reinterpret(target[image as usize + pixel]);
        }
        for channel in 0..dim {
            let mut value = 0.0f32;
            if segment > 0 {
                value = confidence * codes[(segment as usize - 1) * dim + channel];
            }
            features[to + channel] = value;
        }
    }
}
