//! A JPEG decoder whose pixels are those of libjpeg and libjpeg-turbo with their default settings, to the last bit.
//!
//! The standard (ITU T.81) does not fix how the inverse transform rounds or how subsampled colour is upsampled, so
//! decoders differ by a few levels, and a network trained on one decoder's pixels sees others. Pillow, OpenCV and
//! everything built on them use libjpeg-turbo. This crate makes the same choices: the accurate integer transform
//! ("islow"), triangle-filter ("fancy") upsampling and 16-bit fixed-point colour conversion.
//!
//! Sequential and progressive Huffman-coded files with 8 bits per sample and one or three components are decoded. Other
//! kinds are [`JpegError::Unsupported`]. Unlike libjpeg, damaged data is an error and never grey, and progressive files
//! that leave out their last refinements are not smoothed.
//!
//! ```no_run
//! let bytes = std::fs::read("frame.jpg")?;
//! let jpeg = splatseg_jpeg::Jpeg::read_header(&bytes)?;
//! let (width, height) = jpeg.size(); // of an unknown file: check these before memory is allocated for them
//! let rgb: Vec<[u8; 3]> = jpeg.decode()?;
//! assert_eq!(rgb.len(), width as usize * height as usize);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bits;
mod color;
mod error;
mod frame;
mod huffman;
mod idct;
mod output;
mod progressive;
mod scan;
mod segments;
mod sequential;
mod upsample;

pub use error::JpegError;

use frame::Frame;
use scan::Scan;
use segments::Segments;

/// A JPEG file whose header has been read.
pub struct Jpeg<'a> {
    segments: Segments<'a>,
    frame: Frame,
    first_scan: Scan,
}

impl<'a> Jpeg<'a> {
    /// Reads everything before the first compressed data. Allocates nothing that depends on the stated size.
    ///
    /// # Errors
    /// [`JpegError`] says what is wrong with the header, or that files of this kind are not decoded.
    pub fn read_header(bytes: &'a [u8]) -> Result<Self, JpegError> {
        let mut segments = Segments::new(bytes)?;
        let first_scan = segments.next_scan()?.ok_or(JpegError::NoScan)?;
        let frame = segments.take_frame().ok_or(JpegError::NoScan)?;
        Ok(Self { segments, frame, first_scan })
    }

    /// The `(width, height)` that the header states.
    pub fn size(&self) -> (u32, u32) {
        (self.frame.width as u32, self.frame.height as u32)
    }

    /// The pixels as RGB, row-major, `width * height` of them; grey images have three equal channels. Takes memory and
    /// time in proportion to [`Jpeg::size`], which the caller should check first. Works on the calling thread.
    ///
    /// # Errors
    /// [`JpegError`] says what is wrong with the compressed data. No part of a damaged image is returned.
    pub fn decode(mut self) -> Result<Vec<[u8; 3]>, JpegError> {
        let model = self.segments.color_model(&self.frame);
        let planes = if self.frame.progressive {
            progressive::decode(&mut self.segments, &self.frame, self.first_scan)?
        } else {
            sequential::decode(&mut self.segments, &self.frame, self.first_scan)?
        };
        Ok(output::pixels(&self.frame, &planes, model))
    }
}
