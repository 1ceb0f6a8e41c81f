//! Scan headers, and the order of blocks in compressed data (T.81 A.2, B.2.3, E.1.4).

use super::JpegError;
use super::bits::BitReader;
use super::frame::Frame;

/// The highest power of two by which a progressive scan divides coefficients.
const MAX_SHIFT: u8 = 13;

/// What a scan header says.
#[derive(Debug)]
pub(super) struct Scan {
    /// Which components' blocks follow, in this order.
    pub(super) components: Vec<ScanComponent>,
    /// First and last coefficient, in the file's order, that a progressive scan is about.
    pub(super) band: (usize, usize),
    /// The bit that was the lowest one before this scan, plus 1; 0 in the first scan of these coefficients.
    pub(super) high: u8,
    /// The lowest bit that is known after this scan.
    pub(super) low: u8,
}

/// One component of a scan.
#[derive(Debug)]
pub(super) struct ScanComponent {
    /// Index in the frame.
    pub(super) index: usize,
    pub(super) dc_code: usize,
    pub(super) ac_code: usize,
}

impl Scan {
    /// Reads the parameters of a scan header; `ids` are those of the frame's components.
    pub(super) fn parse(parameters: &[u8], ids: &[u8]) -> Result<Self, JpegError> {
        let wrong = |reason| JpegError::Segment { marker: 0xDA, reason };
        let too_short = wrong("its length does not fit the number of components");
        let Some((count, rest)) = parameters.split_first() else { return Err(too_short) };
        let Some((selections, [first, last, shifts])) = rest.split_last_chunk() else { return Err(too_short) };
        if *count == 0 || selections.len() != 2 * usize::from(*count) {
            return Err(too_short);
        }
        let mut components: Vec<ScanComponent> = Vec::new();
        for selection in selections.chunks_exact(2) {
            let fresh = |index: &usize| components.iter().all(|other| other.index != *index);
            let index = (0..ids.len()).filter(|index| ids[*index] == selection[0]).find(fresh);
            let index = index.ok_or(wrong("it names a component that is not there, or twice"))?;
            let (dc_code, ac_code) = (usize::from(selection[1] >> 4), usize::from(selection[1] & 15));
            if dc_code > 3 || ac_code > 3 {
                return Err(wrong("it names a Huffman table that cannot be"));
            }
            components.push(ScanComponent { index, dc_code, ac_code });
        }
        let band = (usize::from(*first), usize::from(*last));
        Ok(Self { components, band, high: shifts >> 4, low: shifts & 15 })
    }

    /// Checks that the scan is valid in a progressive file (T.81 G.1.1.1).
    pub(super) fn check_progressive(&self) -> Result<(), JpegError> {
        let (first, last) = self.band;
        let valid_band = match first {
            0 => last == 0,
            _ => first <= last && last < 64 && self.components.len() == 1,
        };
        let valid_shift = self.low <= MAX_SHIFT && (self.high == 0 || self.high == self.low + 1);
        if valid_band && valid_shift {
            return Ok(());
        }
        Err(JpegError::Segment { marker: 0xDA, reason: "it is not one of a progressive file" })
    }
}

/// What is done with the blocks of a scan.
pub(super) trait BlockDecoder {
    /// Reads the next block: that of the scan's component `part`, in this column and row of blocks.
    fn block(&mut self, bits: &mut BitReader, part: usize, column: usize, row: usize) -> Result<(), JpegError>;

    /// Forgets what was carried from one block to the next.
    fn restart(&mut self);
}

/// The compressed data of a scan.
pub(super) struct ScanData<'a> {
    /// At the data's first bit.
    pub(super) bits: BitReader<'a>,
    /// Units between two restart markers; 0 without.
    pub(super) restart_interval: usize,
}

/// Reads the compressed data of `scan`. Returns the position behind it.
pub(super) fn read_blocks(
    data: ScanData,
    frame: &Frame,
    scan: &Scan,
    decoder: &mut impl BlockDecoder,
) -> Result<usize, JpegError> {
    let ScanData { mut bits, restart_interval } = data;
    let mut restarts = Restarts { interval: restart_interval, units_left: restart_interval, next: 0 };
    if let [only] = &scan.components[..] {
        let (columns, rows) = frame.components[only.index].blocks;
        for row in 0..rows {
            for column in 0..columns {
                restarts.before_unit(&mut bits, decoder)?;
                decoder.block(&mut bits, 0, column, row)?;
            }
        }
        return Ok(bits.position());
    }
    let (columns, rows) = frame.units();
    for row in 0..rows {
        for column in 0..columns {
            restarts.before_unit(&mut bits, decoder)?;
            for (part, component) in scan.components.iter().enumerate() {
                let (across, down) = frame.components[component.index].sampling;
                for y in 0..down {
                    for x in 0..across {
                        decoder.block(&mut bits, part, column * across + x, row * down + y)?;
                    }
                }
            }
        }
    }
    Ok(bits.position())
}

/// When restart markers are due.
struct Restarts {
    interval: usize,
    units_left: usize,
    /// The next marker's number.
    next: u8,
}

impl Restarts {
    #[inline(always)]
    fn before_unit(&mut self, bits: &mut BitReader, decoder: &mut impl BlockDecoder) -> Result<(), JpegError> {
        if self.interval == 0 {
            return Ok(());
        }
        if self.units_left == 0 {
            bits.restart(self.next)?;
            decoder.restart();
            self.next = (self.next + 1) % 8;
            self.units_left = self.interval;
        }
        self.units_left -= 1;
        Ok(())
    }
}
