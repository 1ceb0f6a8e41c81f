//! Binary masks, packed into bits so that overlaps are counted 64 pixels at a time.
//!
//! Only blocks that contain pixels of the mask are stored, so memory is proportional to the covered area. This matters
//! for thousands of overlapping masks of a large image, and for segments scattered all over it.

use crate::QuarterTurn;
use std::iter::Peekable;
use std::ops::Range;

/// Number of words in a [`Block`]: few, so that small masks stay small, but enough to count many pixels per comparison.
const BLOCK_WORDS: usize = 4;
/// Number of pixels in a [`Block`].
const BLOCK_PIXELS: usize = 64 * BLOCK_WORDS;

/// A binary mask over an image of `height` × `width` pixels.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Mask {
    width: usize,
    height: usize,
    /// Sorted by index. No block is empty, so equal masks have equal blocks.
    blocks: Vec<Block>,
}

/// [`BLOCK_PIXELS`] consecutive pixels, row-major.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Block {
    /// Index of the first pixel divided by [`BLOCK_PIXELS`].
    index: usize,
    /// Pixel `i` is bit `i % 64` of word `i / 64`.
    words: [u64; BLOCK_WORDS],
}

impl Block {
    fn empty(index: usize) -> Self {
        Self { index, words: [0; BLOCK_WORDS] }
    }

    fn is_empty(&self) -> bool {
        self.words == [0; BLOCK_WORDS]
    }

    /// Adds or removes the pixel with the given row-major index.
    fn set(&mut self, pixel: usize, inside: bool) {
        let word = &mut self.words[pixel % BLOCK_PIXELS / 64];
        let bit = 1 << (pixel % 64);
        if inside {
            *word |= bit;
        } else {
            *word &= !bit;
        }
    }

    fn count(words: [u64; BLOCK_WORDS]) -> usize {
        words.iter().map(|word| word.count_ones() as usize).sum()
    }
}

/// A mask with its segmenter's confidence. Masks of one image may overlap.
#[derive(Clone, Debug, PartialEq)]
pub struct ScoredMask {
    /// The pixels of the segment.
    pub mask: Mask,
    /// Confidence in [0, 1].
    pub score: f32,
}

impl Mask {
    /// Creates a mask without pixels. It allocates no memory.
    pub fn empty(width: usize, height: usize) -> Self {
        Self { width, height, blocks: Vec::new() }
    }

    /// Creates the mask of all pixels for which `inside(column, row)` is true.
    pub fn from_fn(width: usize, height: usize, mut inside: impl FnMut(usize, usize) -> bool) -> Self {
        let mut mask = Self::empty(width, height);
        for row in 0..height {
            for column in 0..width {
                if inside(column, row) {
                    mask.insert_index(row * width + column);
                }
            }
        }
        mask.shrink();
        mask
    }

    /// Frees unused capacity.
    pub(crate) fn shrink(&mut self) {
        self.blocks.shrink_to_fit();
    }

    /// Creates a mask whose pixel `i` (row-major) is bit `i % 64` of word `i / 64`. Bits past the last pixel must be 0.
    pub(crate) fn from_words(width: usize, height: usize, words: &[u64]) -> Self {
        let block = |(index, chunk): (usize, &[u64])| {
            let mut block = Block::empty(index);
            block.words[..chunk.len()].copy_from_slice(chunk);
            block
        };
        let blocks = words.chunks(BLOCK_WORDS).enumerate().map(block).filter(|block| !block.is_empty());
        let mut mask = Self { width, height, blocks: blocks.collect() };
        mask.shrink();
        mask
    }

    /// Returns the mask of the turned image.
    #[must_use]
    pub fn turned(&self, turn: QuarterTurn) -> Self {
        let size = (self.width, self.height);
        let (width, height) = turn.size(size);
        let mut words = vec![0; (width * height).div_ceil(64)];
        for index in self.pixel_indices() {
            let (column, row) = turn.pixel((index % self.width, index / self.width), size);
            let index = row * width + column;
            words[index / 64] |= 1 << (index % 64);
        }
        Self::from_words(width, height, &words)
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Memory used by the pixels, in bytes.
    pub fn memory_bytes(&self) -> usize {
        self.blocks.capacity() * size_of::<Block>()
    }

    /// True if the pixel belongs to the mask.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    pub fn contains(&self, column: usize, row: usize) -> bool {
        assert!(column < self.width && row < self.height, "pixel ({column}, {row}) is outside the mask");
        let pixel = row * self.width + column;
        let block = self.place(pixel / BLOCK_PIXELS).ok().map(|place| &self.blocks[place]);
        block.is_some_and(|block| block.words[pixel % BLOCK_PIXELS / 64] >> (pixel % 64) & 1 == 1)
    }

    /// Adds or removes one pixel.
    ///
    /// # Panics
    /// If the pixel is outside the image.
    pub fn set(&mut self, column: usize, row: usize, inside: bool) {
        assert!(column < self.width && row < self.height, "pixel ({column}, {row}) is outside the mask");
        let pixel = row * self.width + column;
        if inside {
            self.insert_index(pixel);
        } else if let Ok(place) = self.place(pixel / BLOCK_PIXELS) {
            self.blocks[place].set(pixel, false);
            if self.blocks[place].is_empty() {
                self.blocks.remove(place);
            }
        }
    }

    /// Adds the pixels of a row in a range of columns.
    ///
    /// # Panics
    /// If the range leaves the image.
    pub fn insert_run(&mut self, row: usize, columns: Range<usize>) {
        assert!(
            columns.end <= self.width && row < self.height,
            "columns {columns:?} of row {row} are outside the mask"
        );
        let (mut pixel, end) = (row * self.width + columns.start, row * self.width + columns.end);
        while pixel < end {
            let next = end.min((pixel / 64 + 1) * 64);
            let bits = u64::MAX >> (64 - (next - pixel)) << (pixel % 64);
            let place = self.block_of(pixel / BLOCK_PIXELS);
            self.blocks[place].words[pixel % BLOCK_PIXELS / 64] |= bits;
            pixel = next;
        }
    }

    /// Number of pixels.
    pub fn area(&self) -> usize {
        self.blocks.iter().map(|block| Block::count(block.words)).sum()
    }

    /// True if the mask has no pixels.
    pub fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Adds the pixel with the given row-major index, which must be inside the image.
    pub(crate) fn insert_index(&mut self, pixel: usize) {
        let place = self.block_of(pixel / BLOCK_PIXELS);
        self.blocks[place].set(pixel, true);
    }

    /// Position of the block with the given index, which is added if it is missing.
    #[inline]
    fn block_of(&mut self, index: usize) -> usize {
        // Masks are mostly built row by row.
        if self.blocks.last().is_some_and(|last| last.index == index) {
            return self.blocks.len() - 1;
        }
        self.place(index).unwrap_or_else(|place| {
            self.blocks.insert(place, Block::empty(index));
            place
        })
    }

    /// Position of the block with the given index, or, as an error, the position at which to insert it.
    fn place(&self, index: usize) -> Result<usize, usize> {
        match (self.blocks.first(), self.blocks.last()) {
            (Some(first), Some(last)) if (first.index..=last.index).contains(&index) => {
                // If no block before it is missing, a block's position follows from its index.
                let place = index - first.index;
                match self.blocks.get(place) {
                    Some(block) if block.index == index => Ok(place),
                    _ => self.blocks.binary_search_by_key(&index, |block| block.index),
                }
            }
            (Some(first), Some(_)) if index < first.index => Err(0),
            _ => Err(self.blocks.len()),
        }
    }

    /// Row-major indices of the mask's pixels, in increasing order.
    pub fn pixel_indices(&self) -> impl Iterator<Item = usize> + '_ {
        let words = |block: &Block| {
            let first = block.index * BLOCK_PIXELS;
            block.words.into_iter().enumerate().map(move |(place, word)| (first + place * 64, word))
        };
        self.blocks.iter().flat_map(words).flat_map(|(first, word)| {
            let mut rest = word;
            std::iter::from_fn(move || {
                (rest != 0).then(|| {
                    let bit = rest.trailing_zeros() as usize;
                    rest &= rest - 1;
                    first + bit
                })
            })
        })
    }

    /// The mean (column, row) of the mask's pixels. `None` if the mask is empty.
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
        let mut theirs = other.blocks.iter().peekable();
        let common = |ours: &Block| {
            matching(&mut theirs, ours.index)
                .map_or(0, |theirs| Block::count(std::array::from_fn(|word| ours.words[word] & theirs.words[word])))
        };
        self.blocks.iter().map(common).sum()
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
        let mut missing = Vec::new();
        let mut ours = self.blocks.iter_mut().peekable();
        for theirs in &other.blocks {
            while ours.next_if(|block| block.index < theirs.index).is_some() {}
            match ours.next_if(|block| block.index == theirs.index) {
                Some(ours) => ours.words.iter_mut().zip(theirs.words).for_each(|(word, more)| *word |= more),
                None => missing.push(*theirs),
            }
        }
        if !missing.is_empty() {
            self.blocks.extend(missing);
            // A stable sort merges the two sorted runs.
            self.blocks.sort_by_key(|block| block.index);
        }
    }

    /// Removes the pixels of `other`.
    ///
    /// # Panics
    /// If the masks differ in size.
    pub fn subtract(&mut self, other: &Self) {
        self.assert_same_size(other);
        let mut theirs = other.blocks.iter().peekable();
        self.blocks.retain_mut(|ours| {
            if let Some(theirs) = matching(&mut theirs, ours.index) {
                ours.words.iter_mut().zip(theirs.words).for_each(|(word, less)| *word &= !less);
            }
            !ours.is_empty()
        });
        if self.blocks.len() < self.blocks.capacity() / 2 {
            self.shrink();
        }
    }

    fn assert_same_size(&self, other: &Self) {
        assert_eq!((self.width, self.height), (other.width, other.height), "masks of different images");
    }
}

/// Advances to the block with the given index and returns it if it exists.
fn matching<'a>(blocks: &mut Peekable<impl Iterator<Item = &'a Block>>, index: usize) -> Option<&'a Block> {
    while blocks.next_if(|block| block.index < index).is_some() {}
    blocks.next_if(|block| block.index == index)
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
        fn runs_are_their_pixels(runs in prop::collection::vec((0..9_usize, 0..150_usize, 0..150_usize), 0..12)) {
            let (mut whole, mut single) = (Mask::empty(149, 9), Mask::empty(149, 9));
            for (row, one, other) in runs {
                let columns = one.min(other)..one.max(other);
                whole.insert_run(row, columns.clone());
                columns.for_each(|column| single.set(column, row, true));
            }
            prop_assert_eq!(whole, single);
        }
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

    proptest! {
        #[test]
        fn scattered_pixels_match_a_set(steps in prop::collection::vec((0usize..70, 0usize..40, any::<bool>()), 0..200),
                                             more in prop::collection::vec((0usize..70, 0usize..40), 0..60)) {
            let mut expected = std::collections::BTreeSet::new();
            let mut found = Mask::empty(70, 40);
            for (column, row, inside) in steps {
                found.set(column, row, inside);
                if inside { expected.insert(row * 70 + column); } else { expected.remove(&(row * 70 + column)); }
            }
            let other: std::collections::BTreeSet<usize> = more.iter().map(|(column, row)| row * 70 + column).collect();
            let other_mask = Mask::from_fn(70, 40, |column, row| other.contains(&(row * 70 + column)));
            prop_assert_eq!(&found, &Mask::from_fn(70, 40, |column, row| expected.contains(&(row * 70 + column))));
            prop_assert_eq!(found.pixel_indices().collect::<Vec<_>>(), expected.iter().copied().collect::<Vec<_>>());
            prop_assert_eq!(found.intersection_area(&other_mask), expected.intersection(&other).count());
            let mut united = found.clone();
            united.unite(&other_mask);
            prop_assert_eq!(united.pixel_indices().collect::<Vec<_>>(), expected.union(&other).copied().collect::<Vec<_>>());
            found.subtract(&other_mask);
            prop_assert_eq!(&found, &Mask::from_fn(70, 40, |column, row| {
                let pixel = row * 70 + column;
                expected.contains(&pixel) && !other.contains(&pixel)
            }));
            for row in 0..40 {
                for column in 0..70 {
                    let pixel = row * 70 + column;
                    prop_assert_eq!(found.contains(column, row), expected.contains(&pixel) && !other.contains(&pixel));
                }
            }
        }
    }

    #[test]
    fn a_mask_takes_memory_for_its_pixels_and_not_for_the_image() {
        let spot = Mask::from_fn(4096, 4096, |column, row| column / 100 == 20 && row / 100 == 20);
        assert_eq!(spot.area(), 10_000);
        assert!(spot.memory_bytes() < 16_000, "{}", spot.memory_bytes());
        assert_eq!(Mask::empty(usize::MAX, 8).memory_bytes(), 0);
    }

    #[test]
    fn a_mask_turns_as_its_image() {
        let image = crate::Image::from_fn(23, 17, |column, row| (column * row) % 7 == 3);
        let mask = |image: &crate::Image<bool>| {
            Mask::from_fn(image.width(), image.height(), |column, row| image[(column, row)])
        };
        for turn in QuarterTurn::ALL {
            assert_eq!(mask(&image).turned(turn), mask(&image.turned(turn)));
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
