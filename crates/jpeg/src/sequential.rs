//! Compressed data of sequential files, baseline and extended (T.81 F.2).

use super::JpegError;
use super::bits::BitReader;
use super::frame::{BLOCK_LEN, Frame, Plane};
use super::huffman::{AcCode, HuffmanCode};
use super::idct::Coefficients;
use super::scan::{BlockDecoder, Scan, read_blocks};
use super::segments::Segments;

/// Decodes all components' samples.
pub(super) fn decode(segments: &mut Segments, frame: &Frame, first: Scan) -> Result<Vec<Plane>, JpegError> {
    let mut planes: Vec<Option<Plane>> = frame.components.iter().map(|_| None).collect();
    let mut scan = first;
    loop {
        let mut decoder = SequentialScan::new(segments, frame, &scan)?;
        let end = read_blocks(segments.scan_data(), frame, &scan, &mut decoder)?;
        for (part, component) in decoder.parts.into_iter().zip(&scan.components) {
            if planes[component.index].replace(part.plane).is_some() {
                return Err(JpegError::Data("a component occurs twice"));
            }
        }
        segments.set_position(end);
        if planes.iter().all(Option::is_some) {
            return Ok(planes.into_iter().flatten().collect());
        }
        scan = segments.next_scan()?.ok_or(JpegError::NoScan)?;
    }
}

struct SequentialScan<'a> {
    parts: Vec<Part<'a>>,
}

/// One component in a scan.
struct Part<'a> {
    dc_code: &'a HuffmanCode,
    ac_code: &'a AcCode,
    quantisation: &'a [u16; BLOCK_LEN],
    /// DC coefficient of the last block.
    prediction: i32,
    plane: Plane,
}

impl<'a> SequentialScan<'a> {
    fn new(segments: &'a Segments, frame: &Frame, scan: &Scan) -> Result<Self, JpegError> {
        let part = |component: &super::scan::ScanComponent| {
            let frame_component = &frame.components[component.index];
            Ok(Part {
                dc_code: segments.dc_code(component.dc_code)?,
                ac_code: segments.ac_code(component.ac_code)?,
                quantisation: segments.quantisation(frame_component.quantisation)?,
                prediction: 0,
                plane: Plane::new(frame_component),
            })
        };
        Ok(Self { parts: scan.components.iter().map(part).collect::<Result<_, JpegError>>()? })
    }
}

impl BlockDecoder for SequentialScan<'_> {
    #[inline(always)]
    fn block(&mut self, bits: &mut BitReader, part: usize, column: usize, row: usize) -> Result<(), JpegError> {
        let part = &mut self.parts[part];
        let coefficients = part.coefficients(bits)?;
        bits.check()?;
        part.plane.put(column, row, &coefficients.samples());
        Ok(())
    }

    fn restart(&mut self) {
        for part in &mut self.parts {
            part.prediction = 0;
        }
    }
}

impl Part<'_> {
    #[inline(always)]
    fn coefficients(&mut self, bits: &mut BitReader) -> Result<Coefficients, JpegError> {
        let size = u32::from(self.dc_code.take(bits)?);
        self.prediction = self.prediction.wrapping_add(bits.take_signed(size));
        let mut coefficients = Coefficients::new(self.prediction as i16, self.quantisation[0]);
        let mut at = 1;
        while at < BLOCK_LEN {
            bits.refill();
            let short = self.ac_code.peek_short(bits);
            let value = if short.length > 0 {
                bits.skip(u32::from(short.length));
                at += usize::from(short.zeros);
                short.value
            } else {
                let symbol = self.ac_code.code.take(bits)?;
                let size = u32::from(symbol & 15);
                at += usize::from(symbol >> 4);
                if size == 0 {
                    if symbol != 0xF0 {
                        break;
                    }
                    at += 1;
                    continue;
                }
                bits.take_signed(size) as i16
            };
            let quantisation =
                self.quantisation.get(at).ok_or(JpegError::Data("a block has more than 64 coefficients"))?;
            coefficients.set(at, value, *quantisation);
            at += 1;
        }
        Ok(coefficients)
    }
}
