//! Things that move by themselves must not drag the camera along.

use crate::keyframe::{Aligned, Reference};
use crate::pyramid::Pyramid;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{RemappedId, SegmentId};
use std::collections::BTreeMap;

/// Weight of the newest frame in the running mean of a segment's error.
const NEWEST: f32 = 0.2;

/// A segment with an error of this many times the median segment's loses weight.
const TOLERATED: f32 = 2.0;

/// Segments with fewer residuals are not judged.
const MIN_POINTS: f32 = 20.0;

/// How badly each segment fits the camera's motion.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Movers {
    /// Running mean of the squared residuals of each segment's points, in units of their deviations.
    errors: BTreeMap<SegmentId, f32>,
}

impl Movers {
    /// Records how well each segment of a keyframe fits an aligned frame.
    pub(crate) fn record(&mut self, reference: &Reference, frame: &Pyramid, aligned: &Aligned) {
        let mut sums: BTreeMap<SegmentId, (f32, f32)> = BTreeMap::new();
        reference.squared_residuals(frame, aligned, |id, squared| {
            let sum = sums.entry(id).or_default();
            *sum = (sum.0 + squared, sum.1 + 1.0);
        });
        for (id, (sum, count)) in sums {
            if id != 0 && count >= MIN_POINTS {
                let error = self.errors.entry(id).or_insert(1.0);
                *error += NEWEST * (sum / count - *error);
            }
        }
    }

    /// Replaces ids that turned out to be the same object.
    pub(crate) fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped {
            if let Some(error) = self.errors.remove(from) {
                self.errors.entry(*into).or_insert(error);
            }
        }
    }

    /// Sets the weights of a keyframe's points.
    pub(crate) fn weigh(&self, reference: &mut Reference) {
        let mut errors: Vec<f32> = self.errors.values().copied().collect();
        errors.sort_by(f32::total_cmp);
        let Some(median) = errors.get(errors.len() / 2).copied() else { return };
        let limit = TOLERATED * median.max(0.5);
        reference.weigh(|id| {
            let error = self.errors.get(&id).copied().unwrap_or(0.0);
            if error <= limit { 1.0 } else { (limit / error) * (limit / error) }
        });
    }
}
