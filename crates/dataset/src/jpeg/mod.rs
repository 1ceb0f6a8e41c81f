//! JPEG files as libjpeg and libjpeg-turbo decode them by default, to the last bit.
//!
//! The standard (ITU T.81) leaves open how the inverse transform rounds and how subsampled colour is scaled up, so
//! decoders differ by some grey levels, and networks trained on one decoder's pixels see others. Pillow, OpenCV and all
//! that is built on them use libjpeg-turbo; so its choices are taken here: the accurate integer transform ("islow"),
//! triangle-shaped ("fancy") upsampling and 16-bit fixed-point colours.
//!
//! Decoded are sequential and progressive Huffman-coded files with 8 bits and one or three components. Other kinds
//! are [`JpegError::Unsupported`]. Unlike libjpeg, damaged data is an error and never grey, and progressive files that
//! leave out their last refinements are not smoothed.

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

pub(crate) use error::JpegError;

use frame::Frame;
use scan::Scan;
use segments::Segments;
use splatseg_geometry::Image;

/// A JPEG file whose header has been read.
pub(crate) struct Jpeg<'a> {
    segments: Segments<'a>,
    frame: Frame,
    first_scan: Scan,
}

impl<'a> Jpeg<'a> {
    /// Reads everything before the first compressed data. Allocates nothing that depends on the stated size.
    pub(crate) fn read_header(bytes: &'a [u8]) -> Result<Self, JpegError> {
        let mut segments = Segments::new(bytes)?;
        let first_scan = segments.next_scan()?.ok_or(JpegError::NoScan)?;
        let frame = segments.take_frame().ok_or(JpegError::NoScan)?;
        Ok(Self { segments, frame, first_scan })
    }

    /// The `(width, height)` that the header states.
    pub(crate) fn size(&self) -> (u32, u32) {
        (self.frame.width as u32, self.frame.height as u32)
    }

    /// The pixels as sRGB, `[height, width]`. Takes memory and time in proportion to [`Jpeg::size`], which is to be
    /// checked before. Does everything in one thread.
    pub(crate) fn decode(mut self) -> Result<Image<[u8; 3]>, JpegError> {
        let model = self.segments.color_model(&self.frame);
        let planes = if self.frame.progressive {
            progressive::decode(&mut self.segments, &self.frame, self.first_scan)?
        } else {
            sequential::decode(&mut self.segments, &self.frame, self.first_scan)?
        };
        Ok(output::image(&self.frame, &planes, model))
    }
}
