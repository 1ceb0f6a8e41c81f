//! Scan headers, and the order of blocks in compressed data (T.81 A.2, B.2.3, E.1.4).

use super::JpegError;
use super::bits::BitReader;
use super::frame::Frame;

/// Maximum number of bits by which a progressive scan shifts coefficients.
const MAX_SHIFT: u8 = 13;

/// A scan header.
#[derive(Debug)]
pub(super) struct Scan {
    /// The components in the scan, in order.
    pub(super) components: Vec<ScanComponent>,
    /// Zigzag indices of the first and last coefficient in a progressive scan (spectral selection).
    pub(super) band: (usize, usize),
    /// Position of the lowest bit decoded before this scan (successive approximation); 0 in the first scan of a band.
    pub(super) high: u8,
    /// Position of the lowest bit decoded after this scan.
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
    /// Parses the parameters of a scan header. `ids` are the ids of the frame's components.
    pub(super) fn parse(parameters: &[u8], ids: &[u8]) -> Result<Self, JpegError> {
        let wrong = |reason| JpegError::Segment { marker: 0xDA, reason };
        let too_short = wrong("its length does not match the number of components");
        let Some((count, rest)) = parameters.split_first() else { return Err(too_short) };
        let Some((selections, [first, last, shifts])) = rest.split_last_chunk() else { return Err(too_short) };
        if *count == 0 || selections.len() != 2 * usize::from(*count) {
            return Err(too_short);
        }
        let mut components: Vec<ScanComponent> = Vec::new();
        for selection in selections.chunks_exact(2) {
            let fresh = |index: &usize| components.iter().all(|other| other.index != *index);
            let index = (0..ids.len()).filter(|index| ids[*index] == selection[0]).find(fresh);
            let index = index.ok_or(wrong("it names an unknown component, or one twice"))?;
            let (dc_code, ac_code) = (usize::from(selection[1] >> 4), usize::from(selection[1] & 15));
            if dc_code > 3 || ac_code > 3 {
                return Err(wrong("it uses a Huffman table index above 3"));
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
        Err(JpegError::Segment { marker: 0xDA, reason: "its parameters are invalid in a progressive file" })
    }
}

/// Decoder of the blocks of a scan.
pub(super) trait BlockDecoder {
    /// Reads the next block. `part` is the component's index in the scan; `column` and `row` count blocks.
    fn block(&mut self, bits: &mut BitReader, part: usize, column: usize, row: usize) -> Result<(), JpegError>;

    /// Resets the state carried from block to block.
    fn restart(&mut self);
}

/// The compressed data of a scan.
pub(super) struct ScanData<'a> {
    /// Reader at the first bit of the data.
    pub(super) bits: BitReader<'a>,
    /// Number of MCUs between two restart markers; 0 if there are none.
    pub(super) restart_interval: usize,
}

/// Reads the compressed data of `scan`. Returns the position after it.
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

/// Counts down to the next restart marker.
struct Restarts {
    interval: usize,
    units_left: usize,
    /// Number of the next marker, 0 to 7.
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
