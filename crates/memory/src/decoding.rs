//! From rendered features to expected segments (METHOD, "Decoding").

use crate::{Codebook, Expectation, SegmentBelief};
use rayon::prelude::*;
use splatseg_geometry::{Image, SegmentId, SegmentMap};
use splatseg_render::{BlendWeights, TileWeights};

/// What is needed to read segments off features.
pub(crate) struct Decoder<'a> {
    pub codebook: &'a Codebook,
    /// Codes given to segments so far; the others cannot be seen.
    pub used_codes: usize,
    pub threshold: f32,
}

/// One tile of an [`Expectation`].
struct ExpectedTile {
    segments: [SegmentId; TileWeights::PIXELS],
    confidence: [f32; TileWeights::PIXELS],
    silhouette: [f32; TileWeights::PIXELS],
    depth: [f32; TileWeights::PIXELS],
    /// `[16, 16, D]`.
    features: Vec<f32>,
}

impl Decoder<'_> {
    /// Renders `features` `[gaussians, D]`, silhouette and depth, and decodes every pixel.
    pub fn expect(&self, weights: &BlendWeights, features: &[f32]) -> Expectation {
        let feature_dim = self.codebook.feature_dim();
        let tiles: Vec<ExpectedTile> = weights
            .tiles()
            .par_iter()
            .map(|tile| {
                let mut rendered = vec![0.0; TileWeights::PIXELS * feature_dim];
                tile.accumulate(features, feature_dim, &mut rendered);
                self.expect_tile(tile, rendered)
            })
            .collect();
        assemble(weights, tiles)
    }

    fn expect_tile(&self, tile: &TileWeights, rendered: Vec<f32>) -> ExpectedTile {
        let mut expected = ExpectedTile {
            segments: [0; TileWeights::PIXELS],
            confidence: [0.0; TileWeights::PIXELS],
            silhouette: [0.0; TileWeights::PIXELS],
            depth: [0.0; TileWeights::PIXELS],
            features: Vec::new(),
        };
        for (column, depth) in tile.depths().iter().enumerate() {
            for (pixel, weight) in tile.column(column) {
                expected.silhouette[pixel as usize] += weight;
                expected.depth[pixel as usize] += weight * depth;
            }
        }
        // Neighbours mostly show the same segment, so the last one found is tried first.
        let mut hint = None;
        for (pixel, feature) in rendered.chunks_exact(self.codebook.feature_dim()).enumerate() {
            if expected.silhouette[pixel] == 0.0 {
                continue;
            }
            expected.depth[pixel] /= expected.silhouette[pixel];
            let code = self.codebook.decode_with_hint(feature, hint, self.used_codes, self.threshold);
            expected.segments[pixel] = code.map_or(0, |code| code + 1);
            expected.confidence[pixel] = confidence(feature, code.is_some());
            hint = code.or(hint);
        }
        expected.features = rendered;
        expected
    }
}

/// ‖F‖. A one-dimensional feature is an id, not a direction: it is believed or it is not.
fn confidence(feature: &[f32], decoded: bool) -> f32 {
    match feature {
        [_] => f32::from(u8::from(decoded)),
        _ => feature.iter().map(|value| value * value).sum::<f32>().sqrt(),
    }
}

fn assemble(weights: &BlendWeights, tiles: Vec<ExpectedTile>) -> Expectation {
    let (width, height) = (weights.width(), weights.height());
    let mut expectation = Expectation {
        belief: SegmentBelief {
            segments: SegmentMap::filled(width, height, 0),
            confidence: Image::filled(width, height, 0.0),
        },
        silhouette: Image::filled(width, height, 0.0),
        depth: Image::filled(width, height, 0.0),
        features: Vec::with_capacity(tiles.len()),
    };
    for (tile, expected) in weights.tiles().iter().zip(tiles) {
        let ((left, top), (tile_width, tile_height)) = (tile.origin(), tile.size());
        for row in 0..tile_height {
            let from = row * TileWeights::SIDE..row * TileWeights::SIDE + tile_width;
            let start = (top + row) * width + left;
            let to = start..start + tile_width;
            expectation.belief.segments.pixels_mut()[to.clone()].copy_from_slice(&expected.segments[from.clone()]);
            expectation.belief.confidence.pixels_mut()[to.clone()].copy_from_slice(&expected.confidence[from.clone()]);
            expectation.silhouette.pixels_mut()[to.clone()].copy_from_slice(&expected.silhouette[from.clone()]);
            expectation.depth.pixels_mut()[to].copy_from_slice(&expected.depth[from]);
        }
        expectation.features.push(expected.features);
    }
    expectation
}
