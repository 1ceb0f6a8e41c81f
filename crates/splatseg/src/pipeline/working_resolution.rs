//! The resolution at which frames are processed.
//!
//! More pixels cost time and memory, and make segments no better: the network that finds them sees a reduced image, and
//! the map needs no Gaussians closer together than that. So large frames are reduced first, and what is decided about them
//! is enlarged to their size.

use super::enlarging::enlarged;
use splatseg_dataset::Framing;
use splatseg_geometry::{
    Affinities, CameraFrame, CowImage, Image, Mask, RgbdFrame, ScoredMask, SegmentMap, Segmentation,
};
use splatseg_tracking::{FrameOutput, Hindsight, ShownFrame, TrackingError};

/// The most pixels of a frame that is processed. Larger frames are reduced.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct WorkingResolution {
    /// `None` for no limit.
    pub(super) max_pixels: Option<usize>,
}

impl WorkingResolution {
    /// The frame as it is processed.
    pub(super) fn frame<'a>(self, frame: &'a CameraFrame<'_>) -> WorkingFrame<'a> {
        WorkingFrame::new(frame, self.reduced(frame))
    }

    /// The reduced frame; `None` if it is small enough as it is.
    fn reduced(self, frame: &CameraFrame) -> Option<CameraFrame<'static>> {
        let framing = Framing { max_pixels: Some(self.max_pixels?), ..Framing::default() };
        let size = (frame.width(), frame.height());
        if framing.check(size).is_ok_and(|reduced| reduced == size) {
            return None;
        }
        framing.apply(frame.as_borrowed()).ok().map(CameraFrame::into_owned)
    }
}

/// A frame as it came and as it is processed: reduced, unless it is small enough.
pub(super) struct WorkingFrame<'a> {
    pub(super) whole: CameraFrame<'a>,
    pub(super) reduced: Option<CameraFrame<'static>>,
    /// True if the whole frame differs from the one that came.
    pub(super) is_changed: bool,
}

impl<'a> WorkingFrame<'a> {
    pub(super) fn new(whole: &'a CameraFrame<'_>, reduced: Option<CameraFrame<'static>>) -> Self {
        Self { whole: whole.as_borrowed(), reduced, is_changed: false }
    }

    /// The whole frame, if it differs from the one that came.
    pub(super) fn into_changed(self) -> Option<CameraFrame<'static>> {
        self.is_changed.then(|| self.whole.into_owned())
    }

    pub(super) fn into_reduced(self) -> Option<CameraFrame<'static>> {
        self.reduced
    }

    /// The frame for the method and the source of poses.
    pub(super) fn working(&self) -> &CameraFrame<'a> {
        self.reduced.as_ref().unwrap_or(&self.whole)
    }

    pub(super) fn is_reduced(&self) -> bool {
        self.reduced.is_some()
    }
}

/// The segmentation of a frame of size `from` (width, height), for the frame reduced to `size`.
///
/// # Errors
/// [`TrackingError::MaskSize`] if a mask, or the map of regions, has another size than the frame.
pub(super) fn reduced_segmentation(
    found: Segmentation,
    from: (usize, usize),
    size: (usize, usize),
) -> Result<Segmentation, TrackingError> {
    let sizes = found.masks.iter().map(|scored| (scored.mask.width(), scored.mask.height()));
    if let Some(found) = sizes.chain(found.regions.as_ref().map(SegmentMap::size)).find(|found| *found != from) {
        return Err(TrackingError::MaskSize { found, expected: from });
    }
    let (columns, rows) = (nearest(from.0, size.0), nearest(from.1, size.1));
    let mask = |scored: ScoredMask| ScoredMask {
        mask: Mask::from_fn(size.0, size.1, |column, row| scored.mask.contains(columns[column], rows[row])),
        score: scored.score,
    };
    Ok(Segmentation {
        masks: found.masks.into_iter().map(mask).filter(|scored| !scored.mask.is_empty()).collect(),
        regions: found.regions.map(|regions| resized_image(&regions, size)),
        affinities: found.affinities.and_then(|affinities| reduced_affinities(affinities, from, size)),
    })
}

/// Affinities of a frame of size `from`, for the frame reduced to `size`. `None` if their grid is finer than its pixels.
fn reduced_affinities(affinities: Affinities, from: (usize, usize), size: (usize, usize)) -> Option<Affinities> {
    let reduced = |places: &[u32], from: usize, to: usize| -> Vec<u32> {
        places.iter().map(|place| (u64::from(*place) * to as u64 / from as u64) as u32).collect()
    };
    let affinities = Affinities {
        columns: reduced(&affinities.columns, from.0, size.0),
        rows: reduced(&affinities.rows, from.1, size.1),
        ..affinities
    };
    affinities.fits(size).then_some(affinities)
}

/// For each pixel of an axis, the nearest one of the same axis with another number of pixels.
pub(super) fn nearest(from: usize, to: usize) -> Vec<usize> {
    (0..to).map(|pixel| (2 * pixel + 1) * from / (2 * to)).collect()
}

/// An image of another size, each pixel from the nearest one.
fn resized_image<T: Clone>(image: &CowImage<'_, T>, size: (usize, usize)) -> Image<T> {
    if image.size() == size {
        return image.clone().into_owned();
    }
    let (columns, rows) = (nearest(image.width(), size.0), nearest(image.height(), size.1));
    let mut pixels = Vec::with_capacity(size.0 * size.1);
    for row in rows {
        let row = image.row(row);
        pixels.extend(columns.iter().map(|column| row[*column].clone()));
    }
    Image::from_pixels(size.0, size.1, pixels).unwrap_or_else(|_| image.clone().into_owned())
}

/// A method's result for a reduced frame, for the frame itself, and its segments as they were.
pub(super) fn enlarged_output(output: FrameOutput, frame: &CameraFrame) -> (FrameOutput, SegmentMap) {
    let size = (frame.width(), frame.height());
    let FrameOutput { segments: reduced, confidence, masks, .. } = output;
    let (columns, rows) = (nearest(reduced.width(), size.0), nearest(reduced.height(), size.1));
    let whole_mask =
        |mask: Mask| Mask::from_fn(size.0, size.1, |column, row| mask.contains(columns[column], rows[row]));
    let whole = FrameOutput {
        segments: enlarged(&reduced, frame),
        confidence: resized_image(&confidence, size),
        masks: masks.into_iter().map(|(id, mask)| (id, whole_mask(mask))).collect(),
        ..output
    };
    (whole, reduced)
}

/// Decides earlier frames again at the resolution at which they were processed.
pub struct ReducedHindsight<'m> {
    pub(super) hindsight: &'m dyn Hindsight,
    pub(super) resolution: WorkingResolution,
}

impl Hindsight for ReducedHindsight<'_> {
    fn look_again(&self, frame: &RgbdFrame, shown: &ShownFrame) -> Result<FrameOutput, TrackingError> {
        let Some(reduced) = self.resolution.reduced(frame) else { return self.hindsight.look_again(frame, shown) };
        let size = (reduced.width(), reduced.height());
        let known = [size, (frame.width(), frame.height())];
        let images = std::iter::once(&shown.segments).chain(&shown.regions);
        if let Some(found) = images.map(SegmentMap::size).find(|found| !known.contains(found)) {
            return Err(TrackingError::MaskSize { found, expected: (frame.width(), frame.height()) });
        }
        let reduced_map = |map: &SegmentMap| resized_image(map, size);
        let shown =
            ShownFrame { segments: reduced_map(&shown.segments), regions: shown.regions.as_ref().map(reduced_map) };
        let output = self.hindsight.look_again(&reduced.at(*frame.world_from_camera()), &shown)?;
        Ok(enlarged_output(output, frame).0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn affinities_stay_unless_their_grid_is_finer_than_the_reduced_pixels() {
        let affinities = |step: u32| {
            let places = |size: u32| (0..size.div_ceil(step)).map(|place| place * step).collect();
            Affinities { columns: places(1280), rows: places(960), planes: Vec::new() }
        };
        let reduced = |step| reduced_affinities(affinities(step), (1280, 960), (320, 240));
        assert_eq!(reduced(2), None, "two places in one pixel");
        let found = reduced(8).unwrap();
        assert_eq!(found.columns, (0..160).map(|place| 2 * place).collect::<Vec<_>>());
        assert!(found.fits((320, 240)));
    }
}
