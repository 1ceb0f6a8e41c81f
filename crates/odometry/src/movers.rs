//! Things that move by themselves must not drag the camera along.

use crate::keyframe::{Aligned, Reference};
use crate::motion_test::MotionTest;
use crate::prior::MotionPrior;
use crate::pyramid::Pyramid;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{RemappedId, SegmentId};
use std::collections::BTreeMap;

/// A segment may move by itself if it contradicts the others more than this...
const LIMIT: f32 = 6.0;

/// ...and this many times more than parts of the image that stand still contradict each other. Real cameras have a
/// rolling shutter, and depth is distorted.
const TIMES_TYPICAL: f32 = 4.0;

/// Weight of the newest frame in the running mean of the typical contradiction.
const NEWEST: f32 = 0.05;

/// Share of the difference to a frame's evidence by which a segment's grows, and by which it shrinks. Right after a new
/// keyframe things have not moved far, and contradict nothing; that says little.
const GROWTH: f32 = 0.5;
const DECAY: f32 = 0.03;

/// A frame is evidence of at most this much.
const MAX_EVIDENCE: f32 = 2.0;

/// A frame is aligned again if the weight of a segment decreases by more than this.
const MIN_DECREASE: f32 = 0.3;

/// Which segments move by themselves.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Movers {
    /// Evidence that a segment moves: how much it contradicts the others, in units of the limit.
    evidence: BTreeMap<SegmentId, f32>,
    /// Running mean of the contradiction between parts of the image that stand still.
    typical: Option<f32>,
}

impl Movers {
    /// Judges which segments of a keyframe have moved by themselves. If some lose their weight, the frame is aligned again
    /// without them.
    pub(crate) fn judge(
        &mut self,
        reference: &mut Reference,
        frame: &Pyramid,
        aligned: Aligned,
        prior: &MotionPrior,
    ) -> Aligned {
        let Some(test) = MotionTest::new(reference, frame, &aligned) else { return aligned };
        let limit = LIMIT.max(TIMES_TYPICAL * self.typical.unwrap_or(0.0));
        let motions = test.motions(limit);
        if let Some(typical) = motions.typical {
            let before = self.typical.unwrap_or(typical);
            self.typical = Some(before + NEWEST * (typical - before));
        }
        let mut has_decreased = false;
        for (id, contradiction) in motions.contradictions {
            let evidence = self.evidence.entry(id).or_insert(0.0);
            let (before, found) = (*evidence, (contradiction / limit).min(MAX_EVIDENCE));
            *evidence += (if found > before { GROWTH } else { DECAY }) * (found - before);
            has_decreased |= weight(before) - weight(*evidence) > MIN_DECREASE;
        }
        if !has_decreased {
            return aligned;
        }
        self.weigh(reference);
        reference.align_again(frame, &aligned, prior)
    }

    /// Replaces ids that turned out to be the same object.
    pub(crate) fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped {
            if let Some(evidence) = self.evidence.remove(from) {
                self.evidence.entry(*into).or_insert(evidence);
            }
        }
    }

    /// Sets the weights of a keyframe's points.
    pub(crate) fn weigh(&self, reference: &mut Reference) {
        reference.weigh(|id| self.evidence.get(&id).map_or(1.0, |evidence| weight(*evidence)));
    }
}

/// Weight of a segment: 1 up to half the evidence at which it has none.
fn weight(evidence: f32) -> f32 {
    (2.0 - 2.0 * evidence).clamp(0.0, 1.0)
}
