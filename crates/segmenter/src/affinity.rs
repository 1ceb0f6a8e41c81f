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
use splatseg_kernels::Instructions;
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

    fn detail(&self) -> Option<Detail> {
        Some(self.detail)
    }

    fn set_detail(&mut self, detail: Detail) {
        self.detail = detail;
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        self.log_odds(frame)?;
        let size = (frame.width(), frame.height());
        let (log_odds, offsets) = (&self.memory.log_odds, &*self.network.offsets);
        let scaled_size = (self.input.width(), self.input.height());
        let start = self.grid.start(0, (self.input.height(), self.input.width()));
        let graph = RegionGraph::from_log_odds(log_odds, offsets, self.grid);
        let labels = graph.labels.clone();
        // Merging has one thread, so the others do meanwhile what does not depend on it.
        let (tree, (labels, affinities)) = rayon::join(
            || MergeTree::new(graph),
            || {
                let labels = upsampling::enlarge(&labels, &self.input, start);
                (labels, affinities(log_odds, offsets, scaled_size, start, size))
            },
        );
        let threshold = self.settings.threshold.unwrap_or(self.network.threshold) + self.detail.log_odds();
        let partition = tree.cut(threshold);
        let fine = tree.cut(threshold.max(REGION_THRESHOLD));
        let places = Places::new(scaled_size, size);
        let (masks, regions) = rayon::join(
            || masks(&labels, &partition, &places, self.settings.min_area.max(1)),
            || places.map(&labels, |label| fine.segment_of_region[label as usize] + 1),
        );
        Ok(Segmentation { masks, regions: Some(regions), affinities: Some(affinities) })
    }
}

/// For each row and column of a frame, that of the scaled frame.
struct Places {
    /// Pixels in a row of the scaled frame.
    pitch: usize,
    rows: Vec<usize>,
    columns: Vec<usize>,
}

impl Places {
    fn new(scaled_size: (usize, usize), (width, height): (usize, usize)) -> Self {
        let places = |size: usize, scaled: usize| (0..size).map(|place| place * scaled / size).collect();
        Self { pitch: scaled_size.0, rows: places(height, scaled_size.1), columns: places(width, scaled_size.0) }
    }

    /// The ids of the frame's pixels for the labels of those of the scaled frame.
    fn map(&self, labels: &[u32], id: impl Fn(u32) -> u32) -> SegmentMap {
        let mut ids = Vec::with_capacity(self.rows.len() * self.columns.len());
        for row in &self.rows {
            let labels = &labels[row * self.pitch..][..self.pitch];
            ids.extend(self.columns.iter().map(|column| id(labels[*column])));
        }
        let (width, height) = (self.columns.len(), self.rows.len());
        SegmentMap::from_pixels(width, height, ids).unwrap_or_else(|_| SegmentMap::filled(width, height, 0))
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
    let instructions = Instructions::best();
    let plane = |channel: usize| {
        let mut plane = vec![0; log_odds.width() * log_odds.height()];
        for (row, out) in plane.chunks_exact_mut(log_odds.width().max(1)).enumerate() {
            let values = log_odds.row(channel, row);
            instructions.run(
                #[inline(always)]
                || out.iter_mut().zip(values).for_each(|(out, value)| *out = Affinities::quantised(*value)),
            );
        }
        AffinityPlane { right: offsets[channel].right, down: offsets[channel].down, log_odds: plane }
    };
    Affinities {
        columns: places(log_odds.width(), start[1], scaled_size.0, width),
        rows: places(log_odds.height(), start[0], scaled_size.1, height),
        planes: (0..offsets.len()).into_par_iter().map(plane).collect(),
    }
}

/// Makes masks of the frame's size from the region of each pixel of the scaled frame. Drops segments of fewer than
/// `min_area` pixels.
fn masks(labels: &[u32], partition: &Partition, places: &Places, min_area: usize) -> Vec<ScoredMask> {
    let segments = places.map(labels, |label| partition.segment_of_region[label as usize]);
    let mut areas = vec![0; partition.scores.len()];
    segments.pixels().chunk_by(|one, next| one == next).for_each(|run| areas[run[0] as usize] += run.len());
    let (width, height) = segments.size();
    let mut masks: Vec<Option<Mask>> =
        areas.iter().map(|area| (*area >= min_area).then(|| Mask::empty(width, height))).collect();
    for row in 0..height {
        let mut column = 0;
        for run in segments.row(row).chunk_by(|one, next| one == next) {
            let columns = column..column + run.len();
            column = columns.end;
            if let Some(mask) = &mut masks[run[0] as usize] {
                mask.insert_run(row, columns);
            }
        }
    }
    let scored = masks.into_iter().zip(&partition.scores);
    scored.filter_map(|(mask, score)| Some(ScoredMask { mask: mask?, score: *score })).collect()
}
