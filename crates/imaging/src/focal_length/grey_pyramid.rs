//! Grey values of an image at several resolutions.

use crate::resample::{ImageMap, resample_color};
use glam::{DVec2, Vec2};
use splatseg_geometry::Image;

/// The long side of the finest level, pixels: larger images are reduced. Finer ones gave the same focal lengths.
const LONG_SIDE: usize = 320;
/// Levels are added while they are at least this wide and high.
const MIN_SIDE: usize = 12;
/// Pixels around each level that repeat its edge: windows may reach beyond it.
const MARGIN: usize = 12;

/// An image at several resolutions, the finest first. Each level is half as wide and high as the one before.
pub(super) struct GreyPyramid {
    pub(super) levels: Vec<Level>,
}

/// An image at one resolution.
pub(super) struct Level {
    /// Luminance, 0 to 255, `[height, width]`.
    pub(super) grey: Image<f32>,
    /// The same with a margin of [`MARGIN`] pixels on each side.
    wide: Image<f32>,
}

impl GreyPyramid {
    pub(super) fn new(image: &Image<[u8; 3]>) -> Self {
        let size @ (width, height) = image.size();
        let share = LONG_SIDE as f64 / width.max(height).max(1) as f64;
        let reduced = |side: usize| ((side as f64 * share).round() as usize).max(1);
        let grey = if share < 1.0 {
            luminance(&resample_color(image, &ImageMap::resize(size, (reduced(width), reduced(height)))))
        } else {
            luminance(image)
        };
        let mut levels = vec![Level::new(grey)];
        while let Some(half) = levels.last().and_then(|level| halved(&level.grey)) {
            levels.push(Level::new(half));
        }
        Self { levels }
    }

    /// Width and height of the finest level.
    pub(super) fn size(&self) -> (usize, usize) {
        self.levels[0].grey.size()
    }

    /// A place of the finest level from the middle of the image, in its long sides.
    pub(super) fn relative_to_middle(&self, place: Vec2) -> DVec2 {
        let (width, height) = self.size();
        let middle = DVec2::new(width as f64 - 1.0, height as f64 - 1.0) * 0.5;
        (place.as_dvec2() - middle) / width.max(height) as f64
    }
}

impl Level {
    fn new(grey: Image<f32>) -> Self {
        let (width, height) = grey.size();
        let wide = Image::from_fn(width + 2 * MARGIN, height + 2 * MARGIN, |column, row| {
            let inside = |place: usize, side: usize| place.saturating_sub(MARGIN).min(side - 1);
            grey[(inside(column, width), inside(row, height))]
        });
        Self { grey, wide }
    }

    /// The values of the window of `N`×`N` pixels around a place, interpolated. `None` if it reaches beyond the margin, or
    /// the place is not a number.
    pub(super) fn window<const N: usize>(&self, place: Vec2) -> Option<[[f32; N]; N]> {
        let corner = place + MARGIN as f32 - (N / 2) as f32;
        let end = Vec2::new(self.wide.width() as f32, self.wide.height() as f32) - N as f32 - 1.0;
        if !(corner.cmpge(Vec2::ZERO).all() && corner.cmplt(end).all()) {
            return None;
        }
        let (left, top) = (corner.x as usize, corner.y as usize);
        let (across, down) = (corner.x - left as f32, corner.y - top as f32);
        let weights = [(1.0 - across) * (1.0 - down), across * (1.0 - down), (1.0 - across) * down, across * down];
        Some(std::array::from_fn(|row| {
            let [above, below] = [top + row, top + row + 1].map(|row| &self.wide.row(row)[left..=left + N]);
            std::array::from_fn(|column| {
                weights[0] * above[column]
                    + weights[1] * above[column + 1]
                    + weights[2] * below[column]
                    + weights[3] * below[column + 1]
            })
        }))
    }
}

fn luminance(image: &Image<[u8; 3]>) -> Image<f32> {
    image.map(|[red, green, blue]| 0.299 * f32::from(*red) + 0.587 * f32::from(*green) + 0.114 * f32::from(*blue))
}

/// Means of 2×2 pixels; `None` if the image would be too small.
fn halved(image: &Image<f32>) -> Option<Image<f32>> {
    let (width, height) = (image.width() / 2, image.height() / 2);
    (width.min(height) >= MIN_SIDE).then(|| {
        Image::from_fn(width, height, |column, row| {
            let [above, below] = [image.row(2 * row), image.row(2 * row + 1)].map(|row| &row[2 * column..]);
            0.25 * (above[0] + above[1] + below[0] + below[1])
        })
    })
}
