//! What is believed about the segments of one image.

use splatseg_geometry::{Image, SegmentMap};

/// A segment and a confidence for every pixel: the compact form of a feature map, whose feature at a pixel is the
/// codebook vector of the segment (its direction) times the confidence (its magnitude).
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentBelief {
    /// Segment id per pixel, `[height, width]`; 0 where there is none.
    pub segments: SegmentMap,
    /// Confidence per pixel, `[height, width]`; 1 is what a fresh observation has.
    pub confidence: Image<f32>,
}

impl SegmentBelief {
    /// A belief in nothing.
    pub fn empty(width: usize, height: usize) -> Self {
        Self { segments: SegmentMap::filled(width, height, 0), confidence: Image::filled(width, height, 0.0) }
    }

    /// The segments whose confidence exceeds `threshold`: the decoded feature map.
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
