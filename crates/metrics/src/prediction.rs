//! The predicted segments of one frame.

use crate::MetricsError;
use splatseg_geometry::{Mask, MaskRuns, SegmentId, SegmentMap};
use std::collections::BTreeSet;

/// The predicted segments of one frame, with the size of its ground truth. Predicted ids need not match the true ones.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum FramePrediction<'a> {
    /// One id per pixel, `[height, width]`, 0 for none. An object keeps its id through the video.
    Ids(&'a SegmentMap),
    /// Masks with ids above 0, each id at most once. Masks may overlap. An object keeps its id through the video.
    Masks(&'a [(SegmentId, Mask)]),
    /// Masks without ids, from a method that segments each frame on its own. Masks may overlap. Masks of consecutive
    /// frames are linked by a [`MaskLinker`](splatseg_geometry::MaskLinker). A tube without a partner in the next frame
    /// ends. VSQ cuts the linked tubes at its windows, STQ uses them over the whole video.
    Unlinked(&'a [Mask]),
}

/// Type of a video's predictions: with ids or without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Linkage {
    Ids,
    Unlinked,
}

/// The validated predicted labels of one frame.
pub(crate) enum Labels<'a> {
    /// One label per pixel.
    Map(&'a SegmentMap),
    /// Labels above 0 with their pixels, which may overlap.
    Masks(Vec<(SegmentId, MaskRuns)>),
}

impl<'a> FramePrediction<'a> {
    pub(crate) fn linkage(&self) -> Linkage {
        match self {
            Self::Ids(_) | Self::Masks(_) => Linkage::Ids,
            Self::Unlinked(_) => Linkage::Unlinked,
        }
    }

    /// Validates the prediction of frame `frame`, an image of `size` = (width, height). A mask without an id is
    /// labelled with its index plus 1.
    pub(crate) fn labels(&self, frame: usize, size: (usize, usize)) -> Result<Labels<'a>, MetricsError> {
        let same_size = |found: (usize, usize)| {
            if found == size { Ok(()) } else { Err(MetricsError::PredictionSize { frame, found, expected: size }) }
        };
        let mask_size = |mask: &Mask| same_size((mask.width(), mask.height()));
        match self {
            Self::Ids(map) => {
                same_size(map.size())?;
                Ok(Labels::Map(map))
            }
            Self::Masks(masks) => {
                let mut seen = BTreeSet::new();
                for (id, mask) in *masks {
                    mask_size(mask)?;
                    if *id == 0 {
                        return Err(MetricsError::MaskWithoutId { frame });
                    }
                    if !seen.insert(*id) {
                        return Err(MetricsError::RepeatedId { frame, id: *id });
                    }
                }
                Ok(Labels::Masks(masks.iter().map(|(id, mask)| (*id, MaskRuns::from_mask(mask))).collect()))
            }
            Self::Unlinked(masks) => {
                masks.iter().try_for_each(mask_size)?;
                Ok(Labels::Masks((1..).zip(masks.iter().map(MaskRuns::from_mask)).collect()))
            }
        }
    }
}
