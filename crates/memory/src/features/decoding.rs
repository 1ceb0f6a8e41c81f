//! Decoding of rendered features to expected segments (docs/PAPER.md, "Features").

use crate::Codebook;
use crate::recall::StoreTile;
use crate::tile_surface::TileSurface;
use splatseg_render::TileWeights;

/// Decodes features to segments.
pub(crate) struct Decoder<'a> {
    pub codebook: &'a Codebook,
    /// Number of codes assigned to segments. The others cannot occur.
    pub used_codes: usize,
    pub threshold: f32,
}

impl Decoder<'_> {
    /// Decodes a tile's rendered features, `[16, 16, D]`, and keeps them for learning.
    pub fn read_tile(&self, surface: &TileSurface, rendered: Vec<f32>) -> StoreTile {
        let (mut segments, mut confidence) = (vec![0; TileWeights::PIXELS], vec![0.0; TileWeights::PIXELS]);
        // Neighbours mostly show the same segment, so the last one found is tried first.
        let mut hint = None;
        for (pixel, feature) in rendered.chunks_exact(self.codebook.feature_dim()).enumerate() {
            if surface.silhouette[pixel] == 0.0 {
                continue;
            }
            let code = self.codebook.decode_with_hint(feature, hint, self.used_codes, self.threshold);
            segments[pixel] = code.map_or(0, |code| code + 1);
            confidence[pixel] = magnitude(feature, code.is_some());
            hint = code.or(hint);
        }
        StoreTile { segments, confidence, ids: Vec::new(), values: rendered }
    }
}

/// Returns ‖F‖. A one-dimensional feature is an id without a direction: its confidence is 1 or 0.
fn magnitude(feature: &[f32], decoded: bool) -> f32 {
    match feature {
        [_] => f32::from(u8::from(decoded)),
        _ => feature.iter().map(|value| value * value).sum::<f32>().sqrt(),
    }
}
