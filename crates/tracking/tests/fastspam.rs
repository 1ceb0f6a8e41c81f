//! FastSPAM: a point of every segment finds it again in the next frame.

use glam::{Mat4, Vec3};
use splatseg_dataset::{Framing, Scene, SyntheticScene, SyntheticSettings};
use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame, ScoredMask};
use splatseg_segmenter::{OracleSegmenter, OracleSettings, SceneGroundTruth, Segmenter, SegmenterError};
use splatseg_tracking::{FastSam, FastSamSettings, FastSpam, FastSpamSettings, FrameOutput, Method, TrackingError};
use std::collections::BTreeMap;
use std::sync::Arc;

/// For feeding masks to `track`.
struct Unused;

impl Segmenter for Unused {
    fn name(&self) -> &str {
        "unused"
    }
    fn segment(&mut self, _: &RgbdFrame) -> Result<Vec<ScoredMask>, SegmenterError> {
        Ok(Vec::new())
    }
}

const WIDTH: usize = 60;
const HEIGHT: usize = 20;

/// Seen by a camera so far to the left that things 2 m away appear `columns` pixels farther to the right.
fn frame_with_depth(columns: f32, depth: impl FnMut(usize, usize) -> f32) -> RgbdFrame<'static> {
    let camera = Intrinsics { fx: 40.0, fy: 40.0, cx: 30.0, cy: 10.0, width: WIDTH, height: HEIGHT };
    let pose = Pose::from_matrix(Mat4::from_translation(Vec3::new(-columns * 2.0 / 40.0, 0.3, -0.1))).unwrap();
    let (color, depth) = (Image::filled(WIDTH, HEIGHT, [0; 3]), Image::from_fn(WIDTH, HEIGHT, depth));
    RgbdFrame::new("0", color, depth, camera, pose).unwrap()
}

/// A wall 2 m ahead.
fn frame(columns: f32) -> RgbdFrame<'static> {
    frame_with_depth(columns, |_, _| 2.0)
}

fn mask(inside: impl Fn(usize, usize) -> bool) -> ScoredMask {
    ScoredMask { mask: Mask::from_fn(WIDTH, HEIGHT, inside), score: 1.0 }
}

fn stripe(from: usize, to: usize) -> ScoredMask {
    mask(|column, _| (from..to).contains(&column))
}

fn fastspam() -> FastSpam {
    FastSpam::new(Box::new(Unused), FastSpamSettings::default()).unwrap()
}

/// Id and width of each stripe.
fn found(output: &FrameOutput) -> Vec<(u32, usize)> {
    output.masks.iter().map(|(id, mask)| (*id, mask.area() / HEIGHT)).collect()
}

#[test]
fn points_follow_the_camera_where_overlap_is_lost() {
    // Both stripes move by 15 columns: the first comes to lie where the second was.
    let masks = [[stripe(4, 12), stripe(19, 26)], [stripe(19, 27), stripe(34, 41)]];
    let mut method = fastspam();
    assert_eq!(found(&method.track(&frame(0.0), &masks[0]).unwrap()), [(1, 8), (2, 7)]);
    assert_eq!(found(&method.track(&frame(15.0), &masks[1]).unwrap()), [(1, 8), (2, 7)]);
    let mut by_overlap = FastSam::new(Box::new(Unused), FastSamSettings::default()).unwrap();
    by_overlap.track(&frame(0.0), &masks[0]).unwrap();
    assert_eq!(by_overlap.track(&frame(15.0), &masks[1]).unwrap().masks[0].0, 2, "overlap takes one for the other");
}

#[test]
fn points_outside_the_image_or_without_depth_are_dropped() {
    let mut method = fastspam();
    method.track(&frame(0.0), &[stripe(4, 12), stripe(50, 57)]).unwrap();
    // The second leaves to the right; what stands at the edge is new.
    assert_eq!(found(&method.track(&frame(15.0), &[stripe(19, 27), stripe(55, 60)]).unwrap()), [(1, 8), (3, 5)]);

    let mut method = fastspam();
    let hole = |column, _| if column < 30 { 0.0 } else { 2.0 };
    method.track(&frame_with_depth(0.0, hole), &[stripe(4, 12), stripe(40, 47)]).unwrap();
    assert_eq!(found(&method.track(&frame(0.0), &[stripe(4, 12), stripe(40, 47)]).unwrap()), [(3, 8), (2, 7)]);
}

#[test]
fn a_missed_segment_is_forgotten() {
    let mut method = fastspam();
    method.track(&frame(0.0), &[stripe(4, 12), stripe(40, 47)]).unwrap();
    assert_eq!(found(&method.track(&frame(0.0), &[stripe(4, 12)]).unwrap()), [(1, 8)]);
    assert_eq!(found(&method.track(&frame(0.0), &[stripe(4, 12), stripe(40, 47)]).unwrap()), [(1, 8), (3, 7)]);
    assert!(found(&method.track(&frame(0.0), &[]).unwrap()).is_empty());
    assert_eq!(found(&method.track(&frame(0.0), &[stripe(4, 12)]).unwrap()), [(4, 8)]);
}

#[test]
fn a_point_stands_for_all_masks_that_contain_it_and_agreeing_ones_are_united() {
    let mut method = fastspam();
    method.track(&frame(0.0), &[stripe(0, 20), stripe(30, 36)]).unwrap();
    // The first one's point, column 10, lies on two masks.
    let output = method.track(&frame(0.0), &[stripe(0, 16), stripe(8, 20), stripe(30, 36)]).unwrap();
    assert_eq!(found(&output), [(1, 20), (2, 6)]);

    // Two points on the same mask: the later one, of the smaller segment, agrees with the earlier.
    let mut method = fastspam();
    method.track(&frame(0.0), &[stripe(0, 10), stripe(10, 16)]).unwrap();
    let output = method.track(&frame(0.0), &[stripe(0, 16), stripe(40, 44)]).unwrap();
    assert_eq!(found(&output), [(1, 16), (3, 4)]);
    assert_eq!(output.segments[(12, 3)], 1);
}

#[test]
fn what_prompts_leave_uncovered_is_new() {
    let mut method = fastspam();
    method.track(&frame(0.0), &[stripe(0, 20)]).unwrap();
    // The point, column 10, picks the first mask, which covers 9 of the 10 columns of the second and 8 of the third.
    // The third one's centroid, column 17, lies on all three: its prompt is their union, and agrees with the first.
    let output = method.track(&frame(0.0), &[stripe(0, 20), stripe(11, 21), stripe(12, 22)]).unwrap();
    assert_eq!(found(&output), [(1, 22)]);
    let output = method.track(&frame(0.0), &[stripe(0, 20), stripe(17, 37)]).unwrap();
    assert_eq!(found(&output), [(1, 20), (2, 20)]);
    assert_eq!(output.segments[(18, 0)], 2, "of equally large ones the later lies on top");
}

#[test]
fn masks_without_their_centroid_get_a_random_pixel_of_theirs() {
    let ring = |shift: i32| {
        mask(move |column, row| {
            let (x, y) = (column as i32 - 20 - shift, row as i32 - 10);
            (36..81).contains(&(x * x + y * y))
        })
    };
    let core = |shift: i32| {
        mask(move |column, row| {
            let (x, y) = (column as i32 - 20 - shift, row as i32 - 10);
            x.abs() <= 1 && y.abs() <= 1
        })
    };
    let run = |seed: u64| {
        let settings = FastSpamSettings { seed, ..FastSpamSettings::default() };
        let mut method = FastSpam::new(Box::new(Unused), settings).unwrap();
        method.track(&frame(0.0), &[ring(0), core(0)]).unwrap();
        method.track(&frame(12.0), &[ring(12), core(12)]).unwrap().masks
    };
    for seed in 0..5 {
        let masks = run(seed);
        assert_eq!(masks, [(1, ring(12).mask), (2, core(12).mask)]);
        assert_eq!(masks, run(seed));
    }
}

#[test]
fn settings_are_checked() {
    for (agreement_iou, covered_share) in [(0.0, 0.9), (0.9, 1.1), (f64::NAN, 0.9)] {
        let settings = FastSpamSettings { agreement_iou, covered_share, ..FastSpamSettings::default() };
        assert!(matches!(FastSpam::new(Box::new(Unused), settings), Err(TrackingError::Share { .. })));
    }
}

/// From one frame to the next: how many ids stay with their object, and how many go to another.
fn kept_and_lost(method: &mut dyn Method, scene: &SyntheticScene) -> (usize, usize) {
    let mut object_of: BTreeMap<u32, u32> = BTreeMap::new();
    let (mut kept, mut lost) = (0, 0);
    for index in 0..scene.frame_count() {
        let truth = scene.read_ground_truth(index).unwrap().unwrap();
        let output = method.process(&scene.read_frame(index).unwrap()).unwrap();
        let mut now = BTreeMap::new();
        for (id, mask) in &output.masks {
            // Masks are exact: any pixel tells the object.
            let object = truth.pixels()[mask.pixel_indices().next().unwrap()];
            match object_of.get(id) {
                Some(before) if *before == object => kept += 1,
                Some(_) => lost += 1,
                None => {}
            }
            now.insert(*id, object);
        }
        object_of = now;
    }
    (kept, lost)
}

/// In the synthetic room, with exact masks, an id stays with its object unless something comes before its point, and
/// more stay than by overlap alone.
#[test]
fn it_keeps_objects_of_the_synthetic_room() {
    let settings = SyntheticSettings { width: 160, height: 120, frames: 12, ..SyntheticSettings::default() };
    let scene = Arc::new(SyntheticScene::new(settings).unwrap());
    let segmenter = || {
        let truth = SceneGroundTruth::new(scene.clone(), Framing::default()).unwrap();
        Box::new(OracleSegmenter::new(truth, &OracleSettings::default(), 0).unwrap())
    };
    let mut spam = FastSpam::new(segmenter(), FastSpamSettings::default()).unwrap();
    let mut sam = FastSam::new(segmenter(), FastSamSettings::default()).unwrap();
    let (kept, lost) = kept_and_lost(&mut spam, &scene);
    assert!(kept > 20 * lost, "{kept} kept, {lost} taken for another");
    let (kept_by_overlap, lost_by_overlap) = kept_and_lost(&mut sam, &scene);
    assert!(kept > kept_by_overlap, "{kept} kept by points, {kept_by_overlap} by overlap");
    assert!(lost < lost_by_overlap, "{lost} taken for another by points, {lost_by_overlap} by overlap");
}
