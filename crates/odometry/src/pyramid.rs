//! Grey values and depth of a frame at several resolutions.

use glam::Vec2;
use rayon::prelude::*;
use splatseg_geometry::{CameraFrame, Image, Intrinsics};

/// Levels are added while the coarsest one is at least this wide and high twice over, pixels.
pub(crate) const MIN_SIDE: usize = 24;

/// Depths of neighbours that differ by more than this fraction belong to different surfaces.
const SAME_SURFACE: f32 = 0.05;

/// An image whose luminance deviates less than this from its mean shows nothing.
const MIN_CONTRAST: f32 = 4.0;

/// Images with a smaller mean luminance are dark: they are brightened to it, so that the limits for images hold, which are
/// on the scale of 0 to 255.
const DARK: f32 = 40.0;

/// Images are not brightened by more than this.
const MAX_BRIGHTENING: f32 = 16.0;

/// Unit of stored depth, metres: far below any sensor's noise.
const DEPTH_STEP: f32 = 0.000_25;

/// The part of a frame that odometry uses, in three bytes per pixel.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct GreyFrame {
    /// Luminance, `[height, width]`, brightened where the image is dark.
    pub(crate) grey: Image<u8>,
    /// z-depth in units of [`DEPTH_STEP`], `[height, width]`; 0 where missing or beyond 16 m.
    pub(crate) depth: Image<u16>,
    pub(crate) intrinsics: Intrinsics,
}

impl GreyFrame {
    pub(crate) fn new(frame: &CameraFrame<'_>) -> Self {
        let depth = frame.depth().map(|depth| stored(*depth));
        Self { grey: brightened(&frame.color().map(luminance)), depth, intrinsics: *frame.intrinsics() }
    }
}

impl GreyFrame {
    /// A frame whose width and height are divided by `step`, with its depth multiplied by `factor`. Luminance is the mean of
    /// a block, depth its first measurement from the centre on.
    pub(crate) fn reduced(frame: &CameraFrame<'_>, step: usize, factor: f32) -> Self {
        let step = step.clamp(1, frame.width().min(frame.height()));
        let (width, height) = (frame.width() / step, frame.height() / step);
        let luminance = Image::from_fn(width, height, |column, row| {
            let rows = row * step..(row + 1) * step;
            let block = rows.map(|row| &frame.color().row(row)[column * step..(column + 1) * step]);
            let sum: u64 = block.flatten().map(|color| u64::from(luminance(color))).sum();
            (sum / (step * step) as u64) as u32
        });
        let depth = Image::from_fn(width, height, |column, row| {
            let from_centre = (0..step * step).map(|number| (number + step * step / 2) % (step * step));
            let depths = from_centre.map(|number| {
                stored(frame.depth()[(column * step + number % step, row * step + number / step)] * factor)
            });
            depths.into_iter().find(|depth| *depth > 0).unwrap_or(0)
        });
        let camera = frame.intrinsics();
        let share = 1.0 / step as f32;
        let centre = |place: f32| (place + 0.5) * share - 0.5;
        let (cx, cy) = (centre(camera.cx), centre(camera.cy));
        let intrinsics = Intrinsics { fx: camera.fx * share, fy: camera.fy * share, cx, cy, width, height };
        Self { grey: brightened(&luminance), depth, intrinsics }
    }
}

/// Depth in units of [`DEPTH_STEP`], 0 where missing or too far.
fn stored(depth: f32) -> u16 {
    let steps = depth / DEPTH_STEP + 0.5;
    if steps <= f32::from(u16::MAX) { steps as u16 } else { 0 }
}

/// A frame at several resolutions, the finest first. Each level is half as wide and high as the one before.
#[derive(Clone, Debug)]
pub(crate) struct Pyramid {
    pub(crate) levels: Vec<Level>,
    /// False if the image shows nothing: it is dark, or the lens is covered.
    pub(crate) has_contrast: bool,
}

/// A frame at one resolution.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Level {
    /// Luminance, 0 to 255, slightly blurred.
    pub(crate) grey: Image<f32>,
    /// z-depth in metres, 0 where missing.
    pub(crate) depth: Image<f32>,
    pub(crate) intrinsics: Intrinsics,
}

impl Pyramid {
    /// Computes all levels of a frame.
    pub(crate) fn new(frame: &GreyFrame) -> Self {
        let depth = frame.depth.map(|steps| f32::from(*steps) * DEPTH_STEP);
        let grey = blurred(&frame.grey.map(|grey| f32::from(*grey)));
        Self::from_level(Level { grey, depth, intrinsics: frame.intrinsics })
    }

    /// Computes the coarser levels of a level.
    pub(crate) fn from_level(finest: Level) -> Self {
        let mut levels = vec![finest];
        while let Some(level) = levels.last().and_then(Level::halved) {
            levels.push(level);
        }
        let has_contrast = levels.last().is_some_and(|coarsest| deviation(&coarsest.grey) >= MIN_CONTRAST);
        Self { levels, has_contrast }
    }
}

impl Level {
    /// Luminance at a place between pixels, interpolated. It must not be in the last column or row, nor outside.
    pub(crate) fn grey_at(&self, place: Vec2) -> f32 {
        let (left, top) = (place.x as usize, place.y as usize);
        let (across, down) = (place.x - left as f32, place.y - top as f32);
        let [above, below] = [self.grey.row(top), self.grey.row(top + 1)];
        let upper = above[left] + (above[left + 1] - above[left]) * across;
        let lower = below[left] + (below[left + 1] - below[left]) * across;
        upper + (lower - upper) * down
    }

    /// The next coarser level; `None` if it would be too small.
    fn halved(&self) -> Option<Self> {
        let (width, height) = (self.grey.width() / 2, self.grey.height() / 2);
        if width < MIN_SIDE || height < MIN_SIDE {
            return None;
        }
        let grey = Image::from_fn(width, height, |column, row| {
            let block = |image: &Image<f32>| four(image, column, row).into_iter().sum::<f32>() * 0.25;
            block(&self.grey)
        });
        let depth = Image::from_fn(width, height, |column, row| nearest_surface(four(&self.depth, column, row)));
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        let intrinsics =
            Intrinsics { fx: fx * 0.5, fy: fy * 0.5, cx: cx * 0.5 - 0.25, cy: cy * 0.5 - 0.25, width, height };
        Some(Self { grey: blurred(&grey), depth, intrinsics })
    }
}

fn four(image: &Image<f32>, column: usize, row: usize) -> [f32; 4] {
    let (above, below) = (image.row(2 * row), image.row(2 * row + 1));
    [above[2 * column], above[2 * column + 1], below[2 * column], below[2 * column + 1]]
}

/// Depth of the nearest surface among four pixels, where they meet; 0 if none has depth. On a plane the inverse depth is
/// linear in the pixel's coordinates, so inverse depths are averaged.
fn nearest_surface(depths: [f32; 4]) -> f32 {
    let nearest = depths.into_iter().filter(|depth| *depth > 0.0).fold(f32::INFINITY, f32::min);
    let limit = nearest * (1.0 + SAME_SURFACE);
    let (sum, count) = depths
        .into_iter()
        .filter(|depth| *depth > 0.0 && *depth <= limit)
        .fold((0.0, 0.0), |(sum, count), depth| (sum + 1.0 / depth, count + 1.0));
    if count > 0.0 { count / sum } else { 0.0 }
}

/// Standard deviation of an image's values.
fn deviation(image: &Image<f32>) -> f32 {
    let count = image.pixels().len() as f32;
    let mean = image.pixels().iter().sum::<f32>() / count;
    (image.pixels().iter().map(|value| (value - mean) * (value - mean)).sum::<f32>() / count).sqrt()
}

/// Rounds luminance in 1/256 to 8 bits. Dark images are brightened before.
fn brightened(luminance: &Image<u32>) -> Image<u8> {
    let grey = luminance.map(|luminance| ((luminance + 128) >> 8) as u8);
    let sum: u64 = grey.pixels().iter().map(|grey| u64::from(*grey)).sum();
    let mean = sum as f32 / grey.pixels().len().max(1) as f32;
    if mean >= DARK {
        return grey;
    }
    let factor = (DARK / mean).min(MAX_BRIGHTENING) / 256.0;
    luminance.map(|luminance| (*luminance as f32 * factor + 0.5).min(255.0) as u8)
}

/// Luminance of an sRGB colour (Rec. 601 weights), in 1/256.
fn luminance(color: &[u8; 3]) -> u32 {
    let [red, green, blue] = color.map(u32::from);
    77 * red + 150 * green + 29 * blue
}

/// Blurs with the kernel 1 2 1 in both directions; the outermost pixels stay as they are.
fn blurred(grey: &Image<f32>) -> Image<f32> {
    let (width, height) = grey.size();
    let mut result = grey.clone();
    if width < 3 || height < 3 {
        return result;
    }
    let rows = result.pixels_mut().par_chunks_mut(width).enumerate().with_min_len(16);
    rows.filter(|(row, _)| *row > 0 && *row + 1 < height).for_each(|(row, result)| {
        let [above, here, below] = [grey.row(row - 1), grey.row(row), grey.row(row + 1)];
        let vertical = |column: usize| above[column] + 2.0 * here[column] + below[column];
        for (column, result) in result.iter_mut().enumerate().take(width - 1).skip(1) {
            *result = (vertical(column - 1) + 2.0 * vertical(column) + vertical(column + 1)) * 0.0625;
        }
    });
    result
}
