//! Compressed data of progressive files (T.81 G.1, G.2).

use super::JpegError;
use super::bits::BitReader;
use super::frame::{BLOCK_LEN, Component, Frame, Plane};
use super::huffman::{AcCode, HuffmanCode};
use super::idct::Coefficients;
use super::scan::{BlockDecoder, Scan, read_blocks};
use super::segments::Segments;

/// Maximum number of scans, against denial of service. Encoders write about ten.
const MAX_SCANS: usize = 200;

/// Decodes all components' samples.
pub(super) fn decode(segments: &mut Segments, frame: &Frame, first: Scan) -> Result<Vec<Plane>, JpegError> {
    let mut components: Vec<Stored> = frame.components.iter().map(Stored::new).collect();
    let mut scan = first;
    for _ in 0..MAX_SCANS {
        scan.check_progressive()?;
        for part in &scan.components {
            let stored = &mut components[part.index];
            // A component uses the table in force at its first scan.
            if stored.quantisation.is_none() {
                stored.quantisation = Some(*segments.quantisation(frame.components[part.index].quantisation)?);
            }
            stored.started |= scan.band.0 == 0;
        }
        let end = read_scan(segments, frame, &scan, &mut components)?;
        segments.set_position(end);
        match segments.next_scan()? {
            Some(next) => scan = next,
            None => {
                return frame
                    .components
                    .iter()
                    .zip(&components)
                    .map(|(component, stored)| stored.plane(component))
                    .collect();
            }
        }
    }
    Err(JpegError::Data("there are too many scans"))
}

/// A component's coefficients decoded so far.
struct Stored {
    /// The coefficients of each block in zigzag order. Blocks are row-major.
    coefficients: Vec<[i16; BLOCK_LEN]>,
    /// Number of blocks from one row to the next.
    stride: usize,
    quantisation: Option<[u16; BLOCK_LEN]>,
    /// True once a scan with DC coefficients has been read.
    started: bool,
}

impl Stored {
    fn new(component: &Component) -> Self {
        let (columns, rows) = component.padded_blocks;
        Self { coefficients: vec![[0; BLOCK_LEN]; columns * rows], stride: columns, quantisation: None, started: false }
    }

    fn plane(&self, component: &Component) -> Result<Plane, JpegError> {
        let quantisation = self.quantisation.filter(|_| self.started).ok_or(JpegError::NoScan)?;
        let mut plane = Plane::new(component);
        for row in 0..component.blocks.1 {
            for column in 0..component.blocks.0 {
                let stored = &self.coefficients[row * self.stride + column];
                let mut block = Coefficients::new(stored[0], quantisation[0]);
                for at in 1..BLOCK_LEN {
                    if stored[at] != 0 {
                        block.set(at, stored[at], quantisation[at]);
                    }
                }
                plane.put(column, row, &block.samples());
            }
        }
        Ok(plane)
    }
}

fn read_scan(segments: &Segments, frame: &Frame, scan: &Scan, components: &mut [Stored]) -> Result<usize, JpegError> {
    let indices: Vec<usize> = scan.components.iter().map(|part| part.index).collect();
    let low = u32::from(scan.low);
    match (scan.band.0, scan.high) {
        (0, 0) => {
            let codes = scan.components.iter().map(|part| segments.dc_code(part.dc_code)).collect::<Result<_, _>>()?;
            let predictions = vec![0; indices.len()];
            read_blocks(
                segments.scan_data(),
                frame,
                scan,
                &mut FirstDc { components, indices, codes, predictions, low },
            )
        }
        (0, _) => read_blocks(segments.scan_data(), frame, scan, &mut RefineDc { components, indices, low }),
        (_, high) => {
            let code = segments.ac_code(scan.components[0].ac_code)?;
            let component = &mut components[indices[0]];
            let mut decoder = AcScan { component, code, band: scan.band, low, blocks_to_skip: 0, refine: high > 0 };
            read_blocks(segments.scan_data(), frame, scan, &mut decoder)
        }
    }
}

/// Decoder of the first scan of DC coefficients.
struct FirstDc<'a> {
    components: &'a mut [Stored],
    indices: Vec<usize>,
    codes: Vec<&'a HuffmanCode>,
    predictions: Vec<i32>,
    low: u32,
}

impl BlockDecoder for FirstDc<'_> {
    fn block(&mut self, bits: &mut BitReader, part: usize, column: usize, row: usize) -> Result<(), JpegError> {
        let size = u32::from(self.codes[part].take(bits)?);
        let prediction = &mut self.predictions[part];
        *prediction = prediction.wrapping_add(bits.take_signed(size));
        let component = &mut self.components[self.indices[part]];
        component.coefficients[row * component.stride + column][0] = (*prediction << self.low) as i16;
        bits.check()
    }

    fn restart(&mut self) {
        self.predictions.fill(0);
    }
}

/// Decoder of a further bit of DC coefficients.
struct RefineDc<'a> {
    components: &'a mut [Stored],
    indices: Vec<usize>,
    low: u32,
}

impl BlockDecoder for RefineDc<'_> {
    fn block(&mut self, bits: &mut BitReader, part: usize, column: usize, row: usize) -> Result<(), JpegError> {
        let component = &mut self.components[self.indices[part]];
        component.coefficients[row * component.stride + column][0] |= (bits.take(1) << self.low) as i16;
        bits.check()
    }

    fn restart(&mut self) {}
}

/// Decoder of a scan of AC coefficients.
struct AcScan<'a> {
    component: &'a mut Stored,
    code: &'a AcCode,
    band: (usize, usize),
    low: u32,
    /// Number of blocks, from the next one, without further coefficients in this scan.
    blocks_to_skip: u32,
    /// True if the scan adds a bit to coefficients of earlier scans.
    refine: bool,
}

impl BlockDecoder for AcScan<'_> {
    fn block(&mut self, bits: &mut BitReader, _: usize, column: usize, row: usize) -> Result<(), JpegError> {
        let block = row * self.component.stride + column;
        if self.refine {
            self.refine(bits, block)?
        } else {
            self.first(bits, block)?
        }
        bits.check()
    }

    fn restart(&mut self) {
        self.blocks_to_skip = 0;
    }
}

impl AcScan<'_> {
    /// Reads the number of blocks that end, including this one. `exponent` is the position of the number's highest bit.
    fn end_blocks(&mut self, bits: &mut BitReader, exponent: u32) {
        self.blocks_to_skip = (1 << exponent) + bits.take(exponent);
    }

    fn first(&mut self, bits: &mut BitReader, block: usize) -> Result<(), JpegError> {
        let (mut at, last) = self.band;
        while self.blocks_to_skip == 0 && at <= last {
            let symbol = self.code.code.take(bits)?;
            let (zeros, size) = (symbol >> 4, u32::from(symbol & 15));
            if size == 0 && zeros < 15 {
                self.end_blocks(bits, u32::from(zeros));
                break;
            }
            at += usize::from(zeros);
            if size > 0 {
                let value = bits.take_signed(size) << self.low;
                *self.coefficient(block, at, last)? = value as i16;
            }
            at += 1;
        }
        self.blocks_to_skip = self.blocks_to_skip.saturating_sub(1);
        Ok(())
    }

    fn refine(&mut self, bits: &mut BitReader, block: usize) -> Result<(), JpegError> {
        let (mut at, last) = self.band;
        while self.blocks_to_skip == 0 && at <= last {
            let symbol = self.code.code.take(bits)?;
            let (zeros, size) = (symbol >> 4, symbol & 15);
            if size == 0 && zeros < 15 {
                self.end_blocks(bits, u32::from(zeros));
                break;
            }
            // A coefficient that is new in this scan has size 1, as all its higher bits are 0.
            let positive = size > 0 && bits.take(1) == 1;
            at = self.refine_known(bits, block, at, Some(zeros));
            if size > 0 {
                let unit = 1i16 << self.low;
                *self.coefficient(block, at, last)? = if positive { unit } else { -unit };
            }
            at += 1;
        }
        if self.blocks_to_skip > 0 {
            self.refine_known(bits, block, at, None);
            self.blocks_to_skip -= 1;
        }
        Ok(())
    }

    /// Reads a bit for each nonzero coefficient from `at` on. Skips `zeros` zero coefficients and stops at the next
    /// zero, or, if `zeros` is `None`, at the end of the band. Returns the index reached.
    fn refine_known(&mut self, bits: &mut BitReader, block: usize, mut at: usize, zeros: Option<u8>) -> usize {
        let coefficients = &mut self.component.coefficients[block];
        let mut left = zeros;
        while at <= self.band.1 {
            let value = &mut coefficients[at];
            if *value == 0 {
                match &mut left {
                    Some(0) => break,
                    Some(left) => *left -= 1,
                    None => {}
                }
            } else if bits.take(1) == 1 && *value & 1 << self.low == 0 {
                // Grows away from zero. The test with `&` also works for negative numbers, as all lower bits are 0.
                *value = value.wrapping_add(value.signum() << self.low);
            }
            at += 1;
        }
        at
    }

    fn coefficient(&mut self, block: usize, at: usize, last: usize) -> Result<&mut i16, JpegError> {
        if at > last {
            return Err(JpegError::Data("a block has more coefficients than its scan"));
        }
        Ok(&mut self.component.coefficients[block][at])
    }
}
