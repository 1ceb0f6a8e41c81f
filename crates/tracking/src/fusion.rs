//! What is remembered and what is seen, together (METHOD, "FastSAM-Splat", step 4).

use crate::painting::painting_order;
use splatseg_geometry::{Mask, SegmentId};
use splatseg_memory::SegmentBelief;

/// The target of learning, F̂, and after decoding the frame's output.
///
/// - Predictions lie over remembered segments and have full confidence. Among overlapping predictions **smaller ones
///   lie over larger ones** (a cup over the table it stands on); of two equally large ones the later lies on top.
/// - Remembered segments keep their id where no prediction covers them and lose `confidence_decay` of the confidence
///   that the memory showed, not below zero. That also holds for the part of a *matched* segment that its prediction
///   leaves out: this frame did not confirm it either. (The paper does not say.)
///
/// `identified` are the predictions with their ids.
pub fn fuse(expected: &SegmentBelief, identified: &[(SegmentId, &Mask)], confidence_decay: f32) -> SegmentBelief {
    let mut fused = expected.clone();
    for (segment, confidence) in fused.segments.pixels().iter().zip(fused.confidence.pixels_mut()) {
        *confidence = if *segment == 0 { 0.0 } else { (*confidence - confidence_decay).max(0.0) };
    }
    for index in painting_order(identified.iter().map(|(_, mask)| *mask)) {
        let (segment, mask) = identified[index];
        for pixel in mask.pixel_indices() {
            fused.segments.pixels_mut()[pixel] = segment;
            fused.confidence.pixels_mut()[pixel] = 1.0;
        }
    }
    fused
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, SegmentMap};

    #[test]
    fn predictions_cover_memory_and_the_unseen_fades() {
        let expected = SegmentBelief {
            segments: SegmentMap::from_pixels(5, 1, vec![3, 3, 4, 4, 0]).unwrap(),
            confidence: Image::from_pixels(5, 1, vec![0.9, 0.9, 0.55, 0.05, 0.3]).unwrap(),
        };
        let large = Mask::from_fn(5, 1, |column, _| column < 2);
        let small = Mask::from_fn(5, 1, |column, _| column == 1);
        let fused = fuse(&expected, &[(7, &small), (3, &large)], 0.1);
        assert_eq!(fused.segments.pixels(), [3, 7, 4, 4, 0]);
        let expected_confidence = [1.0, 1.0, 0.45, 0.0, 0.0];
        for (found, expected) in fused.confidence.pixels().iter().zip(expected_confidence) {
            assert!((found - expected).abs() < 1e-6);
        }
        assert_eq!(fused.decoded(0.5).pixels(), [3, 7, 0, 0, 0]);
    }
}
