//! The oracle: exact without errors, each error at its own rate, independent of order and threads.

use splatseg_dataset::{
    DatasetError, DatasetSettings, FrameStream, Framing, GroundTruth, RecordedFrame, Scene, SyntheticScene,
};
use splatseg_geometry::{CameraFrame, Image, Mask, Pose, RgbdFrame, ScoredMask, SegmentMap};
use splatseg_segmenter::Segmenter;
use splatseg_simulators::{OraclePreset, OracleSegmenter, OracleSettings, SceneGroundTruth};
use splatseg_test_scenes::{camera, room, wall};
use std::collections::BTreeSet;
use std::sync::Arc;

fn frame(name: &str, size: (usize, usize)) -> RgbdFrame<'static> {
    wall(name, camera(size.0, size.1, 10.0), 1.0, Pose::IDENTITY)
}

/// The oracle's masks of `frames` frames with the same `truth`.
fn segmented(truth: &SegmentMap, settings: &OracleSettings, frames: usize) -> Vec<Vec<Mask>> {
    let labels = truth.clone();
    let mut oracle = OracleSegmenter::new(move |_: &CameraFrame| Ok(labels.clone()), settings, 7).unwrap();
    (0..frames)
        .map(|number| {
            let scored = oracle.segment(&frame(&number.to_string(), truth.size())).unwrap().masks;
            scored.into_iter().map(|scored| scored.mask).collect()
        })
        .collect()
}

/// 20 × 20 squares of 8 × 8 pixels, ids 1 to 400, with gaps of 2 pixels, so that no two touch.
fn squares() -> SegmentMap {
    SegmentMap::from_fn(200, 200, |column, row| {
        let inside = column % 10 < 8 && row % 10 < 8;
        if inside { (row / 10 * 20 + column / 10 + 1) as u32 } else { 0 }
    })
}

fn ids_under(truth: &SegmentMap, mask: &Mask) -> BTreeSet<u32> {
    mask.pixel_indices().map(|index| truth.pixels()[index]).collect()
}

fn found(truth: &SegmentMap, masks: &[Mask]) -> BTreeSet<u32> {
    masks.iter().flat_map(|mask| ids_under(truth, mask)).collect()
}

/// Asserts that `count` successes in `trials` agree with `rate` within five standard deviations.
#[track_caller]
fn assert_rate(count: usize, trials: usize, rate: f64) {
    let mean = rate * trials as f64;
    let bound = 5.0 * (mean * (1.0 - rate)).sqrt();
    assert!((count as f64 - mean).abs() < bound, "{count} of {trials}, expected {mean:.0} ± {bound:.0}");
}

fn small_room(frames: usize) -> Arc<SyntheticScene> {
    Arc::new(room(&format!("synthetic:width=96,height=72,frames={frames}")))
}

#[test]
fn without_errors_the_masks_are_the_truth_after_any_resizing_and_cropping() {
    let framings = [(None, 0, 1), (None, 5, 3), (Some("48x36"), 2, 2)];
    for (resize, crop_border, stride) in framings {
        let resize = resize.map(|text| text.parse().unwrap());
        let dataset = DatasetSettings::default().with(|settings| {
            settings.resize = resize;
            settings.crop_border = crop_border;
            settings.stride = stride;
            settings.start = 1;
        });
        let scene = small_room(8);
        let truth = SceneGroundTruth::new(scene.clone(), dataset.framing()).unwrap();
        let mut oracle = OracleSegmenter::new(truth, &OracleSettings::default(), 3).unwrap();
        let mut count = 0;
        for streamed in FrameStream::open(scene, &dataset, GroundTruth::Read).unwrap() {
            let streamed = streamed.unwrap();
            let expected = Mask::of_segments(&streamed.ground_truth.unwrap());
            let masks = oracle.segment(&streamed.frame).unwrap().masks;
            let expected: Vec<ScoredMask> =
                expected.into_iter().map(|(_, mask)| ScoredMask { mask, score: 1.0 }).collect();
            assert_eq!(masks, expected);
            count += 1;
        }
        assert!(count > 1);
    }
}

#[derive(Debug)]
struct Unlabelled;

impl Scene for Unlabelled {
    fn name(&self) -> &str {
        "attic"
    }
    fn frame_count(&self) -> usize {
        1
    }
    fn frame_name(&self, _: usize) -> String {
        "0".to_owned()
    }
    fn read_recorded(&self, _: usize) -> Result<RecordedFrame, DatasetError> {
        Ok(frame("0", (4, 3)).into())
    }
    fn has_ground_truth(&self) -> bool {
        false
    }
    fn read_ground_truth(&self, _: usize) -> Result<Option<SegmentMap>, DatasetError> {
        Ok(None)
    }
}

#[test]
fn missing_ground_truth_and_wrong_sizes_are_reported() {
    let error = SceneGroundTruth::new(Arc::new(Unlabelled), Framing::default()).unwrap_err();
    assert!(error.to_string().starts_with("attic has no ground truth, as required by the oracle segmenter"), "{error}");

    let truth = SceneGroundTruth::new(small_room(2), Framing::default()).unwrap();
    let mut oracle = OracleSegmenter::new(truth, &OracleSettings::default(), 0).unwrap();
    let error = oracle.segment(&frame("frame-000002", (96, 72))).unwrap_err();
    assert!(error.to_string().contains("no ground truth for frame frame-000002"), "{error}");
    let error = oracle.segment(&frame("frame-000001", (90, 72))).unwrap_err();
    assert_eq!(
        error.to_string(),
        "simulator: the ground truth of frame frame-000001 has 96x72 pixels, expected the frame's 90x72"
    );
}

#[test]
fn persistent_misses_persist() {
    let truth = squares();
    let settings = OracleSettings::default().with(|settings| settings.persistent_miss_rate = Some(0.3));
    let frames = segmented(&truth, &settings, 4);
    assert_rate(400 - frames[0].len(), 400, 0.3);
    assert!(frames.iter().all(|masks| *masks == frames[0]));
}

#[test]
fn misses_in_single_frames_are_independent() {
    let truth = squares();
    let settings = OracleSettings::default().with(|settings| settings.miss_rate = Some(0.2));
    let frames = segmented(&truth, &settings, 5);
    assert_rate(frames.iter().map(|masks| 400 - masks.len()).sum(), 2000, 0.2);
    let missed: Vec<BTreeSet<u32>> =
        frames.iter().map(|masks| (1..=400).filter(|id| !found(&truth, masks).contains(id)).collect()).collect();
    assert_rate(missed[0].intersection(&missed[1]).count(), 400, 0.04);
    assert!(frames.iter().flatten().all(|mask| mask.area() == 64), "what is found is exact");
}

#[test]
fn split_objects_are_found_in_pieces() {
    let truth = squares();
    for persistence in [0.0, 0.5, 1.0] {
        let settings = OracleSettings::default().with(|settings| {
            settings.split_rate = Some(0.3);
            settings.persistence = Some(persistence);
        });
        let frames = segmented(&truth, &settings, 3);
        let mut split_ids = Vec::new();
        for masks in &frames {
            let mut painted = Image::filled(200, 200, 0u32);
            let mut pieces = vec![0; 401];
            for mask in masks {
                let ids = ids_under(&truth, mask);
                assert_eq!(ids.len(), 1, "a piece belongs to one object");
                pieces[*ids.first().unwrap() as usize] += 1;
                mask.pixel_indices().for_each(|index| painted.pixels_mut()[index] += 1);
            }
            assert!(painted.pixels().iter().zip(truth.pixels()).all(|(count, id)| *count == u32::from(*id > 0)));
            assert!(pieces[1..].iter().all(|count| (1..=3).contains(count)));
            split_ids.push((1..=400).filter(|id| pieces[*id] > 1).collect::<BTreeSet<usize>>());
        }
        // With full persistence, all frames use the same draw.
        let independent = if persistence == 1.0 { &split_ids[..1] } else { &split_ids[..] };
        let count = independent.iter().map(BTreeSet::len).sum();
        assert_rate(count, 400 * independent.len(), 0.3);
        assert_eq!(persistence == 1.0, frames[0] == frames[1] && frames[1] == frames[2]);
        let both = split_ids[0].intersection(&split_ids[1]).count() as f64 / 400.0;
        // One draw if both frames use the object's fixed draw, otherwise two.
        let expected = 0.3 * persistence * persistence + 0.09 * (1.0 - persistence * persistence);
        assert!((both - expected).abs() < 0.08, "{both}, expected {expected}");
    }
}

#[test]
fn only_neighbours_merge() {
    // Pairs of squares that share a side, with gaps between the pairs.
    let truth = SegmentMap::from_fn(400, 200, |column, row| {
        let inside = column % 20 < 16 && row % 10 < 8;
        if inside { (row / 10 * 40 + column / 20 * 2 + column % 20 / 8 + 1) as u32 } else { 0 }
    });
    let settings = OracleSettings::default().with(|settings| {
        settings.merge_rate = Some(0.1);
        settings.persistence = Some(0.5);
    });
    let mut merged = 0;
    let frames = segmented(&truth, &settings, 3);
    for mask in frames.iter().flatten() {
        let ids = ids_under(&truth, mask);
        assert_eq!(mask.area(), 64 * ids.len());
        if ids.len() > 1 {
            assert_eq!(ids.len(), 2);
            assert_eq!((ids.first().unwrap() - 1) / 2, (ids.last().unwrap() - 1) / 2, "of one pair");
            merged += 1;
        }
    }
    // A pair is merged if the draw of either object merges it.
    assert_rate(merged, 3 * 400, 1.0 - 0.9 * 0.9);
    assert_eq!(frames[0].len() + frames[1].len() + frames[2].len() + merged, 3 * 800);

    let alone = segmented(&squares(), &OracleSettings::default().with(|settings| settings.merge_rate = Some(1.0)), 1);
    assert_eq!(alone[0].len(), 400);
}

#[test]
fn outlines_are_displaced_by_the_given_amount() {
    let radius = 60.0f64;
    let truth = SegmentMap::from_fn(200, 200, |column, row| {
        let (x, y) = (column as f64 - 99.5, row as f64 - 99.5);
        u32::from(x * x + y * y < radius * radius)
    });
    let exact = truth.mask_of(1);
    for sigma in [1.0f32, 3.0] {
        let settings = OracleSettings::default().with(|settings| settings.boundary_jitter_px = Some(sigma));
        let frames = segmented(&truth, &settings, 20);
        let differing: usize =
            frames.iter().map(|masks| masks[0].area() + exact.area() - 2 * masks[0].intersection_area(&exact)).sum();
        // The mean of |N(0, σ)| along the whole outline is σ √(2/π).
        let expected = std::f64::consts::TAU * radius * f64::from(sigma) * (2.0 / std::f64::consts::PI).sqrt();
        let mean = differing as f64 / 20.0;
        assert!((mean / expected - 1.0).abs() < 0.2, "{mean} pixels, expected {expected}");
        assert_ne!(frames[0], frames[1]);
    }
}

#[test]
fn masks_cut_off_by_the_image_border_remain_cut_off() {
    let truth = SegmentMap::filled(60, 40, 5);
    let settings = OracleSettings::default().with(|settings| settings.boundary_jitter_px = Some(4.0));
    assert!(segmented(&truth, &settings, 5).iter().all(|masks| masks[0].area() == 2400));
}

#[test]
fn false_positives_have_the_given_rate_and_size() {
    let truth = SegmentMap::filled(300, 200, 0);
    let settings = OracleSettings::default().with(|settings| {
        settings.false_positives_per_frame = Some(2.0);
        settings.false_positive_radius_px = Some(10.0);
    });
    let frames = segmented(&truth, &settings, 200);
    let counts: Vec<usize> = frames.iter().map(Vec::len).collect();
    let mean = counts.iter().sum::<usize>() as f64 / 200.0;
    // Poisson: standard deviation √(2 / 200) = 0.1. Blobs at the image's edge may vanish.
    assert!((1.6..2.4).contains(&mean), "{mean}");
    assert!(counts.contains(&0) && counts.iter().any(|count| *count > 4));
    let mut areas: Vec<usize> = frames.iter().flatten().map(Mask::area).collect();
    areas.sort_unstable();
    let median = areas[areas.len() / 2];
    assert!((180..450).contains(&median), "{median}, expected about 314");
}

#[test]
fn small_objects_are_not_found() {
    let truth = SegmentMap::from_fn(40, 20, |column, row| if row < 10 { (column / 10 + 1) as u32 } else { 9 });
    let settings = OracleSettings::default().with(|settings| settings.min_area_px = Some(101));
    assert_eq!(segmented(&truth, &settings, 1)[0], [truth.mask_of(9)]);
    let settings = OracleSettings::default().with(|settings| settings.min_area_px = Some(100));
    assert_eq!(segmented(&truth, &settings, 1)[0].len(), 5);
}

#[test]
fn masks_do_not_depend_on_the_order_of_frames_or_on_threads() {
    let settings = OracleSettings::default().with(|settings| settings.preset = OraclePreset::FastsamLike);
    let scene = small_room(6);
    let frames: Vec<RgbdFrame<'static>> = (0..6).map(|index| scene.read_frame(index).unwrap()).collect();
    let run = |order: &[usize], threads: usize, seed: u64| {
        let truth = SceneGroundTruth::new(scene.clone(), Framing::default()).unwrap();
        let mut oracle = OracleSegmenter::new(truth, &settings, seed).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut results = vec![Vec::new(); 6];
        pool.install(|| {
            order.iter().for_each(|index| results[*index] = oracle.segment(&frames[*index]).unwrap().masks)
        });
        results
    };
    let expected = run(&[0, 1, 2, 3, 4, 5], 1, 5);
    assert_eq!(run(&[5, 3, 4, 0, 2, 1], 3, 5), expected);
    let last_alone = run(&[5], 2, 5);
    assert_eq!(last_alone[5], expected[5]);
    assert_ne!(run(&[0, 1, 2, 3, 4, 5], 1, 6), expected);
    let scores = expected.iter().flatten().map(|mask| mask.score);
    assert!(scores.clone().all(|score| (0.4..=1.0).contains(&score)));
    assert!(scores.sum::<f32>() / expected.iter().flatten().count() as f32 > 0.7);
}
