//! Binary masks, packed into bits so that overlaps are counted 64 pixels at a time.

/// A binary mask over an image of `height` × `width` pixels.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Mask {
    width: usize,
    height: usize,
    /// Pixel `i` (row-major) is bit `i % 64` of word `i / 64`; bits past the last pixel are 0.
    words: Vec<u64>,
}

/// A mask and how sure its segmenter is of it. Masks of one image may overlap.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoredMask {
    /// The pixels of the segment.
    pub mask: Mask,
    /// Confidence in [0, 1].
    pub score: f32,
}

impl Mask {
    /// A mask without any pixel.
    pub fn empty(width: usize, height: usize) -> Self {
        Self { width, height, words: vec![0; (width * height).div_ceil(64)] }
    }

    /// The mask of all pixels for which `inside(column, row)` holds.
    pub fn from_fn(width: usize, height: usize, mut inside: impl FnMut(usize, usize) -> bool) -> Self {
        let mut mask = Self::empty(width, height);
        for row in 0..height {
            for column in 0..width {
                if inside(column, row) {
                    let index = row * width + column;
                    mask.words[index / 64] |= 1 << (index % 64);
                }
            }
        }
        mask
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Whether the pixel belongs to the mask.
    ///
    /// # Panics
    /// If the pixel lies outside the image.
    pub fn contains(&self, column: usize, row: usize) -> bool {
        assert!(column < self.width && row < self.height, "pixel ({column}, {row}) is outside the mask");
        let index = row * self.width + column;
        self.words[index / 64] >> (index % 64) & 1 == 1
    }

    /// Adds or removes one pixel.
    ///
    /// # Panics
    /// If the pixel lies outside the image.
    pub fn set(&mut self, column: usize, row: usize, inside: bool) {
        assert!(column < self.width && row < self.height, "pixel ({column}, {row}) is outside the mask");
        let index = row * self.width + column;
        let bit = 1 << (index % 64);
        if inside {
            self.words[index / 64] |= bit;
        } else {
            self.words[index / 64] &= !bit;
        }
    }

    /// Number of pixels.
    pub fn area(&self) -> usize {
        self.words.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Whether the mask has no pixel.
    pub fn is_empty(&self) -> bool {
        self.words.iter().all(|word| *word == 0)
    }

    /// Adds the pixel with this row-major index, which must lie inside the image.
    pub(crate) fn insert_index(&mut self, index: usize) {
        self.words[index / 64] |= 1 << (index % 64);
    }

    /// Row-major indices of the mask's pixels, increasing.
    pub fn pixel_indices(&self) -> impl Iterator<Item = usize> + '_ {
        self.words.iter().enumerate().flat_map(|(word_index, word)| {
            let mut rest = *word;
            std::iter::from_fn(move || {
                (rest != 0).then(|| {
                    let bit = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    word_index * 64 + bit
                })
            })
        })
    }

    /// The mean (column, row) of the mask's pixels; `None` if it has none.
    pub fn centroid(&self) -> Option<(f64, f64)> {
        let (mut columns, mut rows, mut count) = (0usize, 0usize, 0usize);
        for index in self.pixel_indices() {
            columns += index % self.width;
            rows += index / self.width;
            count += 1;
        }
        (count > 0).then(|| (columns as f64 / count as f64, rows as f64 / count as f64))
    }

    /// Number of pixels in both masks.
    ///
    /// # Panics
    /// If the masks differ in size.
    pub fn intersection_area(&self, other: &Self) -> usize {
        self.assert_same_size(other);
        self.words.iter().zip(&other.words).map(|(a, b)| (a & b).count_ones() as usize).sum()
    }

    /// Intersection over union; 0 if both masks are empty.
    ///
    /// # Panics
    /// If the masks differ in size.
    pub fn iou(&self, other: &Self) -> f64 {
        let intersection = self.intersection_area(other);
        let union = self.area() + other.area() - intersection;
        if union == 0 { 0.0 } else { intersection as f64 / union as f64 }
    }

    /// Adds the pixels of `other`.
    ///
    /// # Panics
    /// If the masks differ in size.
    pub fn unite(&mut self, other: &Self) {
        self.assert_same_size(other);
        for (word, more) in self.words.iter_mut().zip(&other.words) {
            *word |= more;
        }
    }

    /// Removes the pixels of `other`.
    ///
    /// # Panics
    /// If the masks differ in size.
    pub fn subtract(&mut self, other: &Self) {
        self.assert_same_size(other);
        for (word, less) in self.words.iter_mut().zip(&other.words) {
            *word &= !less;
        }
    }

    fn assert_same_size(&self, other: &Self) {
        assert_eq!((self.width, self.height), (other.width, other.height), "masks of different images");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mask(pixels: &[bool], width: usize) -> Mask {
        Mask::from_fn(width, pixels.len() / width, |column, row| pixels[row * width + column])
    }

    proptest! {
        #[test]
        fn packed_counts_equal_pixel_counts(a in prop::collection::vec(any::<bool>(), 130..=130),
                                            b in prop::collection::vec(any::<bool>(), 130..=130)) {
            let (first, second) = (mask(&a, 13), mask(&b, 13));
            let both = a.iter().zip(&b).filter(|(x, y)| **x && **y).count();
            let either = a.iter().zip(&b).filter(|(x, y)| **x || **y).count();
            prop_assert_eq!(first.area(), a.iter().filter(|x| **x).count());
            prop_assert_eq!(first.intersection_area(&second), both);
            prop_assert!((first.iou(&second) - both as f64 / either.max(1) as f64).abs() < 1e-12);
            let listed: Vec<usize> = first.pixel_indices().collect();
            let expected: Vec<usize> = (0..130).filter(|i| a[*i]).collect();
            prop_assert_eq!(listed, expected);
            let mut united = first.clone();
            united.unite(&second);
            prop_assert_eq!(united.area(), either);
            united.subtract(&second);
            prop_assert_eq!(united.area(), either - second.area());
        }
    }

    #[test]
    fn centroid_is_the_mean_pixel() {
        let mut square = Mask::empty(10, 8);
        for (column, row) in [(2, 3), (4, 3), (2, 5), (4, 5)] {
            square.set(column, row, true);
        }
        assert_eq!(square.centroid(), Some((3.0, 4.0)));
        square.set(2, 3, false);
        assert!(!square.contains(2, 3) && square.contains(4, 5));
        assert_eq!(Mask::empty(3, 3).centroid(), None);
    }
}
