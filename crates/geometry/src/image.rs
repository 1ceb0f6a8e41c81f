//! Images: row-major pixels of any type, owned or borrowed.

use crate::QuarterTurn;
use std::borrow::Cow;
use thiserror::Error;

/// Row-major image of `height` × `width` pixels of type `T` that owns its pixels: a [`CowImage`] without borrowed data.
pub type Image<T> = CowImage<'static, T>;

/// Row-major image of `height` × `width` pixels of type `T`. The pixels are either owned or borrowed for `'a`, for
/// example from a camera driver's buffer or a NumPy array. Borrowed pixels are copied only if the image is changed.
///
/// ```
/// use splatseg_geometry::CowImage;
/// let buffer: &[u8] = &[255, 0, 0, 0, 255, 0]; // RGB bytes of two pixels, row by row
/// let (pixels, _) = buffer.as_chunks::<3>();
/// let image = CowImage::from_slice(2, 1, pixels)?;
/// assert_eq!(image[(1, 0)], [0, 255, 0]);
/// assert_eq!(image.pixels().as_ptr(), pixels.as_ptr());
/// # Ok::<(), splatseg_geometry::ImageSizeError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct CowImage<'a, T: Clone> {
    width: usize,
    height: usize,
    pixels: Cow<'a, [T]>,
}

/// The number of pixels does not match the image size.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error("an image of {width}x{height} needs {} pixels, but {found} were given", *width as u128 * *height as u128)]
pub struct ImageSizeError {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Number of pixels given.
    pub found: usize,
}

impl<'a, T: Clone> CowImage<'a, T> {
    /// Borrows row-major `pixels`, `[height, width]`. Nothing is copied.
    ///
    /// # Errors
    /// If the number of `pixels` is not `width * height`.
    pub fn from_slice(width: usize, height: usize, pixels: &'a [T]) -> Result<Self, ImageSizeError> {
        check_size(width, height, pixels.len())?;
        Ok(Self { width, height, pixels: Cow::Borrowed(pixels) })
    }

    /// Borrows the image's pixels as a new image.
    pub fn as_borrowed(&self) -> CowImage<'_, T> {
        CowImage { width: self.width, height: self.height, pixels: Cow::Borrowed(&self.pixels) }
    }

    /// Converts to an image that owns its pixels. Copies borrowed pixels.
    pub fn into_owned(self) -> Image<T> {
        CowImage { width: self.width, height: self.height, pixels: Cow::Owned(self.pixels.into_owned()) }
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

    /// All pixels, row-major, mutable. Copies borrowed pixels first.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        self.pixels.to_mut()
    }

    /// The pixels of one row.
    pub fn row(&self, row: usize) -> &[T] {
        &self.pixels[row * self.width..(row + 1) * self.width]
    }

    /// Returns the pixels, row-major. Copies borrowed pixels.
    pub fn into_pixels(self) -> Vec<T> {
        self.pixels.into_owned()
    }

    /// Returns the image with every pixel replaced by `change(pixel)`.
    pub fn map<U: Clone>(&self, change: impl FnMut(&T) -> U) -> Image<U> {
        let pixels = Cow::Owned(self.pixels.iter().map(change).collect());
        CowImage { width: self.width, height: self.height, pixels }
    }

    /// Returns the turned image.
    #[must_use]
    pub fn turned(&self, turn: QuarterTurn) -> Image<T> {
        let size = turn.size(self.size());
        Image::from_fn(size.0, size.1, |column, row| self[turn.inverse().pixel((column, row), size)].clone())
    }

    /// Returns every second row and column, beginning with the first.
    #[must_use]
    pub fn halved(&self) -> Image<T> {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        Image::from_fn(width, height, |column, row| self[(2 * column, 2 * row)].clone())
    }

    /// Returns an image of `size` (width, height) from its every second row and column, as [`Self::halved`] returns them:
    /// each pixel stands for those to the right, below and between, too.
    ///
    /// # Panics
    /// If this is not half of that size.
    #[must_use]
    pub fn doubled(&self, (width, height): (usize, usize)) -> Image<T> {
        assert_eq!(self.size(), (width.div_ceil(2), height.div_ceil(2)));
        Image::from_fn(width, height, |column, row| self[(column / 2, row / 2)].clone())
    }

    /// Returns the image without `border` pixels on each side. Empty if nothing is left.
    #[must_use]
    pub fn crop_border(&self, border: usize) -> Image<T> {
        let width = self.width.saturating_sub(2 * border);
        let height = self.height.saturating_sub(2 * border);
        if width == 0 || height == 0 {
            return CowImage { width: 0, height: 0, pixels: Cow::Owned(Vec::new()) };
        }
        Image::from_fn(width, height, |column, row| self[(column + border, row + border)].clone())
    }
}

impl<T: Clone> Image<T> {
    /// Creates an image from row-major `pixels`, `[height, width]`.
    ///
    /// # Errors
    /// If the number of `pixels` is not `width * height`.
    pub fn from_pixels(width: usize, height: usize, pixels: Vec<T>) -> Result<Self, ImageSizeError> {
        check_size(width, height, pixels.len())?;
        Ok(Self { width, height, pixels: Cow::Owned(pixels) })
    }

    /// Creates an image by calling `pixel(column, row)` for every pixel, row by row.
    pub fn from_fn(width: usize, height: usize, mut pixel: impl FnMut(usize, usize) -> T) -> Self {
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            for column in 0..width {
                pixels.push(pixel(column, row));
            }
        }
        Self { width, height, pixels: Cow::Owned(pixels) }
    }

    /// Creates an image with the same `value` everywhere.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, pixels: Cow::Owned(vec![value; width * height]) }
    }
}

fn check_size(width: usize, height: usize, found: usize) -> Result<(), ImageSizeError> {
    if width.checked_mul(height) == Some(found) { Ok(()) } else { Err(ImageSizeError { width, height, found }) }
}

/// `image[(column, row)]`.
impl<T: Clone> std::ops::Index<(usize, usize)> for CowImage<'_, T> {
    type Output = T;

    fn index(&self, (column, row): (usize, usize)) -> &T {
        debug_assert!(column < self.width);
        &self.pixels[row * self.width + column]
    }
}

impl<T: Clone> std::ops::IndexMut<(usize, usize)> for CowImage<'_, T> {
    fn index_mut(&mut self, (column, row): (usize, usize)) -> &mut T {
        debug_assert!(column < self.width);
        &mut self.pixels.to_mut()[row * self.width + column]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_an_image_doubled_has_the_same_size() {
        let image = Image::from_fn(5, 3, |column, row| 10 * row + column);
        let half = image.halved();
        assert_eq!(half, Image::from_pixels(3, 2, vec![0, 2, 4, 20, 22, 24]).unwrap());
        let pixels = vec![0, 0, 2, 2, 4, 0, 0, 2, 2, 4, 20, 20, 22, 22, 24];
        assert_eq!(half.doubled((5, 3)), Image::from_pixels(5, 3, pixels).unwrap());
    }

    #[test]
    fn sizes_are_checked() {
        let error = Image::from_pixels(3, 2, vec![0; 5]).unwrap_err();
        assert_eq!(error.to_string(), "an image of 3x2 needs 6 pixels, but 5 were given");
    }

    #[test]
    fn borrowed_pixels_are_copied_only_to_change_them() {
        let buffer = vec![1, 2, 3, 4, 5, 6];
        let mut image = CowImage::from_slice(3, 2, &buffer).unwrap();
        assert_eq!(image.clone().pixels().as_ptr(), buffer.as_ptr());
        assert_eq!(image, Image::from_pixels(3, 2, buffer.clone()).unwrap());
        image[(0, 1)] = 9;
        assert_eq!((image.row(1), &buffer[3..]), (&[9, 5, 6][..], &[4, 5, 6][..]));
        let own = image.into_owned();
        assert_eq!(own.as_borrowed().pixels().as_ptr(), own.pixels().as_ptr());
        assert!(CowImage::from_slice(2, 2, &buffer).is_err());
        assert!(CowImage::from_slice(usize::MAX, 2, &buffer).is_err(), "the product would overflow");
    }

    #[test]
    fn cropping_keeps_the_middle() {
        let image = Image::from_fn(5, 4, |column, row| 10 * row + column);
        assert_eq!(image.crop_border(1).pixels(), &[11, 12, 13, 21, 22, 23]);
        assert_eq!(image.crop_border(2).size(), (0, 0));
    }
}
