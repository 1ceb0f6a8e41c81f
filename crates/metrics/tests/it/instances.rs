//! Comparison of 3D instance scores with ScanNet's own script; see `tools/make_instance_test_data.py`.

use serde::Deserialize;
use splatseg_metrics::{InstanceScorer, PredictedInstance};
use std::fs::File;

#[derive(Deserialize)]
struct Set {
    scenes: Vec<Scene>,
    /// AP, AP50 and AP25, percent.
    scores: [Option<f64>; 3],
}

#[derive(Deserialize)]
struct Scene {
    /// Runs of vertices: id and length.
    truth: Vec<(u32, usize)>,
    predictions: Vec<Prediction>,
}

#[derive(Deserialize)]
struct Prediction {
    confidence: f32,
    ranges: Vec<(usize, usize)>,
}

#[test]
fn scores_are_those_of_scannets_script() {
    let file = File::open(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/instances.json")).unwrap();
    let sets: Vec<Set> = serde_json::from_reader(file).unwrap();
    assert!(sets.len() >= 40);
    for (number, set) in sets.iter().enumerate() {
        let mut scorer = InstanceScorer::default();
        for scene in &set.scenes {
            let truth: Vec<u32> = scene.truth.iter().flat_map(|(id, count)| std::iter::repeat_n(*id, *count)).collect();
            let instance = |prediction: &Prediction| {
                let mut vertices: Vec<usize> = prediction.ranges.iter().flat_map(|(start, end)| *start..*end).collect();
                vertices.sort_unstable();
                vertices.dedup();
                PredictedInstance { confidence: prediction.confidence, vertices }
            };
            let predictions: Vec<PredictedInstance> = scene.predictions.iter().map(instance).collect();
            scorer.add_scene(&truth, &predictions).unwrap();
        }
        let found = scorer.scores();
        for (name, found, expected) in
            [("AP", found.ap, set.scores[0]), ("AP50", found.ap50, set.scores[1]), ("AP25", found.ap25, set.scores[2])]
        {
            let (found, expected) = (found.unwrap_or(f64::NAN), expected.unwrap_or(f64::NAN));
            let is_same = (found - expected).abs() < 1e-9 || found.is_nan() && expected.is_nan();
            assert!(is_same, "set {number}: {name} is {found}, expected {expected}");
        }
    }
}
