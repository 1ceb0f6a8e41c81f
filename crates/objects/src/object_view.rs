//! An object cut out of a frame.

use crate::BoundingBox;
use splatseg_geometry::{CowImage, Image, SegmentId, SegmentMap};

/// Margin around the object, as a share of the longer side of its box...
const MARGIN: f64 = 0.15;
/// ...but at least this, pixels.
const MIN_MARGIN: usize = 4;

/// A part of a frame that shows an object, with a margin.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectView {
    /// sRGB, `[height, width]`.
    pub image: Image<[u8; 3]>,
    /// True where the pixel shows the object, `[height, width]`.
    pub mask: Image<bool>,
}

impl ObjectView {
    /// Cuts object `id` out of a frame. `color` and `segments` are `[height, width]`. Views with a side longer than
    /// `max_side` pixels are scaled down. `None` if the sizes differ or `inner`, the box around the object, is empty or
    /// not inside them.
    pub fn cut(
        color: &CowImage<'_, [u8; 3]>,
        segments: &SegmentMap,
        id: SegmentId,
        inner: &BoundingBox,
        max_side: usize,
    ) -> Option<Self> {
        let window = Window::around(inner, color.size(), max_side).filter(|_| color.size() == segments.size())?;
        let (width, height) = window.size;
        let mut image = Image::filled(width, height, [0; 3]);
        let mut mask = Image::filled(width, height, false);
        for row in 0..height {
            for column in 0..width {
                let (mean, share) = window.mean_of(color, segments, id, (column, row));
                image[(column, row)] = mean;
                mask[(column, row)] = share >= 0.5;
            }
        }
        Some(Self { image, mask })
    }
}

/// The part of a frame that a view shows, and the view's size.
#[derive(Clone, Copy, Debug)]
struct Window {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
    /// `(width, height)` of the view.
    size: (usize, usize),
}

impl Window {
    /// The window around a box, with a margin; `None` if the box is empty or not in the image.
    fn around(inner: &BoundingBox, (width, height): (usize, usize), max_side: usize) -> Option<Self> {
        let margin = (MARGIN * inner.width.max(inner.height) as f64).round() as usize;
        let margin = margin.max(MIN_MARGIN);
        let (left, top) = (inner.x.saturating_sub(margin), inner.y.saturating_sub(margin));
        let right = inner.x.checked_add(inner.width)?;
        let bottom = inner.y.checked_add(inner.height)?;
        if inner.width == 0 || inner.height == 0 || right > width || bottom > height {
            return None;
        }
        let (shown_width, shown_height) = ((right + margin).min(width) - left, (bottom + margin).min(height) - top);
        let longest = shown_width.max(shown_height);
        let scaled = |side: usize| if longest > max_side { (side * max_side / longest).max(1) } else { side };
        let size = (scaled(shown_width), scaled(shown_height));
        Some(Self { left, top, width: shown_width, height: shown_height, size })
    }

    /// The mean colour of the image pixels under a pixel of the view, and the share of them that show `id`.
    fn mean_of(
        &self,
        color: &CowImage<'_, [u8; 3]>,
        segments: &SegmentMap,
        id: SegmentId,
        (column, row): (usize, usize),
    ) -> ([u8; 3], f32) {
        let range =
            |start: usize, at: usize, from: usize, to: usize| start + at * from / to..start + (at + 1) * from / to;
        let (mut sum, mut count, mut shown) = ([0u32; 3], 0u32, 0u32);
        for y in range(self.top, row, self.height, self.size.1) {
            for x in range(self.left, column, self.width, self.size.0) {
                sum.iter_mut().zip(color[(x, y)]).for_each(|(sum, channel)| *sum += u32::from(channel));
                count += 1;
                shown += u32::from(segments[(x, y)] == id);
            }
        }
        let count = count.max(1);
        (sum.map(|sum| ((sum + count / 2) / count) as u8), shown as f32 / count as f32)
    }
}
