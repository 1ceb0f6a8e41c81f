//! The learned segmenter: a small network says which pixels belong to the same object, and regions are merged accordingly.
//!
//! 1. [`resolution`] and [`inputs`]: the frame, at most 320×240 pixels, as eight channels.
//! 2. [`network`]: log-odds that a pixel and those at twelve offsets belong to one object, at half that size.
//! 3. [`regions`] and [`agglomeration`]: pixels become small regions, and regions are merged while the mean log-odds
//!    between two of them are above a threshold. Every pixel belongs to one segment.

mod agglomeration;
mod device_network;
mod inputs;
mod network;
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
pub use weights::AffinityWeightsError;

use crate::{Segmenter, SegmenterError};
use network::NetworkMemory;
use regions::RegionGraph;
use resolution::View;
use splatseg_geometry::{Mask, RgbdFrame, ScoredMask};
use splatseg_kernels::feature_map::FeatureMap;

/// A segmenter that has learned from rendered rooms which pixels belong to the same object.
///
/// Its masks never overlap. It is deterministic, whatever the number of threads. It works without depth, though worse.
#[derive(Clone, Debug)]
pub struct AffinitySegmenter {
    network: AffinityNetwork,
    settings: AffinitySettings,
    input: FeatureMap,
    memory: NetworkMemory,
}

impl AffinitySegmenter {
    /// Makes a segmenter.
    ///
    /// # Errors
    /// [`SegmenterError::Setting`] if a setting is out of its range.
    pub fn new(network: AffinityNetwork, settings: AffinitySettings) -> Result<Self, SegmenterError> {
        let settings = settings.validated()?;
        Ok(Self { network, settings, input: FeatureMap::default(), memory: NetworkMemory::default() })
    }

    /// The settings in use.
    pub fn settings(&self) -> &AffinitySettings {
        &self.settings
    }

    /// The network's input for a frame, `[8, height, width]`: colour, inverse depth, validity and normals.
    pub fn inputs(&mut self, frame: &RgbdFrame) -> &FeatureMap {
        inputs::compute(&View::of_frame(frame, self.settings.max_pixels), &mut self.input);
        &self.input
    }

    /// For each pixel of the half-size image, the log-odds that it and the pixels at the network's offsets belong to the
    /// same object, `[offsets, height, width]`.
    ///
    /// # Errors
    /// [`SegmenterError::Device`] if the network's device failed; never on the CPU.
    pub fn log_odds(&mut self, frame: &RgbdFrame) -> Result<&FeatureMap, SegmenterError> {
        self.inputs(frame);
        self.network.forward(&self.input, &mut self.memory)?;
        Ok(&self.memory.log_odds)
    }

    /// All merges of a frame's regions: a hierarchy of segments, to be cut at any threshold.
    ///
    /// # Errors
    /// As [`log_odds`](Self::log_odds).
    pub fn merge_tree(&mut self, frame: &RgbdFrame) -> Result<MergeTree, SegmenterError> {
        self.log_odds(frame)?;
        Ok(MergeTree::new(RegionGraph::from_log_odds(&self.memory.log_odds, &self.network.offsets)))
    }
}

impl Segmenter for AffinitySegmenter {
    fn name(&self) -> &str {
        "affinity"
    }

    fn segment(&mut self, frame: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
        let tree = self.merge_tree(frame)?;
        let partition = tree.cut(self.settings.threshold.unwrap_or(self.network.threshold));
        let segments = upsampling::enlarge(&partition.segments_of_pixels(&tree), &self.input);
        let view = (self.input.width(), self.input.height());
        Ok(masks(frame, view, &segments, &partition.scores, self.settings.min_area.max(1)))
    }
}

/// The segments of at least `min_area` pixels, at the frame's size, from those of the pixels of a view of this width and
/// height.
fn masks(
    frame: &RgbdFrame,
    view: (usize, usize),
    segments: &[u32],
    scores: &[f32],
    min_area: usize,
) -> Vec<ScoredMask> {
    let (width, height) = (frame.width(), frame.height());
    let columns: Vec<usize> = (0..width).map(|column| column * view.0 / width).collect();
    let row_of = |row: usize| &segments[row * view.1 / height * view.0..][..view.0];
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
