//! Reads the bits of compressed data between two markers.

use super::JpegError;

/// Minimum number of bits available after [`BitReader::refill`]: enough for the longest code (16) and the number after
/// it (15).
const REFILLED: u32 = 32;

/// Reads bits, the highest of each byte first. Past the last bit it returns zeros, which [`BitReader::check`] reports.
///
/// Rare cases are methods that take and return the reader by value, so that otherwise it can stay in registers.
#[derive(Clone, Copy)]
pub(super) struct BitReader<'a> {
    bytes: &'a [u8],
    position: usize,
    /// The next bits, starting at the highest.
    window: u64,
    /// Number of valid bits in the window.
    filled: u32,
    /// Number of zero bits appended after the end of the data, the last of the valid bits.
    padding: u32,
}

impl<'a> BitReader<'a> {
    /// Starts at byte `position`.
    pub(super) fn new(bytes: &'a [u8], position: usize) -> Self {
        Self { bytes, position, window: 0, filled: 0, padding: 0 }
    }

    /// Position after the bytes read into the window. Never past a marker.
    pub(super) fn position(&self) -> usize {
        self.position
    }

    /// Makes 32 bits available, enough for a code and the number that follows it.
    #[inline(always)]
    pub(super) fn refill(&mut self) {
        if self.filled < REFILLED {
            self.fill();
        }
    }

    #[inline(always)]
    fn fill(&mut self) {
        if let Some(chunk) = self.bytes.get(self.position..).and_then(|rest| rest.first_chunk()) {
            let word = u32::from_be_bytes(*chunk);
            let inverse = !word;
            // True if no byte of `inverse` is zero, that is, no byte of `word` is FF.
            if inverse.wrapping_sub(0x0101_0101) & word & 0x8080_8080 == 0 {
                self.window |= u64::from(word) << (REFILLED - self.filled);
                self.filled += 32;
                self.position += 4;
                return;
            }
        }
        *self = self.filled_bytewise();
    }

    #[cold]
    #[inline(never)]
    fn filled_bytewise(mut self) -> Self {
        while self.filled <= 56 {
            match self.next_byte() {
                Some(byte) => self.window |= u64::from(byte) << (56 - self.filled),
                None => self.padding += 8,
            }
            self.filled += 8;
        }
        self
    }

    /// Reads a byte of data, with FF 00 decoded to FF. `None` before a marker and at the end of the file.
    fn next_byte(&mut self) -> Option<u8> {
        let byte = *self.bytes.get(self.position)?;
        if byte != 0xFF {
            self.position += 1;
            return Some(byte);
        }
        let mut after = self.position + 1;
        while *self.bytes.get(after)? == 0xFF {
            after += 1; // A marker may be preceded by any number of FF.
        }
        (self.bytes[after] == 0).then(|| {
            self.position = after + 1;
            0xFF
        })
    }

    /// Returns the next `count` bits (at most 32) without consuming them.
    #[inline(always)]
    pub(super) fn peek(&self, count: u32) -> u32 {
        ((self.window >> 1) >> (63 - count)) as u32
    }

    /// Consumes `count` bits, which must be available.
    #[inline(always)]
    pub(super) fn skip(&mut self, count: u32) {
        self.window <<= count;
        self.filled -= count;
    }

    /// Reads `count` bits (at most 16), refilling first.
    #[inline(always)]
    pub(super) fn take(&mut self, count: u32) -> u32 {
        self.refill();
        let bits = self.peek(count);
        self.skip(count);
        bits
    }

    /// Reads a number of `size` bits (at most 15, which must be available) in the encoding of T.81 F.2.2.1: numbers
    /// with a leading 0 are negative.
    #[inline(always)]
    pub(super) fn take_signed(&mut self, size: u32) -> i32 {
        let bits = self.peek(size) as i32;
        self.skip(size);
        signed(bits, size)
    }

    /// Checks that no bits were read past the end of the data.
    #[inline(always)]
    pub(super) fn check(&self) -> Result<(), JpegError> {
        if self.filled < self.padding { Err(JpegError::Data("it ends early")) } else { Ok(()) }
    }

    /// Skips past the next marker, which must be the restart marker `number` (0 to 7).
    pub(super) fn restart(&mut self, number: u8) -> Result<(), JpegError> {
        while let Some(pair) = self.bytes.get(self.position..).and_then(|rest| rest.first_chunk::<2>()) {
            match *pair {
                [0xFF, 0 | 0xFF] => self.position += 1,
                [0xFF, marker] if marker == 0xD0 + number => {
                    *self = Self::new(self.bytes, self.position + 2);
                    return Ok(());
                }
                [0xFF, _] => break,
                _ => self.position += 1,
            }
        }
        Err(JpegError::Data("a restart marker is missing"))
    }
}

/// Decodes a number of `size` bits; see [`BitReader::take_signed`].
#[inline(always)]
pub(super) fn signed(bits: i32, size: u32) -> i32 {
    let end = 1 << size;
    if bits < end >> 1 { bits - end + 1 } else { bits }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stuffed_bytes_and_markers() {
        let mut bits = BitReader::new(&[0xAB, 0xFF, 0x00, 0x01, 0xFF, 0xFF, 0xD9, 0x77], 0);
        assert_eq!([bits.take(4), bits.take(12), bits.take(8)], [0xA, 0xBFF, 0x01]);
        assert_eq!((bits.position(), bits.check()), (4, Ok(())));
        assert_eq!(bits.take(1), 0);
        assert!(bits.check().is_err());
    }

    #[test]
    fn restarts_skip_remaining_bits() {
        let mut bits = BitReader::new(&[0x80, 0x12, 0xFF, 0x00, 0xFF, 0xD3, 0xC0], 0);
        assert_eq!(bits.take(1), 1);
        assert!(bits.restart(4).is_err());
        bits.restart(3).unwrap();
        assert_eq!((bits.take(2), bits.check()), (3, Ok(())));
    }

    #[test]
    fn numbers_have_their_sign_in_the_first_bit() {
        assert_eq!(
            [(0, 0), (0, 1), (1, 1), (0, 3), (3, 3), (4, 3)].map(|(bits, size)| signed(bits, size)),
            [0, -1, 1, -7, -4, 4]
        );
    }
}
