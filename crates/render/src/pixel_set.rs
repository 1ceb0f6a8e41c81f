//! A set of pixels of a tile.

/// A set of a tile's 256 pixels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PixelSet([u64; 4]);

impl PixelSet {
    /// The pixels that are not in the other set.
    #[must_use]
    pub fn without(&self, other: &Self) -> Self {
        Self(std::array::from_fn(|word| self.0[word] & !other.0[word]))
    }

    /// Adds a pixel (`16 * row + column` in the tile).
    pub fn insert(&mut self, pixel: u8) {
        self.0[usize::from(pixel) / 64] |= 1 << (pixel % 64);
    }

    /// True if the pixel is in the set.
    pub fn contains(&self, pixel: u8) -> bool {
        self.0[usize::from(pixel) / 64] >> (pixel % 64) & 1 == 1
    }

    /// Number of pixels in the set.
    pub fn len(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// True if the set is empty.
    pub fn is_empty(&self) -> bool {
        self.0 == [0; 4]
    }
}
