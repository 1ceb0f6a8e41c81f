//! Luminance and depth of a keyframe, in little memory.
//!
//! Values are predicted from their left neighbours, and the differences compressed (Deflate). Depth is stored as inverse
//! depth, in steps of half of a Kinect's deviation, which is nearly constant in that unit.

use crate::pyramid::{Level, MIN_SIDE, Pyramid};
use flate2::Compression;
use flate2::read::DeflateDecoder;
use flate2::write::DeflateEncoder;
use splatseg_geometry::{Image, Intrinsics};
use std::io::{Read, Write};

/// Maximum width, pixels. Only images that are too low to be halved are wider.
pub(crate) const MAX_WIDTH: usize = 200;

/// Maximum number of pixels. Portrait images of 200 columns have up to 655 rows.
pub(crate) const MAX_PIXELS: usize = 1 << 17;

/// Step of the inverse depth, 1/m.
const INVERSE_STEP: f32 = 0.0008;

/// Luminance is stored in steps of this.
const GREY_STEP: f32 = 2.0;

/// A small grey image with depth.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CompactView {
    pub(crate) intrinsics: Intrinsics,
    /// Compressed.
    pub(crate) grey: Vec<u8>,
    /// Compressed.
    pub(crate) depth: Vec<u8>,
}

impl CompactView {
    /// Compresses a frame at the finest resolution of at most [`MAX_WIDTH`] columns and [`MAX_PIXELS`] pixels.
    pub(crate) fn new(pyramid: &Pyramid) -> Self {
        let level = &pyramid.levels[coarse_level(pyramid)];
        let grey = level.grey.pixels().iter().map(|grey| (grey / GREY_STEP + 0.5) as u16);
        let depth = level.depth.pixels().iter().map(|depth| match depth {
            depth if *depth > 0.0 => ((1.0 / (depth * INVERSE_STEP) + 0.5) as u16).max(1),
            _ => 0,
        });
        Self { intrinsics: level.intrinsics, grey: compressed(grey), depth: compressed(depth) }
    }

    /// Makes the depth unknown at the pixels (column, row) with their depths, metres, for which `is_gone` is true. Other pixels
    /// keep their exact values. `None` if the bytes are damaged.
    pub(crate) fn erase_depth(&mut self, is_gone: impl Fn((usize, usize), f32) -> bool) -> Option<()> {
        let Intrinsics { width, height, .. } = self.intrinsics;
        let mut steps = decompressed(&self.depth, width, height)?;
        let depth = self.depth()?;
        let mut is_changed = false;
        for row in 0..height {
            for column in 0..width {
                let at = (column, row);
                if depth[at] > 0.0 && is_gone(at, depth[at]) {
                    (steps[at], is_changed) = (0, true);
                }
            }
        }
        if is_changed {
            self.depth = compressed(steps.pixels().iter().copied());
        }
        Some(())
    }

    /// True for the sizes that [`Self::new`] gives, except for images thousands of times as long as wide: their coarsest
    /// resolution is still too large. Views of other sizes are neither saved nor read.
    pub(crate) fn has_possible_size(&self) -> bool {
        is_possible_size(self.intrinsics.width, self.intrinsics.height)
    }

    /// The view at several resolutions. `None` if the bytes are damaged.
    pub(crate) fn pyramid(&self) -> Option<Pyramid> {
        let Intrinsics { width, height, .. } = self.intrinsics;
        let grey = decompressed(&self.grey, width, height)?;
        let grey = grey.map(|grey| (f32::from(*grey) * GREY_STEP).min(255.0));
        Some(Pyramid::from_level(Level { grey, depth: self.depth()?, intrinsics: self.intrinsics }))
    }

    /// z-depth, metres, 0 where missing, `[height, width]`. `None` if the bytes are damaged.
    pub(crate) fn depth(&self) -> Option<Image<f32>> {
        let Intrinsics { width, height, .. } = self.intrinsics;
        let steps = decompressed(&self.depth, width, height)?;
        Some(steps.map(|steps| if *steps > 0 { 1.0 / (f32::from(*steps) * INVERSE_STEP) } else { 0.0 }))
    }
}

fn is_possible_size(width: usize, height: usize) -> bool {
    let is_narrow = width <= MAX_WIDTH || height / 2 < MIN_SIDE;
    is_narrow && width.checked_mul(height).is_some_and(|pixels| pixels <= MAX_PIXELS)
}

/// Number of the finest level that is compressed.
pub(crate) fn coarse_level(pyramid: &Pyramid) -> usize {
    let level = pyramid.levels.iter().position(|level| {
        let (width, height) = level.grey.size();
        width <= MAX_WIDTH && width * height <= MAX_PIXELS
    });
    level.unwrap_or(pyramid.levels.len() - 1)
}

/// The levels of a frame from the one that keyframes are compressed at.
pub(crate) fn coarse_pyramid(pyramid: &Pyramid) -> Pyramid {
    let levels = pyramid.levels[coarse_level(pyramid)..].to_vec();
    Pyramid { levels, has_contrast: pyramid.has_contrast }
}

fn compressed(values: impl Iterator<Item = u16>) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut previous = 0i32;
    for value in values.map(i32::from) {
        // Zigzag: small differences of either sign are small numbers.
        let difference = value - previous;
        let coded = ((difference << 1) ^ (difference >> 31)) as u32;
        match coded {
            0..0x80 => bytes.push(coded as u8),
            _ => bytes.extend([0x80 | (coded & 0x7F) as u8, (coded >> 7) as u8, (coded >> 15) as u8]),
        }
        previous = value;
    }
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::fast());
    // Writing to memory does not fail.
    let _ = encoder.write_all(&bytes);
    encoder.finish().unwrap_or_default()
}

fn decompressed(bytes: &[u8], width: usize, height: usize) -> Option<Image<u16>> {
    let mut coded = Vec::new();
    let limit = 4 * (width * height) as u64;
    DeflateDecoder::new(bytes).take(limit).read_to_end(&mut coded).ok()?;
    let mut bytes = coded.into_iter();
    let mut previous = 0i32;
    let mut values = Vec::with_capacity(width * height);
    for _ in 0..width * height {
        let first = u32::from(bytes.next()?);
        let coded = match first {
            0..0x80 => first,
            _ => (first & 0x7F) | u32::from(bytes.next()?) << 7 | u32::from(bytes.next()?) << 15,
        };
        previous += (coded >> 1) as i32 ^ -((coded & 1) as i32);
        values.push(u16::try_from(previous).ok()?);
    }
    // More bytes belong to another image.
    bytes.next().is_none().then(|| Image::from_pixels(width, height, values).ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(width: usize, height: usize) -> CompactView {
        let intrinsics = Intrinsics { fx: 500.0, fy: 500.0, cx: 10.0, cy: 10.0, width, height };
        let (grey, depth) = (Image::filled(width, height, 90.0), Image::filled(width, height, 2.0));
        CompactView::new(&Pyramid::from_level(Level { grey, depth, intrinsics }))
    }

    #[test]
    fn erased_depth_is_unknown_and_the_rest_exact() {
        let mut view = view(160, 120);
        let before = view.depth().unwrap();
        view.erase_depth(|(column, row), depth| column < 20 && row == 3 && depth > 1.0).unwrap();
        let after = view.depth().unwrap();
        for row in 0..120 {
            for column in 0..160 {
                let is_erased = column < 20 && row == 3;
                assert_eq!(after[(column, row)], if is_erased { 0.0 } else { before[(column, row)] });
            }
        }
        let same = view.clone();
        view.erase_depth(|_, _| false).unwrap();
        assert!(view == same);
    }

    #[test]
    fn views_of_all_cameras_have_possible_sizes() {
        let sizes =
            [(640, 480), (480, 640), (1280, 400), (400, 1600), (2600, 40), (40, 2600), (30, 30), (801, 96), (1, 1)];
        for (width, height) in sizes {
            let view = view(width, height);
            let Intrinsics { width: kept, height: rows, .. } = view.intrinsics;
            assert!(view.has_possible_size(), "{width}x{height}: {kept}x{rows}");
            assert_eq!(view.depth().unwrap().size(), (kept, rows));
        }
        assert_eq!(view(480, 640).intrinsics.height, 160);
    }

    #[test]
    fn other_sizes_are_impossible() {
        for (width, height) in
            [(4096, 4096), (201, 48), (200, 656), (400, 300), (3000, 47), (1, 1 << 20), (usize::MAX, 2)]
        {
            assert!(!is_possible_size(width, height), "{width}x{height}");
        }
        for (width, height) in [(200, 655), (201, 47), (160, 120), (120, 160)] {
            assert!(is_possible_size(width, height), "{width}x{height}");
        }
    }
}
