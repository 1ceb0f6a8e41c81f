//! The image's size, its components and their blocks (T.81 A.1, A.2).

use super::JpegError;

/// Side of a block in samples.
pub(super) const BLOCK: usize = 8;

/// Number of samples, or of coefficients, in a block.
pub(super) const BLOCK_LEN: usize = BLOCK * BLOCK;

/// Row-major index of each coefficient in zigzag order, the order in the file (T.81 figure A.6).
#[rustfmt::skip]
pub(super) const ZIGZAG: [u8; BLOCK_LEN] = [
     0,  1,  8, 16,  9,  2,  3, 10, 17, 24, 32, 25, 18, 11,  4,  5,
    12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13,  6,  7, 14, 21, 28,
    35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51,
    58, 59, 52, 45, 38, 31, 39, 46, 53, 60, 61, 54, 47, 55, 62, 63,
];

/// A frame header.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) progressive: bool,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) components: Vec<Component>,
    /// Maximum horizontal and vertical sampling factors of the components.
    pub(super) max_sampling: (usize, usize),
}

/// A component of the image: luma, chroma or a primary colour.
#[derive(Debug)]
pub(super) struct Component {
    pub(super) id: u8,
    /// Horizontal and vertical sampling factors, 1 to 4.
    pub(super) sampling: (usize, usize),
    /// Index of the quantisation table.
    pub(super) quantisation: usize,
    /// Width and height in samples.
    pub(super) size: (usize, usize),
    /// Columns and rows of blocks that contain samples of the image.
    pub(super) blocks: (usize, usize),
    /// Columns and rows of blocks including the padding that completes the last MCUs of an interleaved scan.
    pub(super) padded_blocks: (usize, usize),
}

impl Frame {
    /// Parses the parameters of a frame header (T.81 B.2.2). `marker` is the second byte of its marker.
    pub(super) fn parse(marker: u8, parameters: &[u8]) -> Result<Self, JpegError> {
        let wrong = |reason| JpegError::Segment { marker, reason };
        let Some(([precision, y1, y0, x1, x0, count], specifications)) = parameters.split_first_chunk() else {
            return Err(wrong("it is too short"));
        };
        if *precision != 8 {
            return Err(JpegError::Unsupported("JPEG with other than 8 bits per sample"));
        }
        let height = usize::from(u16::from_be_bytes([*y1, *y0]));
        let width = usize::from(u16::from_be_bytes([*x1, *x0]));
        if height == 0 {
            return Err(JpegError::Unsupported("JPEG with its height after the first scan"));
        }
        if width == 0 {
            return Err(wrong("the width is 0"));
        }
        if !matches!(count, 1 | 3) {
            return Err(JpegError::Unsupported("JPEG with other than 1 or 3 components"));
        }
        if specifications.len() != 3 * usize::from(*count) {
            return Err(wrong("its length does not match the number of components"));
        }
        let mut components = Vec::new();
        for specification in specifications.chunks_exact(3) {
            components.push(Component::parse(specification).ok_or(wrong("a component has invalid parameters"))?);
        }
        let largest = |factor: fn(&Component) -> usize| components.iter().map(factor).max().unwrap_or(1);
        let max_sampling = (largest(|component| component.sampling.0), largest(|component| component.sampling.1));
        for component in &mut components {
            component.lay_out((width, height), max_sampling)?;
        }
        Ok(Self { progressive: marker == 0xC2, width, height, components, max_sampling })
    }

    /// Columns and rows of minimum coded units (MCUs) in an interleaved scan.
    pub(super) fn units(&self) -> (usize, usize) {
        (self.width.div_ceil(BLOCK * self.max_sampling.0), self.height.div_ceil(BLOCK * self.max_sampling.1))
    }
}

impl Component {
    fn parse(specification: &[u8]) -> Option<Self> {
        let [id, sampling, quantisation] = *specification else { return None };
        let sampling = (usize::from(sampling >> 4), usize::from(sampling & 15));
        let valid = (1..=4).contains(&sampling.0) && (1..=4).contains(&sampling.1) && quantisation < 4;
        valid.then_some(Self {
            id,
            sampling,
            quantisation: usize::from(quantisation),
            size: (0, 0),
            blocks: (0, 0),
            padded_blocks: (0, 0),
        })
    }

    fn lay_out(&mut self, image: (usize, usize), max: (usize, usize)) -> Result<(), JpegError> {
        if !max.0.is_multiple_of(self.sampling.0) || !max.1.is_multiple_of(self.sampling.1) {
            return Err(JpegError::Unsupported("JPEG with fractional sampling"));
        }
        let ratio = (max.0 / self.sampling.0, max.1 / self.sampling.1);
        self.size = (image.0.div_ceil(ratio.0), image.1.div_ceil(ratio.1));
        self.blocks = (self.size.0.div_ceil(BLOCK), self.size.1.div_ceil(BLOCK));
        self.padded_blocks =
            (image.0.div_ceil(BLOCK * max.0) * self.sampling.0, image.1.div_ceil(BLOCK * max.1) * self.sampling.1);
        Ok(())
    }
}

/// The decoded samples of a component, in whole blocks.
pub(super) struct Plane {
    pub(super) samples: Vec<u8>,
    /// Number of samples from one row to the next.
    pub(super) stride: usize,
}

impl Plane {
    /// Allocates all blocks of `component`, including padding.
    pub(super) fn new(component: &Component) -> Self {
        let (columns, rows) = component.padded_blocks;
        Self { samples: vec![0; columns * rows * BLOCK_LEN], stride: columns * BLOCK }
    }

    /// Returns the first `width` samples of a row.
    pub(super) fn row(&self, row: usize, width: usize) -> &[u8] {
        &self.samples[row * self.stride..][..width]
    }

    /// Stores a block at a column and row of blocks.
    #[inline(always)]
    pub(super) fn put(&mut self, column: usize, row: usize, block: &[u8; BLOCK_LEN]) {
        let start = row * BLOCK * self.stride + column * BLOCK;
        let rows = self.samples[start..].chunks_mut(self.stride);
        for (target, samples) in rows.zip(block.chunks_exact(BLOCK)) {
            target[..BLOCK].copy_from_slice(samples);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_sizes() {
        let header = [8, 0, 17, 0, 35, 3, 1, 0x22, 0, 2, 0x11, 1, 3, 0x21, 1];
        let frame = Frame::parse(0xC0, &header).unwrap();
        assert_eq!((frame.width, frame.height, frame.units()), (35, 17, (3, 2)));
        let found: Vec<_> = frame.components.iter().map(|part| (part.size, part.blocks, part.padded_blocks)).collect();
        assert_eq!(found, [((35, 17), (5, 3), (6, 4)), ((18, 9), (3, 2), (3, 2)), ((35, 9), (5, 2), (6, 2))]);
    }

    #[test]
    fn refused_headers() {
        let parse = |header: &[u8]| Frame::parse(0xC0, header).unwrap_err();
        for unsupported in [
            &[12, 0, 1, 0, 1, 1, 1, 0x11, 0][..],
            &[8, 0, 0, 0, 1, 1, 1, 0x11, 0],
            &[8, 0, 1, 0, 1, 4, 1, 0x11, 0],
            &[8, 0, 9, 0, 9, 3, 1, 0x31, 0, 2, 0x21, 0, 3, 0x11, 0],
        ] {
            assert!(matches!(parse(unsupported), JpegError::Unsupported(_)));
        }
        for wrong in [
            &[8, 0, 1, 0][..],
            &[8, 0, 1, 0, 0, 1, 1, 0x11, 0],
            &[8, 0, 1, 0, 1, 1, 1, 0x11],
            &[8, 0, 1, 0, 1, 1, 1, 0x51, 0],
            &[8, 0, 1, 0, 1, 1, 1, 0x10, 0],
            &[8, 0, 1, 0, 1, 1, 1, 0x11, 4],
        ] {
            assert!(matches!(parse(wrong), JpegError::Segment { marker: 0xC0, .. }));
        }
    }
}
