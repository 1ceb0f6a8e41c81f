//! Class-agnostic average precision of 3D instances on the vertices of a mesh, as published for methods of online 3D
//! segmentation on ScanNet.
//!
//! The definition is that of ScanNet's benchmark (`BenchmarkScripts/3d_evaluation/evaluate_semantic_instance.py` of
//! github.com/ScanNet/ScanNet), with one class for all instances. It differs from the usual average precision: small
//! instances are left out, predictions on unlabelled vertices are ignored, and the curve is integrated by the
//! trapezoidal rule with a last point at precision 1 and recall 0.

use crate::MetricsError;
use serde::{Deserialize, Serialize};
use splatseg_geometry::SegmentId;
use std::collections::BTreeMap;

/// True and predicted instances with fewer vertices are ignored.
pub const MIN_INSTANCE_VERTICES: usize = 100;
/// Number of IoU thresholds of AP: 0.5, 0.55, …, 0.9.
const AP_STEPS: u8 = 9;

/// A predicted instance.
#[derive(Clone, Debug, PartialEq)]
pub struct PredictedInstance {
    /// Confidence. Only the order matters.
    pub confidence: f32,
    /// Indices of the vertices, each once. Instances may overlap.
    pub vertices: Vec<usize>,
}

/// Average precisions in percent. `None` without true instances.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct InstanceScores {
    /// Mean over IoU thresholds of 0.5, 0.55, …, 0.9.
    pub ap: Option<f64>,
    /// AP at an IoU threshold of 0.5.
    pub ap50: Option<f64>,
    /// AP at an IoU threshold of 0.25.
    pub ap25: Option<f64>,
}

/// Collects the matches of scenes and scores all scenes together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InstanceScorer {
    thresholds: Vec<Matches>,
    has_truth: bool,
    has_predictions: bool,
}

/// The matches at one IoU threshold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Matches {
    iou: f64,
    /// Confidence of each prediction that counts, and true if it is correct.
    predictions: Vec<(f32, bool)>,
    /// Number of true instances without a match.
    missed: usize,
}

/// A true instance.
struct Truth {
    /// Number of vertices.
    vertices: usize,
    /// Index of each overlapping prediction, increasing, and the number of shared vertices.
    overlaps: Vec<(usize, usize)>,
}

/// A scene's instances that are large enough to count.
struct SceneOverlaps<'p> {
    truths: Vec<Truth>,
    predictions: Vec<&'p PredictedInstance>,
    /// Number of unlabelled vertices in each prediction. Vertices of true instances that are too small count as
    /// unlabelled.
    ignored: Vec<usize>,
}

impl Default for InstanceScorer {
    fn default() -> Self {
        let ious = (0..AP_STEPS).map(|step| 0.5 + f64::from(step) * 0.05).chain([0.25]);
        let matches = |iou| Matches { iou, predictions: Vec::new(), missed: 0 };
        Self { thresholds: ious.map(matches).collect(), has_truth: false, has_predictions: false }
    }
}

impl InstanceScorer {
    /// Adds a scene. `truth` contains the true instance of each vertex, 0 if unlabelled.
    ///
    /// # Errors
    /// [`MetricsError::NoSuchVertex`] if a vertex of a prediction is out of range. Nothing is added then.
    pub fn add_scene(&mut self, truth: &[SegmentId], predictions: &[PredictedInstance]) -> Result<(), MetricsError> {
        for prediction in predictions {
            if let Some(vertex) = prediction.vertices.iter().find(|vertex| **vertex >= truth.len()) {
                return Err(MetricsError::NoSuchVertex { vertex: *vertex, vertices: truth.len() });
            }
        }
        let scene = SceneOverlaps::new(truth, predictions);
        self.has_truth |= !scene.truths.is_empty();
        self.has_predictions |= !scene.predictions.is_empty();
        self.thresholds.iter_mut().for_each(|matches| matches.add(&scene));
        Ok(())
    }

    /// Adds the scenes of another scorer.
    pub fn merge(&mut self, other: &Self) {
        self.has_truth |= other.has_truth;
        self.has_predictions |= other.has_predictions;
        for (own, more) in self.thresholds.iter_mut().zip(&other.thresholds) {
            own.predictions.extend_from_slice(&more.predictions);
            own.missed += more.missed;
        }
    }

    /// The scores of all scenes so far.
    pub fn scores(&self) -> InstanceScores {
        let precisions: Vec<f64> = self.thresholds.iter().map(Matches::average_precision).collect();
        let score = |precisions: &[f64]| {
            let mean = precisions.iter().sum::<f64>() / precisions.len() as f64;
            self.has_truth.then_some(if self.has_predictions { 100.0 * mean } else { 0.0 })
        };
        let (ap, ap25) = precisions.split_at(usize::from(AP_STEPS));
        InstanceScores { ap: score(ap), ap50: score(&ap[..1]), ap25: score(ap25) }
    }
}

impl<'p> SceneOverlaps<'p> {
    fn new(truth: &[SegmentId], predictions: &'p [PredictedInstance]) -> Self {
        let mut areas: BTreeMap<SegmentId, usize> = BTreeMap::new();
        truth.iter().filter(|id| **id != 0).for_each(|id| *areas.entry(*id).or_default() += 1);
        areas.retain(|_, area| *area >= MIN_INSTANCE_VERTICES);
        let large = |prediction: &&PredictedInstance| prediction.vertices.len() >= MIN_INSTANCE_VERTICES;
        let predictions: Vec<&PredictedInstance> = predictions.iter().filter(large).collect();
        let mut truths: BTreeMap<SegmentId, Truth> =
            areas.into_iter().map(|(id, vertices)| (id, Truth { vertices, overlaps: Vec::new() })).collect();
        let mut ignored = vec![0; predictions.len()];
        for (index, prediction) in predictions.iter().enumerate() {
            let mut shared: BTreeMap<SegmentId, usize> = BTreeMap::new();
            prediction.vertices.iter().for_each(|vertex| *shared.entry(truth[*vertex]).or_default() += 1);
            for (id, count) in shared {
                match truths.get_mut(&id) {
                    Some(truth) => truth.overlaps.push((index, count)),
                    None => ignored[index] += count,
                }
            }
        }
        Self { truths: truths.into_values().collect(), predictions, ignored }
    }

    /// IoU of a true instance and an overlapping prediction.
    fn iou(&self, truth: &Truth, (prediction, shared): (usize, usize)) -> f64 {
        shared as f64 / (truth.vertices + self.predictions[prediction].vertices.len() - shared) as f64
    }
}

impl Matches {
    fn add(&mut self, scene: &SceneOverlaps<'_>) {
        // True instances are matched in order. A prediction matches at most one of them.
        let mut is_taken = vec![false; scene.predictions.len()];
        let mut has_match = vec![false; scene.predictions.len()];
        for truth in &scene.truths {
            let mut best: Option<f32> = None;
            for overlap in truth.overlaps.iter().filter(|overlap| scene.iou(truth, **overlap) > self.iou) {
                has_match[overlap.0] = true;
                if is_taken[overlap.0] {
                    continue;
                }
                let confidence = scene.predictions[overlap.0].confidence;
                match &mut best {
                    None => {
                        best = Some(confidence);
                        is_taken[overlap.0] = true;
                    }
                    // Of two predictions for one instance, the less confident one is wrong.
                    Some(best) => {
                        self.predictions.push((best.min(confidence), false));
                        *best = best.max(confidence);
                    }
                }
            }
            match best {
                Some(confidence) => self.predictions.push((confidence, true)),
                None => self.missed += 1,
            }
        }
        for (index, prediction) in scene.predictions.iter().enumerate().filter(|(index, _)| !has_match[*index]) {
            if scene.ignored[index] as f64 / prediction.vertices.len() as f64 <= self.iou {
                self.predictions.push((prediction.confidence, false));
            }
        }
    }

    /// The area under the precision-recall curve, from 0 to 1.
    fn average_precision(&self) -> f64 {
        let mut sorted = self.predictions.clone();
        sorted.sort_by(|left, right| right.0.total_cmp(&left.0));
        let total_right = sorted.iter().filter(|(_, is_right)| *is_right).count();
        let true_instances = (total_right + self.missed) as f64;
        // By decreasing confidence, so recall rises from 0.
        let (mut points, mut right, mut taken) = (vec![(0.0, 1.0)], 0, 0);
        for same in sorted.chunk_by(|left, right| left.0 == right.0) {
            right += same.iter().filter(|(_, is_right)| *is_right).count();
            taken += same.len();
            points.push((right as f64 / true_instances.max(1.0), right as f64 / taken as f64));
        }
        // The trapezoidal rule. The end points get half of the first and the last interval.
        let recall = |place: usize| points[place.min(points.len() - 1)].0;
        let width = |place: usize| 0.5 * (recall(place + 1) - if place == 0 { 0.0 } else { recall(place - 1) });
        points.iter().enumerate().map(|(place, (_, precision))| precision * width(place)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of 100 vertices, with `truth[i]` for the vertices of block i.
    fn blocks(truth: &[SegmentId]) -> Vec<SegmentId> {
        truth.iter().flat_map(|id| std::iter::repeat_n(*id, 100)).collect()
    }

    fn prediction(confidence: f32, blocks: std::ops::Range<usize>) -> PredictedInstance {
        PredictedInstance { confidence, vertices: (100 * blocks.start..100 * blocks.end).collect() }
    }

    fn scores(truth: &[SegmentId], predictions: &[PredictedInstance]) -> InstanceScores {
        let mut scorer = InstanceScorer::default();
        scorer.add_scene(&blocks(truth), predictions).unwrap();
        scorer.scores()
    }

    #[test]
    fn perfect_and_missing_predictions() {
        let perfect = [prediction(0.9, 0..1), prediction(0.2, 1..3)];
        let all = InstanceScores { ap: Some(100.0), ap50: Some(100.0), ap25: Some(100.0) };
        assert_eq!(scores(&[1, 2, 2], &perfect), all);
        let none = InstanceScores { ap: Some(0.0), ap50: Some(0.0), ap25: Some(0.0) };
        assert_eq!(scores(&[1, 2, 2], &[]), none);
        assert_eq!(scores(&[0, 0], &perfect[..1]), InstanceScores { ap: None, ap50: None, ap25: None });
    }

    #[test]
    fn merged_scorers_of_single_scenes_equal_one_of_all_scenes() {
        let scenes = [
            (blocks(&[1, 2, 2]), vec![prediction(0.9, 0..1), prediction(0.2, 1..2)]),
            (blocks(&[5, 0, 6]), vec![prediction(0.7, 2..3), prediction(0.8, 0..2)]),
            (blocks(&[1]), Vec::new()),
        ];
        let (mut together, mut merged) = (InstanceScorer::default(), InstanceScorer::default());
        for (truth, predictions) in &scenes {
            together.add_scene(truth, predictions).unwrap();
            let mut single = InstanceScorer::default();
            single.add_scene(truth, predictions).unwrap();
            merged.merge(&serde_json::from_str(&serde_json::to_string(&single).unwrap()).unwrap());
        }
        assert_eq!(merged, together);
        assert!(merged.scores().ap50.is_some_and(|ap| ap > 10.0 && ap < 90.0), "{:?}", merged.scores());
    }

    #[test]
    fn small_and_unlabelled_parts_are_ignored() {
        let mut scorer = InstanceScorer::default();
        let mut truth = blocks(&[1, 0]);
        truth.extend(std::iter::repeat_n(7, MIN_INSTANCE_VERTICES - 1));
        // Predictions on the instance, on unlabelled vertices, on the too small instance, and a too small prediction.
        let small = PredictedInstance { confidence: 1.0, vertices: (0..MIN_INSTANCE_VERTICES - 1).collect() };
        let on_small = PredictedInstance { confidence: 0.9, vertices: (190..299).collect() };
        scorer.add_scene(&truth, &[prediction(0.5, 0..1), prediction(0.9, 1..2), on_small, small]).unwrap();
        assert_eq!(scorer.scores().ap, Some(100.0));
    }

    #[test]
    fn vertices_must_exist() {
        let mut scorer = InstanceScorer::default();
        let error = scorer.add_scene(&blocks(&[1]), &[prediction(1.0, 0..2)]).unwrap_err();
        assert!(matches!(error, MetricsError::NoSuchVertex { vertex: 100, vertices: 100 }), "{error}");
        assert_eq!(scorer.scores().ap, None);
    }
}
