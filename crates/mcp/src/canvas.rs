//! Drawing into pictures: polygons, lines and text, without smoothing.

use crate::tool::{Picture, ToolError};
use glam::DVec2;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use splatseg_geometry::Image;
use splatseg_output::{GLYPH_HEIGHT, text_pixels, text_width};

const JPEG_QUALITY: u8 = 88;

/// A picture that is drawn. Places are pixels, x to the right and y down, with the centre of the first pixel at (0.5, 0.5).
pub struct Canvas {
    image: Image<[u8; 3]>,
}

/// A rectangle of pixels: left, top, right and bottom, the last two excluded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rectangle(pub [i64; 4]);

impl Rectangle {
    /// True if both have a pixel in common.
    pub fn overlaps(&self, other: &Self) -> bool {
        let ([left, top, right, bottom], [other_left, other_top, other_right, other_bottom]) = (self.0, other.0);
        left < other_right && other_left < right && top < other_bottom && other_top < bottom
    }
}

impl Canvas {
    pub fn new(image: Image<[u8; 3]>) -> Self {
        Self { image }
    }

    pub fn size(&self) -> (usize, usize) {
        self.image.size()
    }

    /// Mixes a colour into a pixel, if it is in the picture.
    fn blend(&mut self, x: i64, y: i64, color: [u8; 3], opacity: f64) {
        let (width, height) = self.image.size();
        let (Ok(x), Ok(y)) = (usize::try_from(x), usize::try_from(y)) else { return };
        if x < width && y < height {
            let below = self.image[(x, y)];
            self.image[(x, y)] = std::array::from_fn(|channel| {
                let (below, above) = (f64::from(below[channel]), f64::from(color[channel]));
                (below + opacity * (above - below)).round() as u8
            });
        }
    }

    /// Fills a polygon: the pixels whose centres are inside.
    pub fn fill(&mut self, polygon: &[DVec2], color: [u8; 3], opacity: f64) {
        let (width, height) = self.image.size();
        for row in 0..height {
            let y = row as f64 + 0.5;
            let mut crossings: Vec<f64> = edges(polygon)
                .filter(|(from, to)| (from.y <= y) != (to.y <= y))
                .map(|(from, to)| from.x + (y - from.y) / (to.y - from.y) * (to.x - from.x))
                .collect();
            crossings.sort_by(f64::total_cmp);
            for span in crossings.chunks_exact(2) {
                let first = (span[0] - 0.5).ceil().max(0.0) as i64;
                let end = (span[1] - 0.5).ceil().min(width as f64) as i64;
                (first..end).for_each(|column| self.blend(column, row as i64, color, opacity));
            }
        }
    }

    /// Draws the border of a polygon.
    pub fn outline(&mut self, polygon: &[DVec2], color: [u8; 3], thickness: i64) {
        edges(polygon).for_each(|(from, to)| self.line(from, to, color, thickness));
    }

    /// Draws a line.
    pub fn line(&mut self, from: DVec2, to: DVec2, color: [u8; 3], thickness: i64) {
        let (width, height) = self.image.size();
        // What is far outside is not drawn; a line of any length takes a bounded time.
        let reach = 4.0 * (width + height) as f64;
        if !(from.is_finite() && to.is_finite()) || from.abs().max(to.abs()).max_element() > reach {
            return;
        }
        let steps = (to - from).abs().max_element().ceil().max(1.0) as i64;
        for step in 0..=steps {
            let at = from.lerp(to, step as f64 / steps as f64) - (thickness - 1) as f64 / 2.0;
            let (x, y) = (at.x.floor() as i64, at.y.floor() as i64);
            for index in 0..thickness * thickness {
                self.blend(x + index % thickness, y + index / thickness, color, 1.0);
            }
        }
    }

    /// Where a text would stand, with its border, around a centre.
    pub fn text_rectangle(center: DVec2, text: &str, dot: i64) -> Rectangle {
        let (width, height) = (text_width(text) as i64 * dot, GLYPH_HEIGHT as i64 * dot);
        let (left, top) = (center.x.round() as i64 - width / 2, center.y.round() as i64 - height / 2);
        Rectangle([left - dot, top - dot, left + width + dot, top + height + dot])
    }

    /// Writes a text into its rectangle: dark on a light ground. Each dot of a letter has `dot` pixels a side.
    pub fn text(&mut self, at: Rectangle, text: &str, dot: i64) {
        let [left, top, right, bottom] = at.0;
        for y in top..bottom {
            (left..right).for_each(|x| self.blend(x, y, [255; 3], 0.8));
        }
        for (column, row) in text_pixels(text) {
            let (x, y) = (left + dot + column as i64 * dot, top + dot + row as i64 * dot);
            (0..dot * dot).for_each(|index| self.blend(x + index % dot, y + index / dot, [15; 3], 1.0));
        }
    }

    /// The picture as a PNG file.
    pub fn png(&self) -> Result<Picture, ToolError> {
        let (width, height) = self.image.size();
        let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
        let mut bytes = Vec::new();
        PngEncoder::new(&mut bytes)
            .write_image(self.image.pixels().as_flattened(), side(width), side(height), ExtendedColorType::Rgb8)
            .map_err(|error| ToolError(format!("The picture cannot be encoded: {error}.")))?;
        Ok(Picture { bytes, mime_type: "image/png" })
    }

    /// The picture as a JPEG file.
    pub fn jpeg(&self) -> Result<Picture, ToolError> {
        let (width, height) = self.image.size();
        let bytes = splatseg_jpeg::encode(self.image.pixels(), width, height, JPEG_QUALITY)
            .map_err(|error| ToolError(format!("The picture cannot be encoded: {error}.")))?;
        Ok(Picture { bytes, mime_type: "image/jpeg" })
    }
}

fn edges(polygon: &[DVec2]) -> impl Iterator<Item = (DVec2, DVec2)> {
    let next = polygon.iter().cycle().skip(1);
    polygon.iter().copied().zip(next.copied())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn count(canvas: &Canvas, color: [u8; 3]) -> usize {
        canvas.image.pixels().iter().filter(|pixel| **pixel == color).count()
    }

    #[test]
    fn polygons_cover_their_pixels_and_nothing_outside_is_drawn() {
        let mut canvas = Canvas::new(Image::filled(20, 10, [255; 3]));
        let square = [[2.0, 2.0], [6.0, 2.0], [6.0, 6.0], [2.0, 6.0]].map(DVec2::from);
        canvas.fill(&square, [200, 0, 0], 1.0);
        assert_eq!(count(&canvas, [200, 0, 0]), 16);
        canvas.fill(&square.map(|corner| corner * 1000.0), [0, 0, 9], 1.0);
        canvas.line(DVec2::splat(-1e9), DVec2::splat(1e9), [1; 3], 3);
        canvas.line(DVec2::new(f64::NAN, 0.0), DVec2::ONE, [1; 3], 3);
        assert_eq!(count(&canvas, [1; 3]), 0);
        canvas.outline(&square, [3; 3], 1);
        assert_eq!(count(&canvas, [3; 3]), 16);
        let at = Canvas::text_rectangle(DVec2::new(19.0, 9.0), "7 mug", 1);
        canvas.text(at, "7 mug", 1);
        assert_eq!(canvas.png().unwrap().bytes[1..4], *b"PNG");
        assert_eq!(canvas.jpeg().unwrap().bytes[..2], [0xff, 0xd8]);
    }

    #[test]
    fn rectangles_overlap_if_they_share_a_pixel() {
        let one = Rectangle([0, 0, 4, 4]);
        assert!(one.overlaps(&Rectangle([3, 3, 9, 9])) && !one.overlaps(&Rectangle([4, 0, 9, 9])));
    }
}
