//! A method's result for one frame.

use crate::TrackErrorCounts;
use splatseg_geometry::{Image, Mask, SegmentId, SegmentMap};
use splatseg_memory::{FrameUpdate, SegmentBelief};
use std::collections::BTreeMap;

/// A method's result for one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameOutput {
    /// Lasting id of each pixel, `[height, width]`; 0 where there is no segment.
    pub segments: SegmentMap,
    /// Confidence of each pixel's id, `[height, width]`, 0 to 1; 0 where there is no segment. The memory's confidence
    /// where it expected that id, otherwise the score of the mask that shows it; 1 for masks of a tracker.
    pub confidence: Image<f32>,
    /// Whole mask of each segment, each id once, for methods whose masks may overlap. `segments` shows them painted,
    /// smaller ones over larger ones; metrics use the whole masks. Empty for methods with one id per pixel.
    pub masks: Vec<(SegmentId, Mask)>,
    /// Number of predicted segments that were large enough to count.
    pub predictions: usize,
    /// Errors of the tracker that were found and corrected; all 0 for methods that do not look for errors.
    pub track_errors: TrackErrorCounts,
    /// Changes of the memory in this frame.
    pub update: FrameUpdate,
}

impl FrameOutput {
    /// Creates a result with one id per pixel and confidence 1, for methods defined outside this crate.
    pub fn from_segments(segments: SegmentMap) -> Self {
        let confidence = segments.map(|id| if *id == 0 { 0.0 } else { 1.0 });
        Self {
            segments,
            confidence,
            masks: Vec::new(),
            predictions: 0,
            track_errors: TrackErrorCounts::default(),
            update: FrameUpdate::default(),
        }
    }

    /// Returns the mean confidence of each segment over the pixels that show it.
    pub fn segment_confidences(&self) -> BTreeMap<SegmentId, f32> {
        let mut sums: BTreeMap<SegmentId, (f64, u32)> = BTreeMap::new();
        for (id, confidence) in self.segments.pixels().iter().zip(self.confidence.pixels()).filter(|(id, _)| **id != 0)
        {
            let (sum, pixels) = sums.entry(*id).or_default();
            *sum += f64::from(*confidence);
            *pixels += 1;
        }
        sums.into_iter().map(|(id, (sum, pixels))| (id, (sum / f64::from(pixels)) as f32)).collect()
    }
}

/// Returns the confidence of each pixel of `segments`: the memory's where it expected this id, otherwise the score of
/// the id's mask in this frame.
pub(super) fn confidence(
    segments: &SegmentMap,
    scores: &BTreeMap<SegmentId, f32>,
    expected: Option<&SegmentBelief>,
) -> Image<f32> {
    let (width, height) = segments.size();
    let mut confidence = Image::filled(width, height, 0.0);
    let mut last_score = (0, 0.0);
    for (index, (confidence, id)) in confidence.pixels_mut().iter_mut().zip(segments.pixels()).enumerate() {
        if *id == 0 {
            continue;
        }
        let remembered = expected.filter(|expected| expected.segments.pixels()[index] == *id);
        if last_score.0 != *id {
            last_score = (*id, scores.get(id).copied().unwrap_or(0.0));
        }
        let found = remembered.map_or(last_score.1, |expected| expected.confidence.pixels()[index]);
        *confidence = found.clamp(0.0, 1.0);
    }
    confidence
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_segment_is_as_sure_as_its_pixels_on_average() {
        let segments = SegmentMap::from_pixels(4, 1, vec![2, 2, 0, 7]).unwrap();
        let confidence = Image::from_pixels(4, 1, vec![0.5, 1.0, 0.0, 0.25]).unwrap();
        let output = FrameOutput { confidence, ..FrameOutput::from_segments(segments) };
        assert_eq!(output.segment_confidences(), BTreeMap::from([(2, 0.75), (7, 0.25)]));
    }

    #[test]
    fn confidence_comes_from_the_memory_where_it_expected_the_id_and_from_the_score_elsewhere() {
        let map = |ids: [u32; 5]| SegmentMap::from_pixels(5, 1, ids.to_vec()).unwrap();
        let expected = SegmentBelief {
            segments: map([1, 1, 2, 2, 2]),
            confidence: Image::from_pixels(5, 1, vec![0.25, 1.5, 0.5, 0.5, 0.5]).unwrap(),
        };
        let scores = BTreeMap::from([(1, 0.875), (3, 0.75)]);
        let found = confidence(&map([1, 1, 1, 3, 0]), &scores, Some(&expected));
        assert_eq!(found.pixels(), [0.25, 1.0, 0.875, 0.75, 0.0]);
        assert_eq!(confidence(&map([1, 1, 1, 4, 0]), &scores, None).pixels(), [0.875, 0.875, 0.875, 0.0, 0.0]);
    }
}
