//! The segments between compressed data: tables and headers (T.81 annex B).

use super::JpegError;
use super::bits::BitReader;
use super::color::ColorModel;
use super::frame::{BLOCK_LEN, Frame};
use super::huffman::{AcCode, HuffmanCode};
use super::scan::{Scan, ScanData};

/// Marker of the start of the image.
const SOI: u8 = 0xD8;
/// Maximum size of a DC difference, bits.
const MAX_DC_SIZE: u8 = 15;

/// Reads a file's segments and keeps the current tables.
pub(super) struct Segments<'a> {
    bytes: &'a [u8],
    position: usize,
    /// Quantisation tables in zigzag order.
    quantisation: [Option<[u16; BLOCK_LEN]>; 4],
    dc_codes: [Option<HuffmanCode>; 4],
    ac_codes: [Option<AcCode>; 4],
    restart_interval: usize,
    /// The frame header, until [`take_frame`](Self::take_frame).
    frame: Option<Frame>,
    /// Ids of the frame's components.
    component_ids: Option<Vec<u8>>,
    /// True if the file has a JFIF segment.
    jfif: bool,
    /// Colour transform from an Adobe segment.
    adobe_transform: Option<u8>,
}

impl<'a> Segments<'a> {
    /// Starts after the marker of the start of the image, which must be present.
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, JpegError> {
        if !bytes.starts_with(&[0xFF, SOI]) {
            return Err(JpegError::Segment { marker: SOI, reason: "it is not at the start" });
        }
        Ok(Self {
            bytes,
            position: 2,
            quantisation: [None; 4],
            dc_codes: [const { None }; 4],
            ac_codes: [const { None }; 4],
            restart_interval: 0,
            frame: None,
            component_ids: None,
            jfif: false,
            adobe_transform: None,
        })
    }

    /// Returns the compressed data of the scan whose header was read last.
    pub(super) fn scan_data(&self) -> ScanData<'a> {
        ScanData { bits: BitReader::new(self.bytes, self.position), restart_interval: self.restart_interval }
    }

    /// Continues after compressed data.
    pub(super) fn set_position(&mut self, position: usize) {
        self.position = position;
    }

    /// Returns the quantisation table `index`, in zigzag order.
    pub(super) fn quantisation(&self, index: usize) -> Result<&[u16; BLOCK_LEN], JpegError> {
        self.quantisation[index].as_ref().ok_or(JpegError::NoQuantisation(index))
    }

    /// Returns the code `index` for DC coefficients.
    pub(super) fn dc_code(&self, index: usize) -> Result<&HuffmanCode, JpegError> {
        // Motion JPEG frames omit the standard's example tables.
        self.dc_codes[index].as_ref().ok_or(JpegError::Unsupported("JPEG without Huffman tables"))
    }

    /// Returns the code `index` for AC coefficients.
    pub(super) fn ac_code(&self, index: usize) -> Result<&AcCode, JpegError> {
        self.ac_codes[index].as_ref().ok_or(JpegError::Unsupported("JPEG without Huffman tables"))
    }

    /// Takes the frame header.
    pub(super) fn take_frame(&mut self) -> Option<Frame> {
        self.frame.take()
    }

    /// Determines the colour space. If the file does not specify it, guesses as libjpeg does.
    pub(super) fn color_model(&self, frame: &Frame) -> ColorModel {
        let ids: Vec<u8> = frame.components.iter().map(|component| component.id).collect();
        match ids[..] {
            [_] => ColorModel::Grey,
            _ if self.jfif => ColorModel::YCbCr,
            _ if self.adobe_transform == Some(0) => ColorModel::Rgb,
            [b'R', b'G', b'B'] if self.adobe_transform.is_none() => ColorModel::Rgb,
            _ => ColorModel::YCbCr,
        }
    }

    /// Reads up to the next compressed data. Returns `None` at the end of the image.
    pub(super) fn next_scan(&mut self) -> Result<Option<Scan>, JpegError> {
        loop {
            let marker = self.next_marker()?;
            match marker {
                0x01 | 0xD0..=0xD7 => continue, // Markers without parameters.
                0xD9 => return Ok(None),
                SOI => return Err(JpegError::Segment { marker, reason: "it occurs twice" }),
                _ => {}
            }
            let parameters = self.parameters(marker)?;
            match marker {
                0xC4 => self.define_codes(parameters)?,
                0xDB => self.define_quantisation(parameters)?,
                0xDD => self.define_restarts(parameters)?,
                0xC0..=0xC2 => self.define_frame(marker, parameters)?,
                0xC3 | 0xC5..=0xCF => {
                    return Err(JpegError::Unsupported("lossless, hierarchical or arithmetic-coded JPEG"));
                }
                0xE0 if parameters.len() >= 14 && parameters.starts_with(b"JFIF\0") => self.jfif = true,
                0xEE if parameters.len() >= 12 && parameters.starts_with(b"Adobe") => {
                    self.adobe_transform = Some(parameters[11]);
                }
                0xDA => {
                    let ids = self.component_ids.as_ref().ok_or(JpegError::NoScan)?;
                    return Scan::parse(parameters, ids).map(Some);
                }
                _ => {}
            }
        }
    }

    /// Returns the second byte of the next marker. Skips stray bytes before it, as libjpeg does.
    fn next_marker(&mut self) -> Result<u8, JpegError> {
        let mut after_ff = false;
        for byte in self.bytes.get(self.position..).unwrap_or_default() {
            self.position += 1;
            if after_ff && !matches!(byte, 0 | 0xFF) {
                return Ok(*byte);
            }
            after_ff = *byte == 0xFF;
        }
        Err(JpegError::Ended)
    }

    /// Reads the bytes of a segment after its length.
    fn parameters(&mut self, marker: u8) -> Result<&'a [u8], JpegError> {
        let rest = &self.bytes[self.position..];
        let length = usize::from(u16::from_be_bytes(*rest.first_chunk().ok_or(JpegError::Ended)?));
        if length < 2 {
            return Err(JpegError::Segment { marker, reason: "its length is less than 2" });
        }
        self.position += length;
        rest.get(2..length).ok_or(JpegError::Ended)
    }

    fn define_frame(&mut self, marker: u8, parameters: &[u8]) -> Result<(), JpegError> {
        if self.component_ids.is_some() {
            return Err(JpegError::Segment { marker, reason: "there is a second frame" });
        }
        let frame = Frame::parse(marker, parameters)?;
        self.component_ids = Some(frame.components.iter().map(|component| component.id).collect());
        self.frame = Some(frame);
        Ok(())
    }

    fn define_restarts(&mut self, parameters: &[u8]) -> Result<(), JpegError> {
        let [high, low] = parameters else {
            return Err(JpegError::Segment { marker: 0xDD, reason: "it does not consist of one number" });
        };
        self.restart_interval = usize::from(u16::from_be_bytes([*high, *low]));
        Ok(())
    }

    fn define_quantisation(&mut self, mut parameters: &[u8]) -> Result<(), JpegError> {
        let wrong = JpegError::Segment { marker: 0xDB, reason: "its quantisation tables are malformed" };
        while let Some((kind, rest)) = parameters.split_first() {
            let bytes_each = match kind >> 4 {
                0 => 1,
                1 => 2,
                _ => return Err(wrong),
            };
            let Some(values) = rest.get(..bytes_each * BLOCK_LEN) else { return Err(wrong) };
            let Some(table) = self.quantisation.get_mut(usize::from(kind & 15)) else { return Err(wrong) };
            let mut numbers =
                values.chunks(bytes_each).map(|bytes| bytes.iter().fold(0, |n, b| n << 8 | u16::from(*b)));
            *table = Some(std::array::from_fn(|_| numbers.next().unwrap_or(0)));
            parameters = &rest[values.len()..];
        }
        Ok(())
    }

    fn define_codes(&mut self, mut parameters: &[u8]) -> Result<(), JpegError> {
        let wrong = || JpegError::Segment { marker: 0xC4, reason: "its Huffman tables are malformed" };
        while let Some((kind, rest)) = parameters.split_first() {
            let (counts, rest) = rest.split_first_chunk::<16>().ok_or_else(wrong)?;
            let count = counts.iter().map(|count| usize::from(*count)).sum();
            let symbols = rest.get(..count).ok_or_else(wrong)?;
            let code = HuffmanCode::new(counts, symbols).ok_or_else(wrong)?;
            match (kind >> 4, usize::from(kind & 15)) {
                (0, index @ 0..4) if code.is_within(MAX_DC_SIZE) => self.dc_codes[index] = Some(code),
                (1, index @ 0..4) => self.ac_codes[index] = Some(AcCode::new(code)),
                _ => return Err(wrong()),
            }
            parameters = &rest[count..];
        }
        Ok(())
    }
}
