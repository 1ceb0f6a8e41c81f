//! Things at the place of others: depth cannot tell them apart, colours can.

use crate::exact_masks::{evidence, method};
use splatseg_geometry::{Image, Mask, Pose, RgbdFrame, ScoredMask, SegmentId, SegmentMap};
use splatseg_memory::MemorySettings;
use splatseg_test_scenes::camera;
use splatseg_tracking::{FastSamSplat, Method, ShownFrame};

const SIZE: (usize, usize) = (80, 60);
const WALL: [u8; 3] = [150, 140, 120];
const RED: [u8; 3] = [200, 60, 50];
const GREEN: [u8; 3] = [60, 190, 70];

/// Distances of the wall, of things before it, and of a flat thing on it.
const FAR: f32 = 2.0;
const NEAR: f32 = 1.7;
const ON_WALL: f32 = 1.96;

/// A thing of 20 × 20 pixels.
#[derive(Clone, Copy)]
struct Thing {
    left: usize,
    depth: f32,
    color: [u8; 3],
}

/// Columns at which things are.
const LEFT: usize = 10;
const RIGHT: usize = 50;

fn near(left: usize, color: [u8; 3]) -> Thing {
    Thing { left, depth: NEAR, color }
}

/// The number of the thing at each pixel from 2 on; 1 for the wall.
fn truth(things: &[Thing]) -> SegmentMap {
    SegmentMap::from_fn(SIZE.0, SIZE.1, |column, row| {
        let is_at = |thing: &Thing| (thing.left..thing.left + 20).contains(&column) && (20..40).contains(&row);
        things.iter().position(is_at).map_or(1, |index| index as u32 + 2)
    })
}

/// An image of the wall and things, with colours at this exposure.
fn frame(things: &[Thing], exposure: f32) -> RgbdFrame<'static> {
    let truth = truth(things);
    let thing = |number: u32| things.get((number as usize).wrapping_sub(2));
    let color = truth.map(|number| {
        thing(*number).map_or(WALL, |thing| thing.color).map(|value| (f32::from(value) * exposure).round() as u8)
    });
    let depth: Image<f32> = truth.map(|number| thing(*number).map_or(FAR, |thing| thing.depth));
    RgbdFrame::new("0", color, depth, camera(SIZE.0, SIZE.1, 75.0), Pose::IDENTITY).unwrap()
}

/// Processes such an image with the true masks, and returns what it shows.
fn see(method: &mut FastSamSplat, things: &[Thing], exposure: f32) -> SegmentMap {
    let masks = Mask::of_segments(&truth(things)).into_iter().map(|(_, mask)| ScoredMask { mask, score: 1.0 });
    method.process_masks(&frame(things, exposure), &masks.collect::<Vec<_>>()).unwrap().segments
}

/// The ids at the middle of both places.
fn ids(shown: &SegmentMap) -> [SegmentId; 2] {
    [LEFT, RIGHT].map(|left| shown[(left + 10, 30)])
}

/// The ids of each of `frames` images.
fn ids_of(method: &mut FastSamSplat, things: &[Thing], frames: usize) -> Vec<[SegmentId; 2]> {
    (0..frames).map(|_| ids(&see(method, things, 1.0))).collect()
}

fn without_colors() -> MemorySettings {
    evidence().with(|settings| settings.compare_colors = false)
}

#[test]
fn a_thing_in_the_place_of_another_gets_an_id_of_its_own() {
    for absent in [0, 1, 2, 3, 20] {
        let mut method = method(evidence());
        let [before, right] = ids_of(&mut method, &[near(LEFT, RED), near(RIGHT, RED)], 30)[29];
        ids_of(&mut method, &[near(RIGHT, RED)], absent);
        let after = ids_of(&mut method, &[near(RIGHT, RED), near(LEFT, GREEN)], 30);
        let [first, _] = after[0];
        assert!(first != before && first != right, "absent for {absent}: {first} was {before}");
        assert!(after.iter().all(|ids| *ids == [first, right]), "absent for {absent}: {after:?}");
    }
}

#[test]
fn without_colours_it_inherits_the_id() {
    let mut method = method(without_colors());
    let before = ids_of(&mut method, &[near(LEFT, RED)], 30)[29];
    assert_eq!(ids_of(&mut method, &[near(LEFT, GREEN)], 30)[29], before);
}

#[test]
fn things_that_are_exchanged_keep_their_ids() {
    let mut method = method(evidence());
    let [red, green] = ids_of(&mut method, &[near(LEFT, RED), near(RIGHT, GREEN)], 30)[29];
    let after = ids_of(&mut method, &[near(LEFT, GREEN), near(RIGHT, RED)], 30);
    assert!(after.iter().all(|ids| *ids == [green, red]), "{after:?} after {:?}", [red, green]);
}

#[test]
fn exchanged_things_of_one_colour_keep_the_ids_of_their_places() {
    let mut method = method(evidence());
    let things = [near(LEFT, RED), near(RIGHT, RED)];
    let before = ids_of(&mut method, &things, 10)[9];
    assert!(ids_of(&mut method, &[things[1], things[0]], 10).iter().all(|ids| *ids == before));
}

#[test]
fn a_flat_thing_on_the_wall_is_a_thing_at_once() {
    let book = Thing { left: LEFT, depth: ON_WALL, color: RED };
    let mut method = method(evidence());
    let [_, wall] = ids_of(&mut method, &[], 100)[99];
    let shown = ids_of(&mut method, &[book], 20);
    let [book_id, _] = shown[0];
    assert!(book_id != wall && shown.iter().all(|ids| *ids == [book_id, wall]), "{shown:?}");
    let shown = ids_of(&mut method, &[], 10);
    assert!(shown[3..].iter().all(|ids| *ids == [wall, wall]), "taken away: {shown:?}");
}

#[test]
fn a_pushed_flat_thing_leaves_no_trail() {
    let mut method = method(evidence());
    let [_, wall] = ids_of(&mut method, &[], 20)[19];
    let mut ids = Vec::new();
    for left in (LEFT..LEFT + 40).step_by(2) {
        let shown = see(&mut method, &[Thing { left, depth: ON_WALL, color: RED }], 1.0);
        ids.push(shown[(left + 10, 30)]);
        // Three frames decide, in which it moves by six pixels.
        let trail = left.saturating_sub(8);
        assert!(trail < LEFT || shown[(trail, 30)] == wall, "at {left}: {}", shown[(trail, 30)]);
    }
    assert!(ids[0] != wall && ids.iter().all(|id| *id == ids[0]), "{ids:?}");
}

#[test]
fn exposure_changes_no_ids() {
    let things = [near(LEFT, RED), near(RIGHT, GREEN)];
    let mut method = method(evidence());
    let before = ids_of(&mut method, &things, 5)[4];
    for exposure in [0.9, 0.6, 0.6, 0.6, 0.6, 0.8, 1.2] {
        assert_eq!(ids(&see(&mut method, &things, exposure)), before, "exposure {exposure}");
    }
    assert_eq!(method.memory().unwrap().segment_count(), 3);
}

#[test]
fn images_that_are_off_by_a_pixel_change_no_ids() {
    let things = |offset: usize| [near(LEFT + offset, RED), near(RIGHT + offset, GREEN)];
    let mut method = method(evidence());
    let before = ids_of(&mut method, &things(0), 20)[19];
    assert!(ids_of(&mut method, &things(1), 20).iter().all(|ids| *ids == before));
    assert_eq!(method.memory().unwrap().segment_count(), 3);
}

#[test]
fn earlier_frames_keep_what_was_there() {
    let mut method = method(evidence());
    let before = [near(LEFT, RED), near(RIGHT, GREEN)];
    let shown = (0..10).map(|_| see(&mut method, &before, 1.0)).last().unwrap();
    let after = [near(LEFT, GREEN), near(RIGHT, [50, 60, 200])];
    let latest = (0..10).map(|_| see(&mut method, &after, 1.0)).last().unwrap();
    let [red, _] = ids(&shown);
    assert!(!ids(&latest).contains(&red), "the red one is gone");
    let hindsight = method.hindsight().unwrap();
    for (things, shown) in [(before, shown), (after, latest)] {
        let frame = frame(&things, 1.0);
        let again = hindsight.look_again(&frame, &ShownFrame { segments: shown.clone(), regions: None }).unwrap();
        assert_eq!(ids(&again.segments), ids(&shown));
    }
}
