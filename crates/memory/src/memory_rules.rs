//! The rules of a kind of memory, for the map and for the methods.

use crate::map::RADIUS_PER_SPACING;
use crate::settings::COVERED;
use crate::{GrowthRule, MemorySettings};
use splatseg_geometry::{MAX_SEGMENT_ID, PatchSize, SegmentId};
use splatseg_render::RasterLimits;

/// Smaller alphas are not blended, for speed. The paper's memory blends down to 1/255.
const MIN_ALPHA: f32 = 0.02;

/// A pixel is finished when less light than this would come through, for speed. The paper's memory uses 1e-4.
const MIN_TRANSMITTANCE: f32 = 0.01;

/// The rules in which kinds of memory differ, apart from how they store segments; see
/// [`SegmentStore::rules`](crate::SegmentStore::rules). `docs/METHOD.md` has them in a table. The default is that of
/// votes (`memory.kind = evidence`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MemoryRules {
    /// How the map grows where `memory.growth` is `auto`. With [`GrowthRule::Paper`], Gaussians are removed only beyond
    /// `memory.max_gaussians`, and the map does not follow poses that jump.
    pub growth: GrowthRule,
    /// Limits of the rasterisation that reads segments from the map.
    pub limits: RasterLimits,
    /// True if every frame is compared with the map before it is learnt. A frame that sees through most of the map
    /// removes nothing.
    pub compares_frames: bool,
    /// True if a frame that contradicts most of the map expects the ids of the previous frame where the map shows none.
    pub expects_previous_ids: bool,
    /// True if the ids that Gaussians hold are counted after every frame; otherwise after every sixteenth, as that takes
    /// long.
    pub counts_ids_per_frame: bool,
    /// True if methods ignore and contradict predictions by `min_match_f_score`, `min_visible_fraction`,
    /// `min_new_fraction`, `regions_decide` and `memory.compare_colors`, and a run has a final pass, which the paper has not.
    pub judges_predictions: bool,
    /// Largest id that can be remembered.
    pub largest_id: SegmentId,
}

impl Default for MemoryRules {
    fn default() -> Self {
        Self {
            growth: GrowthRule::Missing,
            limits: fast_limits(),
            compares_frames: true,
            expects_previous_ids: true,
            counts_ids_per_frame: true,
            judges_predictions: true,
            largest_id: MAX_SEGMENT_ID,
        }
    }
}

/// Limits that blend less than the paper's, for speed: scores change by less than 0.1, and half of the work is left.
fn fast_limits() -> RasterLimits {
    let limits = RasterLimits::default();
    // The Gaussian that finishes a pixel is not blended, so a single Gaussian must not finish it.
    let max_alpha = limits.max_alpha.min(1.0 - 2.0 * MIN_TRANSMITTANCE);
    RasterLimits { min_alpha: MIN_ALPHA, max_alpha, min_transmittance: MIN_TRANSMITTANCE, ..limits }
}

impl MemoryRules {
    /// The rules with the growth rule of the settings, unless that is [`GrowthRule::Auto`].
    pub(crate) fn with_settings(self, settings: &MemorySettings) -> Self {
        match settings.growth {
            GrowthRule::Auto => self,
            growth => Self { growth, ..self },
        }
    }

    /// The surface that a Gaussian stands for under these rules.
    pub(crate) fn patch_size(&self, settings: &MemorySettings) -> PatchSize {
        let (side, covering_alpha) = match self.growth {
            GrowthRule::Paper => (1.0, settings.growth_silhouette),
            _ => (1.0 / RADIUS_PER_SPACING, COVERED),
        };
        // A Gaussian's alpha is exp(-d² / 2r²) at distance d.
        PatchSize { side, cover: (-2.0 * covering_alpha.clamp(0.1, 0.9).ln()).sqrt() }
    }

    /// True if the map follows the paper's rules for growing and removing.
    pub(crate) fn is_papers_map(&self) -> bool {
        self.growth == GrowthRule::Paper
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::FeatureStore;

    #[test]
    fn each_kind_grows_by_its_own_rule_unless_the_settings_choose() {
        let settings = |growth| MemorySettings::default().with(|memory| memory.growth = growth);
        let votes = |growth| MemoryRules::default().with_settings(&settings(growth)).growth;
        let features = |growth| FeatureStore::rules_of(&settings(growth)).with_settings(&settings(growth)).growth;
        assert_eq!(votes(GrowthRule::Auto), GrowthRule::Missing);
        assert_eq!(features(GrowthRule::Auto), GrowthRule::Paper);
        assert_eq!(features(GrowthRule::Missing), GrowthRule::Missing);
        assert_eq!(votes(GrowthRule::Paper), GrowthRule::Paper);
    }
}
