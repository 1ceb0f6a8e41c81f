//! Huffman codes (T.81 annexes C and F.2.2.3).

use super::JpegError;
use super::bits::{BitReader, signed};

/// Codes up to this length are decoded by one table lookup.
const LOOKUP_BITS: u32 = 9;
/// Maximum length of a code.
const LONGEST: usize = 16;

/// A Huffman code.
pub(super) struct HuffmanCode {
    symbols: Vec<u8>,
    /// Symbol and code length for each value of the next 9 bits. The length is 0 if the code is longer.
    lookup: [(u8, u8); 1 << LOOKUP_BITS],
    /// For each length, the first number after the codes of this length.
    ends: [u32; LONGEST + 1],
    /// For each length, the index of a code's symbol minus the code as a number.
    offsets: [i32; LONGEST + 1],
}

impl HuffmanCode {
    /// Builds a code from the number of codes of each length 1 to 16 and the symbols, shortest code first. `None` if no
    /// prefix code has these lengths or there are too few symbols.
    pub(super) fn new(counts: &[u8; LONGEST], symbols: &[u8]) -> Option<Self> {
        let mut code = Self {
            symbols: symbols.to_vec(),
            lookup: [(0, 0); 1 << LOOKUP_BITS],
            ends: [0; LONGEST + 1],
            offsets: [0; LONGEST + 1],
        };
        let (mut next_code, mut next_symbol) = (0u32, 0usize);
        for length in 1..=LONGEST {
            let count = usize::from(counts[length - 1]);
            code.offsets[length] = next_symbol as i32 - next_code as i32;
            for symbol in symbols.get(next_symbol..next_symbol + count)? {
                code.enter(next_code, length as u32, *symbol)?;
                next_code += 1;
            }
            next_symbol += count;
            // The code of all ones is reserved.
            if next_symbol < symbols.len() && next_code >= 1 << length {
                return None;
            }
            code.ends[length] = next_code;
            next_code <<= 1;
        }
        Some(code)
    }

    fn enter(&mut self, code: u32, length: u32, symbol: u8) -> Option<()> {
        if code >= 1 << length {
            return None;
        }
        if length <= LOOKUP_BITS {
            let free = LOOKUP_BITS - length;
            let first = (code << free) as usize;
            self.lookup[first..first + (1 << free)].fill((symbol, length as u8));
        }
        Some(())
    }

    /// True if all symbols are at most `limit`.
    pub(super) fn is_within(&self, limit: u8) -> bool {
        self.symbols.iter().all(|symbol| *symbol <= limit)
    }

    /// Reads the next symbol. 15 more bits are available afterwards.
    #[inline(always)]
    pub(super) fn take(&self, bits: &mut BitReader) -> Result<u8, JpegError> {
        bits.refill();
        let (symbol, length) = self.lookup[bits.peek(LOOKUP_BITS) as usize];
        if length == 0 {
            let symbol;
            (symbol, *bits) = self.take_long(*bits)?;
            return Ok(symbol);
        }
        bits.skip(u32::from(length));
        Ok(symbol)
    }

    #[cold]
    #[inline(never)]
    fn take_long<'a>(&self, mut bits: BitReader<'a>) -> Result<(u8, BitReader<'a>), JpegError> {
        for length in LOOKUP_BITS + 1..=LONGEST as u32 {
            let code = bits.peek(length);
            if code < self.ends[length as usize] {
                let index = code as i32 + self.offsets[length as usize];
                bits.skip(length);
                return self.symbols.get(index as usize).map(|symbol| (*symbol, bits)).ok_or(BAD_CODE);
            }
        }
        Err(BAD_CODE)
    }
}

const BAD_CODE: JpegError = JpegError::Data("it contains an undefined Huffman code");

/// A coefficient encoded in at most 9 bits.
#[derive(Clone, Copy, Default)]
pub(super) struct ShortCoefficient {
    /// The quantised coefficient, not 0.
    pub(super) value: i16,
    /// Number of zeros before it.
    pub(super) zeros: u8,
    /// Number of bits. 0 if the next 9 bits do not determine a nonzero coefficient.
    pub(super) length: u8,
}

/// A code for AC coefficients: a Huffman code for the number of zeros and the size, followed by the number.
pub(super) struct AcCode {
    /// Huffman code for the number of zeros (high 4 bits) and the size (low 4).
    pub(super) code: HuffmanCode,
    short: [ShortCoefficient; 1 << LOOKUP_BITS],
}

impl AcCode {
    /// Precomputes the short coefficients of `code`.
    pub(super) fn new(code: HuffmanCode) -> Self {
        let mut short = [ShortCoefficient::default(); 1 << LOOKUP_BITS];
        for (bits, entry) in short.iter_mut().enumerate() {
            let (symbol, length) = code.lookup[bits];
            let size = u32::from(symbol & 15);
            let total = u32::from(length) + size;
            if length > 0 && size > 0 && total <= LOOKUP_BITS {
                let number = bits as i32 >> (LOOKUP_BITS - total) & ((1 << size) - 1);
                *entry =
                    ShortCoefficient { value: signed(number, size) as i16, zeros: symbol >> 4, length: total as u8 };
            }
        }
        Self { code, short }
    }

    /// Looks up the next 9 bits, which must be available.
    #[inline(always)]
    pub(super) fn peek_short(&self, bits: &BitReader) -> ShortCoefficient {
        self.short[bits.peek(LOOKUP_BITS) as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(of_lengths: &[(usize, u8)]) -> [u8; LONGEST] {
        let mut counts = [0; LONGEST];
        for (length, count) in of_lengths {
            counts[length - 1] = *count;
        }
        counts
    }

    #[test]
    fn short_and_long_codes() {
        // 0, 10, 110, then 1110 0000 0000 0 and 1110 0000 0000 1.
        let code = HuffmanCode::new(&counts(&[(1, 1), (2, 1), (3, 1), (13, 2)]), &[7, 8, 9, 10, 11]).unwrap();
        let mut bits = BitReader::new(&[0b1101_0011, 0b1000_0000, 0b0011_1100, 0, 0xFF, 0, 0xE0], 0);
        let taken: Vec<u8> = (0..5).map(|_| code.take(&mut bits).unwrap()).collect();
        assert_eq!(taken, [9, 8, 7, 11, 10]);
        assert_eq!(code.take(&mut bits), Err(BAD_CODE));
    }

    #[test]
    fn too_many_codes() {
        assert!(HuffmanCode::new(&counts(&[(1, 3)]), &[1, 2, 3]).is_none());
        assert!(HuffmanCode::new(&counts(&[(1, 2), (2, 1)]), &[1, 2, 3]).is_none());
        assert!(HuffmanCode::new(&counts(&[(2, 3)]), &[1, 2]).is_none());
    }

    #[test]
    fn short_coefficients() {
        // Code 0 stands for two zeros and a number of two bits.
        let code = AcCode::new(HuffmanCode::new(&counts(&[(1, 1)]), &[0x22]).unwrap());
        let mut bits = BitReader::new(&[0b0010_0000], 0);
        bits.refill();
        let found = code.peek_short(&bits);
        assert_eq!((found.value, found.zeros, found.length), (-2, 2, 3));
    }
}
