//! FastSPAM: a point per segment finds the segment again in the next frame.

use glam::{Mat4, Vec3};
use splatseg_dataset::{Framing, Scene, SyntheticScene};
use splatseg_geometry::{Image, Intrinsics, Mask, Pose, RgbdFrame, ScoredMask};
use splatseg_segmenter::Segmenter;
use splatseg_simulators::{OracleSegmenter, OracleSettings, SceneGroundTruth};
use splatseg_test_scenes::{grey_frame, room, wall};
use splatseg_tracking::{
    FastSamBaseline, FastSamBaselineSettings, FastSpamBaseline, FastSpamBaselineSettings, FrameOutput, Method,
    TrackingError,
};
use std::collections::BTreeMap;
use std::sync::Arc;

const WIDTH: usize = 60;
const HEIGHT: usize = 20;
const CAMERA: Intrinsics = Intrinsics { fx: 40.0, fy: 40.0, cx: 30.0, cy: 10.0, width: WIDTH, height: HEIGHT };

/// A frame from a camera moved to the left, so that objects 2 m away appear `columns` pixels farther to the right.
fn frame_with_depth(columns: f32, depth: impl FnMut(usize, usize) -> f32) -> RgbdFrame<'static> {
    let pose =
        Pose::from_matrix((Mat4::from_translation(Vec3::new(-columns * 2.0 / 40.0, 0.3, -0.1))).as_dmat4()).unwrap();
    grey_frame("0", CAMERA, Image::from_fn(WIDTH, HEIGHT, depth), pose)
}

/// The same frame of a wall 2 m ahead.
fn frame(columns: f32) -> RgbdFrame<'static> {
    frame_with_depth(columns, |_, _| 2.0)
}

fn mask(inside: impl Fn(usize, usize) -> bool) -> ScoredMask {
    ScoredMask { mask: Mask::from_fn(WIDTH, HEIGHT, inside), score: 1.0 }
}

fn stripe(from: usize, to: usize) -> ScoredMask {
    mask(|column, _| (from..to).contains(&column))
}

/// Settings that accept masks of any size.
fn settings() -> FastSpamBaselineSettings {
    FastSpamBaselineSettings::default().with(|settings| settings.min_area = 0)
}

fn fastspam() -> FastSpamBaseline {
    FastSpamBaseline::new(settings(), 0).unwrap()
}

fn fastsam() -> FastSamBaseline {
    FastSamBaseline::new(FastSamBaselineSettings::default().with(|settings| settings.min_area = 0)).unwrap()
}

/// Id and width of each stripe.
fn found(output: &FrameOutput) -> Vec<(u32, usize)> {
    output.masks.iter().map(|(id, mask)| (*id, mask.area() / HEIGHT)).collect()
}

#[test]
fn points_follow_the_camera_where_overlap_is_lost() {
    // Both stripes move by 15 columns, so the first is now in the place of the second.
    let masks = [[stripe(4, 12), stripe(19, 26)], [stripe(19, 27), stripe(34, 41)]];
    let mut method = fastspam();
    assert_eq!(found(&method.process_masks(&frame(0.0), &masks[0]).unwrap()), [(1, 8), (2, 7)]);
    assert_eq!(found(&method.process_masks(&frame(15.0), &masks[1]).unwrap()), [(1, 8), (2, 7)]);
    let mut by_overlap = fastsam();
    by_overlap.process_masks(&frame(0.0), &masks[0]).unwrap();
    assert_eq!(by_overlap.process_masks(&frame(15.0), &masks[1]).unwrap().masks[0].0, 2, "overlap confuses them");
}

#[test]
fn points_outside_the_image_or_without_depth_are_dropped() {
    let mut method = fastspam();
    method.process_masks(&frame(0.0), &[stripe(4, 12), stripe(50, 57)]).unwrap();
    // The second leaves the view to the right; the stripe at the edge is new.
    assert_eq!(
        found(&method.process_masks(&frame(15.0), &[stripe(19, 27), stripe(55, 60)]).unwrap()),
        [(1, 8), (3, 5)]
    );

    let mut method = fastspam();
    let hole = |column, _| if column < 30 { 0.0 } else { 2.0 };
    method.process_masks(&frame_with_depth(0.0, hole), &[stripe(4, 12), stripe(40, 47)]).unwrap();
    assert_eq!(found(&method.process_masks(&frame(0.0), &[stripe(4, 12), stripe(40, 47)]).unwrap()), [(3, 8), (2, 7)]);
}

#[test]
fn a_missed_segment_is_forgotten() {
    let mut method = fastspam();
    method.process_masks(&frame(0.0), &[stripe(4, 12), stripe(40, 47)]).unwrap();
    assert_eq!(found(&method.process_masks(&frame(0.0), &[stripe(4, 12)]).unwrap()), [(1, 8)]);
    assert_eq!(found(&method.process_masks(&frame(0.0), &[stripe(4, 12), stripe(40, 47)]).unwrap()), [(1, 8), (3, 7)]);
    assert!(found(&method.process_masks(&frame(0.0), &[]).unwrap()).is_empty());
    assert_eq!(found(&method.process_masks(&frame(0.0), &[stripe(4, 12)]).unwrap()), [(4, 8)]);
}

#[test]
fn a_point_stands_for_the_union_of_its_masks_and_agreeing_masks_are_merged() {
    let mut method = fastspam();
    method.process_masks(&frame(0.0), &[stripe(0, 20), stripe(30, 36)]).unwrap();
    // The point of the first, column 10, is on two masks.
    let output = method.process_masks(&frame(0.0), &[stripe(0, 16), stripe(8, 20), stripe(30, 36)]).unwrap();
    assert_eq!(found(&output), [(1, 20), (2, 6)]);

    // Two points on the same mask: the mask of the later point, from the smaller segment, agrees with the earlier one.
    let mut method = fastspam();
    method.process_masks(&frame(0.0), &[stripe(0, 10), stripe(10, 16)]).unwrap();
    let output = method.process_masks(&frame(0.0), &[stripe(0, 16), stripe(40, 44)]).unwrap();
    assert_eq!(found(&output), [(1, 16), (3, 4)]);
    assert_eq!(output.segments[(12, 3)], 1);
}

#[test]
fn masks_that_prompts_do_not_cover_are_new() {
    let mut method = fastspam();
    method.process_masks(&frame(0.0), &[stripe(0, 20)]).unwrap();
    // The point, column 10, selects the first mask, which covers 9 of the 10 columns of the second and 8 of the third.
    // The centroid of the third, column 17, is on all three: its prompt is their union, and agrees with the first.
    let output = method.process_masks(&frame(0.0), &[stripe(0, 20), stripe(11, 21), stripe(12, 22)]).unwrap();
    assert_eq!(found(&output), [(1, 22)]);
    let output = method.process_masks(&frame(0.0), &[stripe(0, 20), stripe(17, 37)]).unwrap();
    assert_eq!(found(&output), [(1, 20), (2, 20)]);
    assert_eq!(output.segments[(18, 0)], 2, "of equally large masks, the later is on top");
}

#[test]
fn masks_that_do_not_contain_their_centroid_get_a_random_pixel() {
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
        let mut method = FastSpamBaseline::new(settings(), seed).unwrap();
        method.process_masks(&frame(0.0), &[ring(0), core(0)]).unwrap();
        method.process_masks(&frame(12.0), &[ring(12), core(12)]).unwrap().masks
    };
    for seed in 0..5 {
        let masks = run(seed);
        assert_eq!(masks, [(1, ring(12).mask), (2, core(12).mask)]);
        assert_eq!(masks, run(seed));
    }
}

#[test]
fn points_are_dropped_as_soon_as_they_leave_the_image() {
    // Objects 2 m away appear this much farther to the right and farther down.
    let moved = |columns: f32, rows: f32| {
        let position = Vec3::new(-columns * 2.0 / 40.0, -rows * 2.0 / 40.0, 0.0);
        wall("0", CAMERA, 2.0, Pose::from_matrix(Mat4::from_translation(position).as_dmat4()).unwrap())
    };
    // Their points are the pixels (8, 4) and (51, 15).
    let block = |left: usize, top: usize| {
        mask(move |column, row| (left..left + 3).contains(&column) && (top..top + 3).contains(&row))
    };
    for (columns, rows, is_inside) in [(8, 0, true), (9, 0, false), (0, 4, true), (0, 5, false), (8, 4, true)] {
        let mut method = fastspam();
        method.process_masks(&moved(0.0, 0.0), &[block(7, 3), block(50, 14)]).unwrap();
        let corner = mask(|column, row| column >= 50 + columns && row >= 14 + rows);
        let seen = [block(7 + columns, 3 + rows), corner];
        let output = method.process_masks(&moved(columns as f32, rows as f32), &seen).unwrap();
        let mut ids: Vec<u32> = output.masks.iter().map(|(id, _)| *id).collect();
        ids.sort_unstable();
        assert_eq!(ids, if is_inside { [1, 2] } else { [1, 3] }, "by {columns} columns and {rows} rows");
    }
}

#[test]
fn a_pixel_without_depth_is_not_a_point_at_the_camera() {
    let mut method = fastspam();
    method.process_masks(&frame_with_depth(0.0, |_, _| 0.0), &[stripe(40, 47)]).unwrap();
    // The old camera position is now in front of the camera, in the middle of the image.
    let back = Pose::from_matrix(Mat4::from_translation(Vec3::new(0.0, 0.3, -1.1)).as_dmat4()).unwrap();
    let frame = wall("1", CAMERA, 2.0, back);
    assert_eq!(found(&method.process_masks(&frame, &[stripe(28, 33)]).unwrap()), [(2, 5)]);
}

#[test]
fn masks_that_segments_cover_are_not_new() {
    // A mask of bars, 8 rows high, above the points of two stripes. The bar between the stripes contains its centroid.
    let new_ids = |bar: &[std::ops::Range<usize>]| {
        let mut method = fastspam();
        method.process_masks(&frame(0.0), &[stripe(10, 20), stripe(30, 40)]).unwrap();
        let bar = mask(|column, row| row < 8 && bar.iter().any(|part| part.contains(&column)));
        let output = method.process_masks(&frame(0.0), &[stripe(10, 20), stripe(30, 40), bar]).unwrap();
        output.masks.iter().filter(|(id, _)| *id > 2).count()
    };
    assert_eq!(new_ids(&[10..20, 24..25, 30..39]), 0, "19 of 20 columns are covered");
    assert_eq!(new_ids(&[11..20, 24..26, 30..39]), 0, "18 of 20: the fraction itself is enough");
    assert_eq!(new_ids(&[11..20, 23..26, 31..39]), 1, "17 of 20");
}

#[test]
fn a_prompted_mask_is_merged_with_the_most_similar_segment() {
    let mut method = fastspam();
    method.process_masks(&frame(0.0), &[stripe(0, 10), stripe(20, 26), stripe(26, 30)]).unwrap();
    // The points of the last two are on one mask.
    let output = method.process_masks(&frame(0.0), &[stripe(0, 10), stripe(20, 30)]).unwrap();
    assert_eq!(found(&output), [(1, 10), (2, 10)]);
}

#[test]
fn the_confidence_is_the_score_of_the_mask() {
    let scored = |from: usize, to: usize, score: f32| ScoredMask { score, ..stripe(from, to) };
    let output = fastspam().process_masks(&frame(0.0), &[scored(0, 20, 0.75), scored(30, 35, 0.5)]).unwrap();
    assert_eq!([5, 25, 32].map(|column| output.confidence[(column, 3)]), [0.75, 0.0, 0.5]);
}

#[test]
fn settings_are_checked() {
    for (agreement_iou, covered_fraction) in [(0.0, 0.9), (0.9, 1.1), (f64::NAN, 0.9)] {
        let settings = FastSpamBaselineSettings::default().with(|settings| {
            settings.agreement_iou = agreement_iou;
            settings.covered_fraction = covered_fraction;
        });
        assert!(matches!(FastSpamBaseline::new(settings, 0), Err(TrackingError::Setting(_))));
    }
}

/// Returns the number of ids that stay with their object from one frame to the next, and the number that switch to
/// another object.
fn kept_and_lost(method: &mut dyn Method, segmenter: &mut dyn Segmenter, scene: &SyntheticScene) -> (usize, usize) {
    let mut object_of: BTreeMap<u32, u32> = BTreeMap::new();
    let (mut kept, mut lost) = (0, 0);
    for index in 0..scene.frame_count() {
        let truth = scene.read_ground_truth(index).unwrap().unwrap();
        let frame = scene.read_frame(index).unwrap();
        let output = method.process_masks(&frame, &segmenter.segment(&frame).unwrap().masks).unwrap();
        let mut now = BTreeMap::new();
        for (id, mask) in &output.masks {
            // Masks are exact, so any pixel identifies the object.
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

/// In the synthetic room with exact masks, an id stays with its object unless its point is occluded, and more ids stay
/// than by overlap alone.
#[test]
fn it_keeps_objects_of_the_synthetic_room() {
    let scene = Arc::new(room("synthetic:width=160,height=120,frames=12"));
    let truth = SceneGroundTruth::new(scene.clone(), Framing::default()).unwrap();
    let mut oracle = OracleSegmenter::new(truth, &OracleSettings::default(), 0).unwrap();
    let (kept, lost) = kept_and_lost(&mut fastspam(), &mut oracle, &scene);
    assert!(kept > 20 * lost, "{kept} kept, {lost} switched");
    let (kept_by_overlap, lost_by_overlap) = kept_and_lost(&mut fastsam(), &mut oracle, &scene);
    assert!(kept > kept_by_overlap, "{kept} kept by points, {kept_by_overlap} by overlap");
    assert!(lost < lost_by_overlap, "{lost} switched by points, {lost_by_overlap} by overlap");
}
