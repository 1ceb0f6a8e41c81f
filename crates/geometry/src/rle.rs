//! COCO run-length encoded masks: runs down the columns, alternately outside and inside, starting outside.

use crate::Mask;
use thiserror::Error;

/// An uncompressed COCO RLE: column-major run lengths, alternately outside and inside the mask.
///
/// The compressed string form is that of pycocotools' `rleToString` / `rleFrString` (`maskApi.c`): each count (from
/// the third on, its difference to the count two before) in base 32, low digits first, with a continuation bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunLengths {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Run lengths; they add up to `width * height`.
    pub counts: Vec<u32>,
}

/// An RLE that does not describe a mask.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum RleError {
    /// The runs do not fill the image.
    #[error("the RLE's runs add up to {found} pixels, but an image of {width}x{height} has {}", width * height)]
    WrongTotal {
        /// Sum of the runs.
        found: u64,
        /// Stated width.
        width: usize,
        /// Stated height.
        height: usize,
    },
    /// The compressed string has a character outside `0`..`o`, ends inside a number, or holds a number that is not a valid count.
    #[error("the compressed RLE is damaged at character {position}")]
    Damaged {
        /// Index of the offending character.
        position: usize,
    },
}

impl RunLengths {
    /// Encodes a mask.
    pub fn encode(mask: &Mask) -> Self {
        let (width, height) = (mask.width(), mask.height());
        let mut counts = Vec::new();
        let (mut inside, mut run) = (false, 0u32);
        for column in 0..width {
            for row in 0..height {
                if mask.contains(column, row) != inside {
                    counts.push(run);
                    (inside, run) = (!inside, 0);
                }
                run += 1;
            }
        }
        counts.push(run);
        Self { width, height, counts }
    }

    /// Decodes to a mask.
    ///
    /// # Errors
    /// [`RleError::WrongTotal`] if the runs do not fill the image exactly. Nothing is allocated before that check.
    pub fn decode(&self) -> Result<Mask, RleError> {
        let found: u64 = self.counts.iter().map(|count| u64::from(*count)).sum();
        if (self.width as u64).checked_mul(self.height as u64) != Some(found) {
            return Err(RleError::WrongTotal { found, width: self.width, height: self.height });
        }
        let mut mask = Mask::empty(self.width, self.height);
        let mut start = 0;
        for (index, count) in self.counts.iter().enumerate() {
            let end = start + *count as usize;
            if index % 2 == 1 {
                for position in start..end {
                    mask.set(position / self.height, position % self.height, true);
                }
            }
            start = end;
        }
        Ok(mask)
    }

    /// The compressed string that pycocotools writes.
    pub fn to_compressed(&self) -> String {
        let mut text = String::new();
        for (index, count) in self.counts.iter().enumerate() {
            let mut rest = i64::from(*count);
            if index > 2 {
                rest -= i64::from(self.counts[index - 2]);
            }
            loop {
                let digit = (rest & 0x1f) as u8;
                rest >>= 5;
                let more = if digit & 0x10 != 0 { rest != -1 } else { rest != 0 };
                text.push(char::from(48 + (digit | if more { 0x20 } else { 0 })));
                if !more {
                    break;
                }
            }
        }
        text
    }

    /// Reads the compressed string that pycocotools writes.
    ///
    /// # Errors
    /// [`RleError::Damaged`] names the first character that cannot be read.
    pub fn from_compressed(width: usize, height: usize, text: &str) -> Result<Self, RleError> {
        let mut counts: Vec<u32> = Vec::new();
        let (mut value, mut shift, mut open) = (0i64, 0u32, false);
        for (position, byte) in text.bytes().enumerate() {
            if !(48..112).contains(&byte) || shift > 35 {
                return Err(RleError::Damaged { position });
            }
            let digit = byte - 48;
            value |= i64::from(digit & 0x1f) << shift;
            shift += 5;
            open = digit & 0x20 != 0;
            if open {
                continue;
            }
            if digit & 0x10 != 0 {
                value |= -1 << shift;
            }
            if counts.len() > 2 {
                value += i64::from(counts[counts.len() - 2]);
            }
            counts.push(u32::try_from(value).map_err(|_| RleError::Damaged { position })?);
            (value, shift) = (0, 0);
        }
        if open {
            return Err(RleError::Damaged { position: text.len() });
        }
        Ok(Self { width, height, counts })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn encoding_is_lossless(pixels in prop::collection::vec(any::<bool>(), 96..=96)) {
            let mask = Mask::from_fn(12, 8, |column, row| pixels[row * 12 + column]);
            let runs = RunLengths::encode(&mask);
            prop_assert_eq!(runs.decode().unwrap(), mask);
            let text = runs.to_compressed();
            prop_assert_eq!(RunLengths::from_compressed(12, 8, &text).unwrap(), runs);
        }

        #[test]
        fn damaged_text_never_panics(text in "\\PC{0,40}") {
            if let Ok(runs) = RunLengths::from_compressed(12, 8, &text) {
                let _ = runs.decode();
            }
        }
    }

    /// `pycocotools.mask.encode` of a 5-row, 4-column mask whose rows 1 and 2 are set in columns 1 and 2.
    #[test]
    fn agrees_with_pycocotools() {
        let mask = Mask::from_fn(4, 5, |column, row| (1..3).contains(&column) && (1..3).contains(&row));
        let runs = RunLengths::encode(&mask);
        assert_eq!(runs.counts, [6, 2, 3, 2, 7]);
        assert_eq!(runs.to_compressed(), "62304");
    }

    #[test]
    fn lying_sizes_are_refused_before_memory_is_taken() {
        let huge = RunLengths { width: usize::MAX, height: 2, counts: vec![4] };
        assert!(matches!(huge.decode(), Err(RleError::WrongTotal { .. })));
        assert_eq!(RunLengths::from_compressed(4, 5, "6P"), Err(RleError::Damaged { position: 2 }));
    }
}
