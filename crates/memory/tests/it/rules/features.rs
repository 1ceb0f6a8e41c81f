//! Learning of the paper's memory.

use super::run::{Run, features, kinds, recalled};
use super::scene::{SIZE, Scene, WALL};
use splatseg_geometry::SegmentMap;
use splatseg_memory::{Codebook, SplatContent, SplatFile};

/// Shows a wall as one segment in ten frames, then as another in `frames` frames. Returns the share of the wall that
/// the memory shows as the other segment after each of the latter.
fn shares_turned(direction_learning_rate: f32, frames: usize) -> Vec<f32> {
    let shot = Scene::wall().seen_from_origin();
    let other = SegmentMap::filled(shot.truth.width(), shot.truth.height(), 2);
    let settings = features().with(|settings| settings.direction_learning_rate = direction_learning_rate);
    let mut run = Run::new(settings);
    run.show_times(&shot, 10);
    assert!(recalled(&run.expected(&shot), &shot.truth, WALL) > 0.99);
    let turned = |_| {
        run.show_as(&shot, &other);
        recalled(&run.expected(&shot), &other, 2)
    };
    (0..frames).map(turned).collect()
}

#[test]
fn an_id_turns_within_the_steps_of_a_frame_at_the_papers_rate() {
    let turned = shares_turned(0.5, 1);
    assert!(turned[0] > 0.99, "aligned with the current frame's predictions for use at the next step: {turned:?}");
}

#[test]
fn one_wrong_frame_does_not_turn_an_id_at_the_default_rate() {
    let turned = shares_turned(features().direction_learning_rate, 10);
    println!("{turned:?}");
    assert!(turned[0] < 0.01, "after one frame: {turned:?}");
    assert!(turned[9] > 0.99, "after ten: {turned:?}");
}

#[test]
fn without_steps_an_id_does_not_turn() {
    let shot = Scene::wall().seen_from_origin();
    let other = SegmentMap::filled(shot.truth.width(), shot.truth.height(), 2);
    let mut run = Run::new(features().with(|settings| settings.num_steps = 0));
    run.show_times(&shot, 10);
    run.show_as(&shot, &other);
    assert_eq!(recalled(&run.expected(&shot), &other, 2), 0.0);
}

#[test]
fn the_pixels_of_new_gaussians_are_learnt_only_with_learn_new() {
    let shot = Scene::wall().seen_from_origin();
    let learnt = |learn_new: bool| {
        let settings = features().with(|settings| {
            settings.learn_new = learn_new;
            settings.active_tolerance = -1.0;
        });
        Run::new(settings).show(&shot).update.learning.active_pixels
    };
    assert_eq!(learnt(false), 0, "all Gaussians are new");
    assert_eq!(learnt(true), shot.truth.pixels().len());
}

/// Features and codebook in the file of a memory.
fn saved(run: &Run) -> (Vec<f32>, Codebook) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.ply");
    run.memory.save(&path).unwrap();
    match SplatFile::load(&path).unwrap().content {
        SplatContent::Features { features, codebook } => (features, codebook),
        _ => panic!("a memory of features"),
    }
}

#[test]
fn a_new_gaussian_of_a_fading_segment_has_its_remaining_confidence() {
    for feature_dim in [8, 1] {
        let mut run = Run::new(features().with(|settings| settings.feature_dim = feature_dim));
        let wall = Scene::wall().seen_from_origin();
        run.show_as(&wall, &wall.truth.map(|_| 2));
        let known = run.memory.gaussian_count();
        // Half a metre nearer, without a prediction. Each pixel gets a Gaussian.
        let mut nearer = wall.clone();
        nearer.depth.pixels_mut().fill(2.5);
        let confidence = run.memory.recall(&nearer.frame()).expected().confidence.clone();
        assert_eq!(run.show_as(&nearer, &nearer.truth.map(|_| 0)).update.grown, known);
        let (features, _) = saved(&run);
        for (feature, confidence) in features[known * feature_dim..].chunks_exact(feature_dim).zip(confidence.pixels())
        {
            let found = feature.iter().map(|value| value * value).sum::<f32>().sqrt();
            // An integer id has no confidence.
            let expected = if feature_dim == 1 { 2.0 } else { confidence - 0.1 };
            assert!((found - expected).abs() < 1e-4, "D = {feature_dim}: {found} instead of {expected}");
        }
    }
}

#[test]
fn codes_are_added_when_all_are_used() {
    let mut run = Run::new(features());
    let codes = |run: &Run| (run.memory.segment_count(), saved(run).1.len());
    (0..16).for_each(|_| _ = run.memory.new_segment().unwrap());
    assert_eq!(codes(&run), (16, 16));
    run.memory.new_segment().unwrap();
    assert_eq!(codes(&run), (17, 32));
}

#[test]
fn a_gaussian_has_seven_numbers_and_its_feature() {
    for feature_dim in [1, 8] {
        let mut run = Run::new(features().with(|settings| settings.feature_dim = feature_dim));
        run.show(&Scene::wall().seen_from_origin());
        assert_eq!(run.memory.map().parameter_count(), (7 + feature_dim) * run.memory.gaussian_count());
        assert!(run.memory.map().segment_shares().iter().all(|share| *share == 1.0), "no second opinion is kept");
    }
}

#[test]
fn the_confidence_is_the_remaining_length_of_a_feature() {
    let mut run = Run::new(features());
    let shot = Scene::wall().seen_from_origin();
    let middle = (SIZE.0 / 2, SIZE.1 / 2);
    let confidence = |run: &Run| run.memory.recall(&shot.frame()).expected().confidence[middle];
    run.show(&shot);
    let fresh = confidence(&run);
    assert!((0.95..=1.0).contains(&fresh), "{fresh}");
    run.show_as(&shot, &shot.truth.map(|_| 0));
    let faded = confidence(&run);
    assert!((fresh - faded - 0.1).abs() < 0.02, "{faded} after {fresh}");
}

#[test]
fn gaussians_of_the_map_equal_the_saved_ones() {
    for settings in kinds() {
        let mut run = Run::new(settings);
        run.show_times(&Scene::boxes().seen_from_origin(), 2);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("map.ply");
        run.memory.save(&path).unwrap();
        let saved: Vec<_> = SplatFile::load(&path).unwrap().gaussians().collect();
        assert!(saved.len() > 100 && run.memory.map().gaussians() == saved);
    }
}
