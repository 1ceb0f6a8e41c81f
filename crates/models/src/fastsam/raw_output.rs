//! The network's output and its decoding.

use super::Candidates;
use super::head::STRIDES;

/// Prototype maps at a quarter of the input's size. Masks are linear combinations of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Prototypes {
    /// Number of maps.
    pub count: usize,
    /// Height of a map in pixels.
    pub height: usize,
    /// Width of a map in pixels.
    pub width: usize,
    /// `[count, height, width]`, row-major.
    pub values: Vec<f32>,
}

/// The head's output for the anchors of one level; every map is `[channels, height, width]`, row-major.
#[derive(Clone, Debug)]
pub(super) struct RawLevel {
    pub height: usize,
    pub width: usize,
    /// Logits over bins of the distances to the left, top, right and bottom side, in strides.
    pub distances: Vec<f32>,
    /// Logits of scores.
    pub scores: Vec<f32>,
    /// Coefficients of prototypes.
    pub coefficients: Vec<f32>,
}

/// The network's output for one image, before decoding.
#[derive(Clone, Debug)]
pub struct RawOutput {
    pub(super) levels: Vec<RawLevel>,
    pub(super) prototypes: Prototypes,
    pub(super) distance_bins: usize,
}

impl RawOutput {
    /// The mask prototypes.
    pub fn prototypes(&self) -> &Prototypes {
        &self.prototypes
    }

    /// Decodes the anchors whose score exceeds `confidence`; a negative confidence returns every anchor.
    ///
    /// Anchors are numbered level by level (strides 8, 16, 32), row-major. As in Ultralytics' `Segment`, a side's
    /// distance is the mean of its distribution, and the anchor's centre is at (column + ½, row + ½) strides.
    pub fn candidates(&self, confidence: f64) -> Candidates {
        let mut candidates = Candidates::new(self.prototypes.count);
        let mut first_anchor = 0;
        for (level, stride) in self.levels.iter().zip(STRIDES) {
            for (index, logit) in level.scores.iter().enumerate() {
                let score = 1.0 / (1.0 + (-logit).exp());
                if f64::from(score) > confidence {
                    let box_cxcywh = level.decode_box(index, stride as f32, self.distance_bins);
                    let coefficients = (0..self.prototypes.count).map(|k| level.coefficients[k * level.len() + index]);
                    candidates.push(first_anchor + index, box_cxcywh, score, coefficients);
                }
            }
            first_anchor += level.len();
        }
        candidates
    }
}

impl RawLevel {
    fn len(&self) -> usize {
        self.height * self.width
    }

    /// Centre and size of an anchor's box, in input pixels.
    fn decode_box(&self, index: usize, stride: f32, bins: usize) -> [f32; 4] {
        let distance = |side: usize| {
            let logit = |bin: usize| self.distances[(side * bins + bin) * self.len() + index];
            let largest = (0..bins).map(logit).fold(f32::NEG_INFINITY, f32::max);
            let (mut total, mut weighted) = (0.0, 0.0);
            for bin in 0..bins {
                let weight = (logit(bin) - largest).exp();
                total += weight;
                weighted += weight * bin as f32;
            }
            weighted / total
        };
        let (x, y) = ((index % self.width) as f32 + 0.5, (index / self.width) as f32 + 0.5);
        let (left, top) = (x - distance(0), y - distance(1));
        let (right, bottom) = (x + distance(2), y + distance(3));
        [(left + right) / 2.0 * stride, (top + bottom) / 2.0 * stride, (right - left) * stride, (bottom - top) * stride]
    }
}
