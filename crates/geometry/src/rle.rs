//! COCO run-length encoded masks: runs down the columns, alternately outside and inside, starting outside.

use crate::{Mask, SegmentId, SegmentMap};
use std::collections::BTreeMap;
use std::ops::Range;
use thiserror::Error;

/// An uncompressed COCO RLE: column-major run lengths, alternately outside and inside the mask.
///
/// The compressed string format is that of pycocotools' `rleToString` / `rleFrString` (`maskApi.c`): each count (from
/// the fourth on, its difference from the count two before) in base 32, low digits first, with a continuation bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RunLengths {
    /// Image width in pixels.
    pub width: usize,
    /// Image height in pixels.
    pub height: usize,
    /// Run lengths; they add up to `width * height`.
    pub counts: Vec<u32>,
}

/// Errors in a run-length encoding.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum RleError {
    /// The runs do not fill the image.
    #[error(
        "the RLE's runs add up to {found} pixels, but an image of {width}x{height} has {}",
        *width as u128 * *height as u128
    )]
    WrongTotal {
        /// Sum of the runs.
        found: u64,
        /// Width of the image.
        width: usize,
        /// Height of the image.
        height: usize,
    },
    /// The compressed string has a character outside `0`..`o`, ends within a number, or contains an invalid count.
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

    /// Encodes the mask of every segment of a map, by increasing id, in one pass.
    pub fn of_segments(map: &SegmentMap) -> BTreeMap<SegmentId, Self> {
        let (width, height) = map.size();
        // For each segment, its runs and the end of the last one.
        let mut segments: BTreeMap<SegmentId, (Vec<u32>, usize)> = BTreeMap::new();
        let (mut current, mut start) = (0, 0);
        let mut end_run = |id: SegmentId, start: usize, end: usize| {
            if id != 0 {
                let (counts, last) = segments.entry(id).or_default();
                counts.extend([(start - *last) as u32, (end - start) as u32]);
                *last = end;
            }
        };
        for column in 0..width {
            for row in 0..height {
                let (id, position) = (map[(column, row)], column * height + row);
                if id != current {
                    end_run(current, start, position);
                    (current, start) = (id, position);
                }
            }
        }
        end_run(current, start, width * height);
        let encoded = segments.into_iter().map(|(id, (mut counts, last))| {
            if last < width * height {
                counts.push((width * height - last) as u32);
            }
            (id, Self { width, height, counts })
        });
        encoded.collect()
    }

    /// Decodes to a mask.
    ///
    /// # Errors
    /// [`RleError::WrongTotal`] if the runs do not fill the image exactly. Nothing is allocated before this check.
    pub fn decode(&self) -> Result<Mask, RleError> {
        self.check_total()?;
        if self.counts.iter().all(|count| *count == 0) {
            // An image without pixels may state any width or height.
            return Ok(Mask::from_words(self.width, self.height, &[]));
        }
        let (columns, rows): (Vec<usize>, Vec<usize>) = ((0..self.width).collect(), (0..self.height).collect());
        self.decode_at(&columns, &rows)
    }

    /// Decodes only the given columns and rows: pixel `(x, y)` of the mask is pixel `(columns[x], rows[y])` of the
    /// image. Both lists must be sorted; values may repeat. This resizes and crops without a mask of the original size.
    ///
    /// # Errors
    /// [`RleError::WrongTotal`] if the runs do not fill the image exactly.
    pub fn decode_at(&self, columns: &[usize], rows: &[usize]) -> Result<Mask, RleError> {
        self.check_total()?;
        let mut words = vec![0; (columns.len() * rows.len()).div_ceil(64)];
        let mut target = Target { columns, rows, words: &mut words };
        let mut start = 0;
        for (index, count) in self.counts.iter().enumerate() {
            let end = start + *count as usize;
            if index % 2 == 1 && start < end {
                target.fill(start..end, self.height);
            }
            start = end;
        }
        Ok(Mask::from_words(columns.len(), rows.len(), &words))
    }

    fn check_total(&self) -> Result<(), RleError> {
        let found: u64 = self.counts.iter().map(|count| u64::from(*count)).sum();
        if (self.width as u64).checked_mul(self.height as u64) != Some(found) {
            return Err(RleError::WrongTotal { found, width: self.width, height: self.height });
        }
        Ok(())
    }

    /// Encodes to the compressed string format of pycocotools.
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

    /// Parses the compressed string format of pycocotools.
    ///
    /// # Errors
    /// [`RleError::Damaged`] with the position of the first invalid character.
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

/// The pixels filled by [`RunLengths::decode_at`].
struct Target<'a> {
    columns: &'a [usize],
    rows: &'a [usize],
    /// Row-major bits.
    words: &'a mut [u64],
}

impl Target<'_> {
    /// Adds the pixels of a run of column-major positions in an image of the given height.
    fn fill(&mut self, run: Range<usize>, height: usize) {
        let first = self.columns.partition_point(|column| (column + 1) * height <= run.start);
        let last = self.columns.partition_point(|column| column * height < run.end);
        // Columns entirely inside the run are filled together, row by row.
        let whole_first = self.columns.partition_point(|column| column * height < run.start);
        let whole_last = self.columns.partition_point(|column| (column + 1) * height <= run.end).max(whole_first);
        if whole_first < whole_last {
            for row in 0..self.rows.len() {
                let start = row * self.columns.len();
                fill_bits(self.words, start + whole_first..start + whole_last);
            }
        }
        for column in (first..whole_first.min(last)).chain(whole_last..last) {
            let top = self.columns[column] * height;
            let inside = run.start.saturating_sub(top)..run.end - top;
            let first_row = self.rows.partition_point(|row| *row < inside.start);
            let last_row = self.rows.partition_point(|row| *row < inside.end);
            for row in first_row..last_row {
                let pixel = row * self.columns.len() + column;
                self.words[pixel / 64] |= 1 << (pixel % 64);
            }
        }
    }
}

/// Sets a nonempty range of bits.
fn fill_bits(words: &mut [u64], bits: Range<usize>) {
    let (first, last) = (bits.start / 64, (bits.end - 1) / 64);
    let (from, to) = (u64::MAX << (bits.start % 64), u64::MAX >> (63 - (bits.end - 1) % 64));
    if first == last {
        words[first] |= from & to;
    } else {
        words[first] |= from;
        words[first + 1..last].fill(u64::MAX);
        words[last] |= to;
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
        fn columns_and_rows_are_picked_from_the_image(
            counts in prop::collection::vec(0u32..40, 1..12),
            columns in prop::collection::vec(0usize..9, 0..80),
            rows in prop::collection::vec(0usize..11, 0..12),
        ) {
            let mut counts = counts;
            let (mut columns, mut rows, mut left) = (columns, rows, 99);
            counts.iter_mut().for_each(|count| { *count = (*count).min(left); left -= *count; });
            counts.push(left);
            columns.sort_unstable();
            rows.sort_unstable();
            let runs = RunLengths { width: 9, height: 11, counts };
            // Column-major, as in the format.
            let mut pixels = Vec::new();
            for (index, count) in runs.counts.iter().enumerate() {
                pixels.extend(std::iter::repeat_n(index % 2 == 1, *count as usize));
            }
            let expected = |columns: &[usize], rows: &[usize]| {
                Mask::from_fn(columns.len(), rows.len(), |column, row| pixels[columns[column] * 11 + rows[row]])
            };
            prop_assert_eq!(runs.decode_at(&columns, &rows).unwrap(), expected(&columns, &rows));
            let all: (Vec<usize>, Vec<usize>) = ((0..9).collect(), (0..11).collect());
            prop_assert_eq!(runs.decode().unwrap(), expected(&all.0, &all.1));
        }

        #[test]
        fn damaged_text_never_panics(text in "\\PC{0,40}") {
            if let Ok(runs) = RunLengths::from_compressed(12, 8, &text) {
                let _ = runs.decode();
            }
        }
    }

    #[test]
    fn encoding_all_segments_at_once_is_encoding_each() {
        let map = SegmentMap::from_fn(7, 5, |column, row| [0, 3, 3, 9, 70_000, 0][(column * 5 + row * row) % 6]);
        let all = RunLengths::of_segments(&map);
        assert_eq!(all.keys().copied().collect::<Vec<_>>(), [3, 9, 70_000]);
        for (id, runs) in all {
            assert_eq!(runs, RunLengths::encode(&map.mask_of(id)), "id {id}");
        }
        let full = RunLengths::of_segments(&SegmentMap::filled(3, 2, 4));
        assert_eq!(full[&4], RunLengths::encode(&Mask::from_fn(3, 2, |_, _| true)));
        assert!(RunLengths::of_segments(&SegmentMap::filled(0, 0, 0)).is_empty());
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
    fn an_image_without_pixels_may_be_of_any_width() {
        let none = RunLengths { width: usize::MAX, height: 0, counts: vec![] };
        let mask = none.decode().unwrap();
        assert_eq!((mask.width(), mask.height(), mask.is_empty()), (usize::MAX, 0, true));
    }

    #[test]
    fn wrong_totals_are_refused_before_allocation() {
        let huge = RunLengths { width: usize::MAX, height: 2, counts: vec![4] };
        let error = huge.decode().unwrap_err();
        assert!(matches!(error, RleError::WrongTotal { .. }));
        assert!(error.to_string().ends_with(&format!("has {}", usize::MAX as u128 * 2)), "{error}");
        assert_eq!(RunLengths::from_compressed(4, 5, "6P"), Err(RleError::Damaged { position: 2 }));
    }
}
