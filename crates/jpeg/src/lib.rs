//! A JPEG decoder with output bit-identical to that of libjpeg and libjpeg-turbo with their default settings, and a fast
//! encoder ([`encode`]).
//!
//! The standard (ITU T.81) does not specify the rounding of the inverse transform or the upsampling of chroma. So
//! decoders differ by a few levels, and a network may receive different pixels than in training. Pillow, OpenCV and
//! everything built on them use libjpeg-turbo. This crate makes the same choices: the accurate integer transform
//! ("islow"), triangle-filter ("fancy") upsampling and 16-bit fixed-point colour conversion.
//!
//! Supports sequential and progressive Huffman-coded files with 8 bits per sample and one or three components. Others
//! give [`JpegError::Unsupported`]. Unlike libjpeg, damaged data is an error instead of grey pixels, and progressive
//! files without their last refinement scans are not smoothed.
//!
//! ```no_run
//! let bytes = std::fs::read("frame.jpg")?;
//! let jpeg = splatseg_jpeg::Jpeg::read_header(&bytes)?;
//! let (width, height) = jpeg.size(); // for an untrusted file, check these before decoding
//! let rgb: Vec<[u8; 3]> = jpeg.decode()?;
//! assert_eq!(rgb.len(), width as usize * height as usize);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod bits;
mod color;
mod encoder;
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

pub use encoder::{EncodeError, encode};
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
    /// Reads everything before the first compressed data. Allocations do not depend on the image size in the header.
    ///
    /// # Errors
    /// If the header is damaged or the kind of file is not supported.
    pub fn read_header(bytes: &'a [u8]) -> Result<Self, JpegError> {
        let mut segments = Segments::new(bytes)?;
        let first_scan = segments.next_scan()?.ok_or(JpegError::NoScan)?;
        let frame = segments.take_frame().ok_or(JpegError::NoScan)?;
        Ok(Self { segments, frame, first_scan })
    }

    /// The `(width, height)` from the header.
    pub fn size(&self) -> (u32, u32) {
        (self.frame.width as u32, self.frame.height as u32)
    }

    /// Decodes the image to `width * height` RGB pixels, row-major. Grey images give three equal channels. Memory and
    /// time are proportional to [`Jpeg::size`], which the caller should check first. Runs on the calling thread.
    ///
    /// # Errors
    /// If the compressed data is damaged or not supported. No part of a damaged image is returned.
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
