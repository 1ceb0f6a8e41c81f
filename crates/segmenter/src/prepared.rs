//! Masks that were made before they are asked for.

use crate::{Segmenter, SegmenterError};
use splatseg_geometry::{RgbdFrame, ScoredMask};
use std::sync::{Arc, Mutex, PoisonError};

/// A segmenter that hands out what it was given: so whoever runs a method can segment a frame while the method is still
/// at the one before. Clones share the masks.
#[derive(Clone, Debug, Default)]
pub struct PreparedMasks(Arc<Mutex<Option<Prepared>>>);

#[derive(Debug)]
struct Prepared {
    frame: String,
    masks: Result<Vec<ScoredMask>, SegmenterError>,
}

impl PreparedMasks {
    /// Gives the masks of the next frame, or why there are none; they replace masks that were not asked for.
    pub fn put(&self, frame: &RgbdFrame, masks: Result<Vec<ScoredMask>, SegmenterError>) {
        let prepared = Prepared { frame: frame.name().to_owned(), masks };
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(prepared);
    }
}

impl Segmenter for PreparedMasks {
    fn name(&self) -> &str {
        "prepared"
    }

    /// # Errors
    /// What was given; [`SegmenterError::NotPrepared`] if it was for another frame, or there is nothing.
    fn segment(&mut self, frame: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
        let prepared = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        match prepared {
            Some(prepared) if prepared.frame == frame.name() => prepared.masks,
            _ => Err(SegmenterError::NotPrepared { frame: frame.name().to_owned() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::{Image, Intrinsics, Mask, Pose};

    fn frame(name: &str) -> RgbdFrame<'static> {
        let camera = Intrinsics { fx: 2.0, fy: 2.0, cx: 0.5, cy: 0.5, width: 2, height: 2 };
        RgbdFrame::new(name, Image::filled(2, 2, [0; 3]), Image::filled(2, 2, 1.0), camera, Pose::IDENTITY).unwrap()
    }

    #[test]
    fn masks_are_handed_out_once_and_for_their_frame() {
        let prepared = PreparedMasks::default();
        let mut segmenter = prepared.clone();
        let masks = vec![ScoredMask { mask: Mask::empty(2, 2), score: 0.5 }];
        prepared.put(&frame("a"), Ok(masks.clone()));
        assert_eq!(segmenter.segment(&frame("a")).unwrap(), masks);
        assert!(matches!(segmenter.segment(&frame("a")), Err(SegmenterError::NotPrepared { .. })));
        prepared.put(&frame("a"), Ok(masks));
        assert_eq!(segmenter.segment(&frame("b")).unwrap_err().to_string(), "no masks were prepared for frame b");
    }
}
