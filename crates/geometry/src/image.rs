//! A plain image: row-major pixels of any type.

use thiserror::Error;

/// Row-major image of `height` × `width` pixels of type `T`.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Image<T> {
    width: usize,
    height: usize,
    pixels: Vec<T>,
}

/// The number of pixels does not match the stated size.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("an image of {width}x{height} needs {} pixels, but {found} were given", width * height)]
pub struct ImageSizeError {
    /// Stated width in pixels.
    pub width: usize,
    /// Stated height in pixels.
    pub height: usize,
    /// Number of pixels given.
    pub found: usize,
}

impl<T> Image<T> {
    /// Wraps row-major `pixels`, `[height, width]`.
    ///
    /// # Errors
    /// If `pixels` does not hold exactly `width * height` values.
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<T>) -> Result<Self, ImageSizeError> {
        if width.checked_mul(height) != Some(pixels.len()) {
            return Err(ImageSizeError { width, height, found: pixels.len() });
        }
        Ok(Self { width, height, pixels })
    }

    /// Makes an image by calling `pixel(column, row)` for every pixel, row by row.
    pub fn from_fn(width: usize, height: usize, mut pixel: impl FnMut(usize, usize) -> T) -> Self {
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                pixels.push(pixel(column, row));
            }
        }
        Self { width, height, pixels }
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// `(width, height)` in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.width, self.height)
    }

    /// All pixels, row-major.
    pub fn pixels(&self) -> &[T] {
        &self.pixels
    }

    /// All pixels, row-major, to be changed in place.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.pixels
    }

    /// The pixels of one row.
    pub fn row(&self, row: usize) -> &[T] {
        &self.pixels[row * self.width..(row + 1) * self.width]
    }

    /// Gives the pixels back, row-major.
    pub fn into_pixels(self) -> Vec<T> {
        self.pixels
    }

    /// The image with every pixel replaced by `change(pixel)`.
    pub fn map<U>(&self, change: impl FnMut(&T) -> U) -> Image<U> {
        Image { width: self.width, height: self.height, pixels: self.pixels.iter().map(change).collect() }
    }
}

impl<T: Clone> Image<T> {
    /// An image with the same `value` everywhere.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, pixels: vec![value; width * height] }
    }

    /// The image without `border` pixels on each side; empty if nothing is left.
    pub fn crop_border(&self, border: usize) -> Self {
        let width = self.width.saturating_sub(2 * border);
        let height = self.height.saturating_sub(2 * border);
        if width == 0 || height == 0 {
            return Self { width: 0, height: 0, pixels: Vec::new() };
        }
        Self::from_fn(width, height, |column, row| self[(column + border, row + border)].clone())
    }
}

/// `image[(column, row)]`.
impl<T> std::ops::Index<(usize, usize)> for Image<T> {
    type Output = T;

    fn index(&self, (column, row): (usize, usize)) -> &T {
        debug_assert!(column < self.width);
        &self.pixels[row * self.width + column]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Image<T> {
    fn index_mut(&mut self, (column, row): (usize, usize)) -> &mut T {
        debug_assert!(column < self.width);
        &mut self.pixels[row * self.width + column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_checked() {
        let error = Image::from_pixels(3, 2, vec![0; 5]).unwrap_err();
        assert_eq!(error.to_string(), "an image of 3x2 needs 6 pixels, but 5 were given");
    }

    #[test]
    fn cropping_keeps_the_middle() {
        let image = Image::from_fn(5, 4, |column, row| 10 * row + column);
        assert_eq!(image.crop_border(1).pixels(), &[11, 12, 13, 21, 22, 23]);
        assert_eq!(image.crop_border(2).size(), (0, 0));
    }
}
