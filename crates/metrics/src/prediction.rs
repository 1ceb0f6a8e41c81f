//! What a method says about one frame.

use crate::MetricsError;
use crate::mask_runs::MaskRuns;
use splatseg_geometry::{Mask, SegmentId, SegmentMap};
use std::collections::BTreeSet;

/// The predicted segments of one frame, of the size of its ground truth. Ids are unrelated to the true ones.
#[derive(Clone, Copy, Debug)]
pub enum FramePrediction<'a> {
    /// One id per pixel, `[height, width]`, 0 where there is none; an id stays with its object through the video.
    Ids(&'a SegmentMap),
    /// Masks that may overlap, with ids above 0 that stay with their objects through the video; each id at most once.
    Masks(&'a [(SegmentId, Mask)]),
    /// Masks without ids, which may overlap, of a method that sees each frame alone. Masks of consecutive frames are
    /// linked by the Hungarian algorithm maximising the summed F-score; a tube that finds no partner in the next frame
    /// ends. VSQ cuts the linked tubes at its windows, STQ takes them through the video.
    Unlinked(&'a [Mask]),
}

/// Whether a video's predictions carry ids.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Linkage {
    Ids,
    Unlinked,
}

/// The predicted labels of one frame, checked.
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
                Ok(Labels::Masks(masks.iter().map(|(id, mask)| (*id, MaskRuns::of(mask))).collect()))
            }
            Self::Unlinked(masks) => {
                masks.iter().try_for_each(mask_size)?;
                Ok(Labels::Masks((1..).zip(masks.iter().map(MaskRuns::of)).collect()))
            }
        }
    }
}
