//! Segments of one image, with confidences.

use splatseg_geometry::{Image, SegmentMap};

/// A segment and a confidence for every pixel: the compact form of a feature map. The feature of a pixel is the
/// codebook vector of the segment (its direction) times the confidence (its magnitude).
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentBelief {
    /// Segment id per pixel, `[height, width]`; 0 for none.
    pub segments: SegmentMap,
    /// Confidence per pixel, `[height, width]`; a fresh observation has 1.
    pub confidence: Image<f32>,
}

impl SegmentBelief {
    /// No segment at any pixel.
    pub fn empty(width: usize, height: usize) -> Self {
        Self { segments: SegmentMap::filled(width, height, 0), confidence: Image::filled(width, height, 0.0) }
    }

    /// The belief at all pixels of an image of `size` (width, height), of which this one has every second row and column.
    #[must_use]
    pub fn doubled(&self, size: (usize, usize)) -> Self {
        Self { segments: self.segments.doubled(size), confidence: self.confidence.doubled(size) }
    }

    /// Returns the segments whose confidence exceeds `threshold`: the decoded feature map.
    pub fn decoded(&self, threshold: f32) -> SegmentMap {
        let mut segments = self.segments.clone();
        for (segment, confidence) in segments.pixels_mut().iter_mut().zip(self.confidence.pixels()) {
            if *confidence <= threshold {
                *segment = 0;
            }
        }
        segments
    }
}
