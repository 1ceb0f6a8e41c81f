//! The learned segmenter: a small network predicts which pixels belong to the same object, and regions are merged
//! accordingly.
//!
//! 1. [`resolution`] and [`inputs`]: the frame, by default at most 320×240 pixels, as eight channels.
//! 2. [`noise`]: how noisy the depth is, which decides between two sets of weights.
//! 3. [`network`]: log-odds that a pixel and each of its partners at twelve offsets belong to one object, at half that
//!    size.
//! 4. [`regions`] and [`agglomeration`]: pixels are grouped into small regions, and regions are merged while the mean
//!    log-odds between two of them are above a threshold. Every pixel belongs to one segment.
//!
//! The network on the CPU does not use Burn. Its inputs and outputs are compared with those of the training code in
//! Python on golden data that `training/make_test_data.py` makes. [`AffinitySegmenter::merge_tree`] returns the whole
//! tree of merges, of which the segments are a cut.

mod agglomeration;
#[cfg(feature = "networks")]
mod device_network;
#[cfg(not(feature = "networks"))]
#[path = "affinity/no_device_network.rs"]
mod device_network;
mod grid;
mod inputs;
mod network;
mod noise;
mod regions;
mod resolution;
mod settings;
#[cfg(test)]
mod tests;
mod upsampling;
mod weights;

pub use agglomeration::{MergeTree, Partition};
pub use network::AffinityNetwork;
pub use settings::AffinitySettings;
pub use weights::{AffinityWeights, AffinityWeightsError};

use crate::{Detail, Segmenter, SegmenterError};
use grid::Grid;
use network::NetworkMemory;
use rayon::prelude::*;
use regions::RegionGraph;
use resolution::ScaledFrame;
use splatseg_geometry::{Affinities, AffinityPlane, CameraFrame, Mask, ScoredMask, SegmentMap, Segmentation};
use splatseg_kernels::feature_map::FeatureMap;
use weights::Offset;

/// Log-odds above which regions are merged for the finer cut: what they unite lies in one object for certain.
const REGION_THRESHOLD: f32 = -0.5;

/// A segmenter with a network, trained on rendered rooms, that predicts which pixels belong to the same object.
///
/// Its masks never overlap. The result does not depend on the number of threads. It works without depth, though less
/// well.
#[derive(Clone, Debug)]
pub struct AffinitySegmenter {
    usual: AffinityNetwork,
    /// The network for frames with noisy depth.
    noisy_depth: Option<AffinityNetwork>,
    /// The one of the two for the latest frame.
    network: AffinityNetwork,
    settings: AffinitySettings,
    detail: Detail,
    input: FeatureMap,
    grid: Grid,
    memory: NetworkMemory,
}

impl AffinitySegmenter {
    /// Creates a segmenter.
    ///
    /// # Errors
    /// [`SegmenterError::Setting`] if a setting is out of its range.
    pub fn new(network: AffinityNetwork, settings: AffinitySettings) -> Result<Self, SegmenterError> {
        let settings = settings.validated()?;
        let (input, grid, memory) = (FeatureMap::default(), Grid::default(), NetworkMemory::default());
        let usual = network.clone();
        Ok(Self { usual, noisy_depth: None, network, settings, detail: Detail::Normal, input, grid, memory })
    }

    /// Sets another network for frames whose depth is noisier than [`AffinitySettings::noisy_depth`].
    #[must_use]
    pub fn with_noisy_depth(mut self, network: AffinityNetwork) -> Self {
        self.noisy_depth = Some(network);
        self
    }

    /// Sets how finely frames are segmented, on top of the threshold of the settings.
    #[must_use]
    pub fn with_detail(mut self, detail: Detail) -> Self {
        self.detail = detail;
        self
    }

    /// The settings in use.
    pub fn settings(&self) -> &AffinitySettings {
        &self.settings
    }

    /// Computes the network's input for a frame, `[8, height, width]`: colour, inverse depth, validity and normals.
    pub fn inputs(&mut self, frame: &CameraFrame) -> &FeatureMap {
        let scaled = ScaledFrame::new(frame, self.settings.max_pixels);
        let smooth = inputs::compute(&scaled, &mut self.input);
        self.grid = Grid::new((self.input.height(), self.input.width()));
        let is_noisy =
            || noise::depth_noise(&scaled.depth, &smooth).is_some_and(|noise| noise > self.settings.noisy_depth);
        let noisy_depth = self.noisy_depth.as_ref().filter(|_| is_noisy());
        self.network = noisy_depth.unwrap_or(&self.usual).clone();
        &self.input
    }

    /// Computes, for each pixel of the half-size image, the log-odds that it belongs to the same object as the pixels
    /// at the network's offsets, `[offsets, height, width]`. The half-size image has every second row and column of the
    /// input, counted from its centre.
    ///
    /// # Errors
    /// [`SegmenterError::Device`] if the network's device fails; never on the CPU.
    pub fn log_odds(&mut self, frame: &CameraFrame) -> Result<&FeatureMap, SegmenterError> {
        self.inputs(frame);
        self.network.forward(&self.input, self.grid, &mut self.memory)?;
        Ok(&self.memory.log_odds)
    }

    /// Computes all merges of a frame's regions, a hierarchy of segments that can be cut at any threshold.
    ///
    /// # Errors
    /// As [`log_odds`](Self::log_odds).
    pub fn merge_tree(&mut self, frame: &CameraFrame) -> Result<MergeTree, SegmenterError> {
        self.log_odds(frame)?;
        Ok(MergeTree::new(RegionGraph::from_log_odds(&self.memory.log_odds, &self.network.offsets, self.grid)))
    }
}

impl Segmenter for AffinitySegmenter {
    fn name(&self) -> &str {
        "affinity"
    }

    fn needs_all_pixels(&self) -> bool {
        false
    }

    fn prefers_upright(&self) -> bool {
        true
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let tree = self.merge_tree(frame)?;
        let threshold = self.settings.threshold.unwrap_or(self.network.threshold) + self.detail.log_odds();
        let partition = tree.cut(threshold);
        let fine = tree.cut(threshold.max(REGION_THRESHOLD));
        let start = self.grid.start(0, (self.input.height(), self.input.width()));
        let labels = upsampling::enlarge(tree.labels(), &self.input, start);
        let scaled_size = (self.input.width(), self.input.height());
        let segments: Vec<u32> = labels.iter().map(|label| partition.segment_of_region[*label as usize]).collect();
        let masks = masks(frame, scaled_size, &segments, &partition.scores, self.settings.min_area.max(1));
        let (width, height) = (frame.width(), frame.height());
        let regions = SegmentMap::from_fn(width, height, |column, row| {
            let (row, column) = (row * scaled_size.1 / height, column * scaled_size.0 / width);
            fine.segment_of_region[labels[row * scaled_size.0 + column] as usize] + 1
        });
        let affinities = affinities(&self.memory.log_odds, &self.network.offsets, scaled_size, start, (width, height));
        Ok(Segmentation { masks, regions: Some(regions), affinities: Some(affinities) })
    }
}

/// The log-odds of the half-size image, whose first pixel is the scaled frame's at row and column `start`, on the grid of
/// the frame's pixels.
fn affinities(
    log_odds: &FeatureMap,
    offsets: &[Offset],
    scaled_size: (usize, usize),
    start: [usize; 2],
    (width, height): (usize, usize),
) -> Affinities {
    let places = |count: usize, start: usize, scaled: usize, size: usize| {
        // The first of the frame's pixels that this pixel of the scaled frame stands for.
        (0..count).map(|place| ((2 * place + start) * size).div_ceil(scaled) as u32).collect()
    };
    let plane = |channel: usize| {
        let mut plane = Vec::with_capacity(log_odds.width() * log_odds.height());
        (0..log_odds.height())
            .for_each(|row| plane.extend(log_odds.row(channel, row).iter().map(|value| Affinities::quantised(*value))));
        AffinityPlane { right: offsets[channel].right, down: offsets[channel].down, log_odds: plane }
    };
    Affinities {
        columns: places(log_odds.width(), start[1], scaled_size.0, width),
        rows: places(log_odds.height(), start[0], scaled_size.1, height),
        planes: (0..offsets.len()).into_par_iter().map(plane).collect(),
    }
}

/// Makes masks of the frame's size from the segment of each pixel of the scaled frame. Drops segments of fewer than
/// `min_area` pixels.
fn masks(
    frame: &CameraFrame,
    scaled_size: (usize, usize),
    segments: &[u32],
    scores: &[f32],
    min_area: usize,
) -> Vec<ScoredMask> {
    let (width, height) = (frame.width(), frame.height());
    let columns: Vec<usize> = (0..width).map(|column| column * scaled_size.0 / width).collect();
    let row_of = |row: usize| &segments[row * scaled_size.1 / height * scaled_size.0..][..scaled_size.0];
    let mut areas = vec![0; scores.len()];
    for row in 0..height {
        let segments = row_of(row);
        columns.iter().for_each(|column| areas[segments[*column] as usize] += 1);
    }
    let mut masks: Vec<Option<Mask>> =
        areas.iter().map(|area| (*area >= min_area).then(|| Mask::empty(width, height))).collect();
    for row in 0..height {
        let segments = row_of(row);
        for (column, place) in columns.iter().enumerate() {
            if let Some(mask) = &mut masks[segments[*place] as usize] {
                mask.set(column, row, true);
            }
        }
    }
    let scored = masks.into_iter().zip(scores);
    scored.filter_map(|(mask, score)| Some(ScoredMask { mask: mask?, score: *score })).collect()
}
