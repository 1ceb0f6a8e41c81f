//! A segmenter without weights, based on surfaces and colours.
//!
//! 1. [`color`]: CIELAB, smoothed with edges preserved. [`surface`]: a plane fitted around every pixel.
//! 2. [`edges`] and [`patches`]: similar neighbouring pixels grow into hundreds of small patches (Felzenszwalb and
//!    Huttenlocher, *Efficient Graph-Based Image Segmentation*, IJCV 2004).
//! 3. [`borders`] and [`merge`]: patches are merged, the most certain pair first, while the border between two of them
//!    looks like the inside of an object. As in LCCP (Stein et al., *Object Partitioning using Local Convexity*, CVPR
//!    2014), a concave border is evidence for two objects, a convex one hardly any.

mod borders;
mod color;
mod edges;
mod merge;
mod patches;
mod resolution;
mod settings;
mod surface;

pub use settings::{BorderWeights, GraphSettings, PatchSettings, SurfaceSettings};

use crate::{Detail, Segmenter, SegmenterError};
use splatseg_geometry::{CameraFrame, Mask, ScoredMask, Segmentation};

/// A segmenter that cuts the image where depth, surface orientation and colour change as they do between objects.
///
/// Its masks never overlap. The result does not depend on the number of threads.
#[derive(Clone, Debug)]
pub struct GraphSegmenter {
    settings: GraphSettings,
    detail: Detail,
}

impl GraphSegmenter {
    /// Creates a segmenter.
    ///
    /// # Errors
    /// [`SegmenterError::Setting`] if a setting is out of its range.
    pub fn new(settings: GraphSettings) -> Result<Self, SegmenterError> {
        Ok(Self { settings: settings.validated()?, detail: Detail::Normal })
    }

    /// The settings in use.
    pub fn settings(&self) -> &GraphSettings {
        &self.settings
    }
}

impl Segmenter for GraphSegmenter {
    fn name(&self) -> &str {
        "graph"
    }

    fn needs_all_pixels(&self) -> bool {
        false
    }

    fn detail(&self) -> Option<Detail> {
        Some(self.detail)
    }

    fn set_detail(&mut self, detail: Detail) {
        self.detail = detail;
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let mut settings = self.settings.clone();
        settings.borders.bias += self.detail.log_odds();
        let settings = &settings;
        let scaled = resolution::ScaledFrame::new(frame, settings.max_pixels);
        let lab = color::smoothed_lab(&scaled.color, settings.color_smoothing);
        let surface = surface::Surface::from_depth(&scaled.depth, scaled.camera, &lab, &settings.surface);
        let edges = edges::pixel_edges(&lab, &surface, settings);
        let patches = patches::grow(&edges, lab.size(), &settings.patches);
        let regions = merge::merge(borders::Regions::from_patches(&patches, &lab, &surface, settings), settings);
        let mut masks = vec![Mask::empty(frame.width(), frame.height()); regions.scores.len()];
        for row in 0..frame.height() {
            for column in 0..frame.width() {
                let patch = patches.labels[scaled.index_of(column, row)];
                masks[regions.region_of_patch[patch as usize] as usize].set(column, row, true);
            }
        }
        let scored = masks.into_iter().zip(regions.scores).map(|(mask, score)| ScoredMask { mask, score });
        let large = scored.filter(|scored| scored.mask.area() >= settings.min_area.max(1));
        Ok(large.collect::<Vec<ScoredMask>>().into())
    }
}
