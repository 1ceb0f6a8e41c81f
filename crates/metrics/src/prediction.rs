//! The predicted segments of one frame.

use crate::MetricsError;
use splatseg_geometry::{Mask, MaskRuns, SegmentId, SegmentMap};
use std::collections::BTreeSet;

/// The predicted segments of one frame, in the size of its ground truth. Predicted ids need not match the true ones.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum FramePrediction<'a> {
    /// One id per pixel, `[height, width]`, 0 where there is none; an id stays with its object through the video.
    Ids(&'a SegmentMap),
    /// Masks that may overlap, with ids above 0 that stay with their objects through the video; each id at most once.
    Masks(&'a [(SegmentId, Mask)]),
    /// Masks without ids, which may overlap, from a method that segments each frame on its own. Masks of consecutive
    /// frames are linked by a [`MaskLinker`](splatseg_geometry::MaskLinker); a tube without a partner in the next frame
    /// ends. VSQ cuts the linked tubes at its windows, STQ takes them over the whole video.
    Unlinked(&'a [Mask]),
}

/// Whether a video's predictions carry ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Linkage {
    Ids,
    Unlinked,
}

/// The predicted labels of one frame, after checks.
pub(crate) enum Labels<'a> {
    /// One label per pixel.
    Map(&'a SegmentMap),
    /// Labels above 0 and their pixels, which may overlap.
    Masks(Vec<(SegmentId, MaskRuns)>),
}

impl<'a> FramePrediction<'a> {
    pub(crate) fn linkage(&self) -> Linkage {
        match self {
            Self::Ids(_) | Self::Masks(_) => Linkage::Ids,
            Self::Unlinked(_) => Linkage::Unlinked,
        }
    }

    /// The labels of frame `frame`, an image of `size` = (width, height). A mask without id is labelled with its index
    /// plus 1.
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
