//! The rules for what is remembered, replaced and forgotten, before a wall 2 m ahead.

use super::*;
use crate::{MemorySettings, SplatMemory};
use glam::{DVec3, Mat4, Vec3};
use splatseg_geometry::{Intrinsics, LocalPose, Pose};
use std::ops::Range;

const CAMERA: Intrinsics = Intrinsics { fx: 60.0, fy: 60.0, cx: 29.5, cy: 19.5, width: 60, height: 40 };
const WALL: SegmentId = 1;
const SCREEN: SegmentId = 2;
const OTHER: SegmentId = 3;
const WALL_DEPTH: f32 = 2.0;

/// Columns and rows.
type Rect = (Range<usize>, Range<usize>);

/// Where the screen usually is: 200 pixels.
const PLACE: Rect = (20..40, 15..25);

/// One frame: the wall, and what is painted over it.
#[derive(Clone)]
struct Shot {
    depth: Image<f32>,
    seen: SegmentMap,
    pose: LocalPose,
}

impl Shot {
    fn wall() -> Self {
        let (width, height) = (CAMERA.width, CAMERA.height);
        let (depth, seen) = (Image::filled(width, height, WALL_DEPTH), SegmentMap::filled(width, height, WALL));
        Self { depth, seen, pose: LocalPose::IDENTITY }
    }

    /// The wall with a screen without depth. There is none up to 6 pixels around it either, so that the map does not reach
    /// over it.
    fn screen(place: Rect) -> Self {
        let wider = |range: &Range<usize>, size: usize| range.start.saturating_sub(6)..(range.end + 6).min(size);
        let around = (wider(&place.0, CAMERA.width), wider(&place.1, CAMERA.height));
        Self::wall().paint(around, 0, 0.0).paint(place, SCREEN, 0.0)
    }

    /// The same, with something else in the place of the screen.
    fn instead_of_screen(id: SegmentId, depth: f32) -> Self {
        Self::screen(PLACE).paint(PLACE, id, depth)
    }

    fn paint(mut self, place: Rect, id: SegmentId, depth: f32) -> Self {
        for at in place.0.flat_map(|column| place.1.clone().map(move |row| (column, row))) {
            (self.seen[at], self.depth[at]) = (id, depth);
        }
        self
    }

    /// Seen from so many pixels (at the wall's distance) to the right.
    fn aside(mut self, pixels: f32) -> Self {
        let shift = Vec3::X * pixels * WALL_DEPTH / CAMERA.fx;
        self.pose = Pose::from_matrix(Mat4::from_translation(shift).as_dmat4()).unwrap().relative_to(DVec3::ZERO);
        self
    }

    fn frame(&self) -> RgbdFrame<'_> {
        let color = Image::filled(CAMERA.width, CAMERA.height, [0; 3]);
        RgbdFrame::new("0", color, self.depth.clone(), CAMERA, self.pose.at(DVec3::ZERO)).unwrap()
    }
}

struct Run(SplatMemory);

impl Run {
    fn new() -> Self {
        let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
        (0..8).for_each(|_| _ = memory.new_segment().unwrap());
        Self(memory)
    }

    /// A memory that knows the screen.
    fn that_knows(place: Rect) -> Self {
        let mut run = Self::new();
        run.show(&Shot::screen(place));
        run
    }

    fn show(&mut self, shot: &Shot) -> &[DepthlessSegment] {
        let frame = shot.frame();
        self.0.update(self.0.recall(&frame), &shot.seen).unwrap();
        &self.0.depthless.segments
    }

    fn ids(&self) -> Vec<SegmentId> {
        self.0.depthless.segments.iter().map(|segment| segment.region.id).collect()
    }

    fn screen(&self) -> &DepthlessSegment {
        self.0.depthless.segments.iter().find(|segment| segment.region.id == SCREEN).unwrap()
    }

    /// Pixels at which the screen is expected.
    fn expected(&self, shot: &Shot) -> usize {
        self.0.recall(&shot.frame()).expected().segments.mask_of(SCREEN).area()
    }
}

#[test]
fn few_pixels_are_not_remembered() {
    let is_remembered = |pixels: usize| !Run::new().show(&Shot::screen((10..10 + pixels, 12..13))).is_empty();
    assert!(!is_remembered(MIN_AREA - 1) && is_remembered(MIN_AREA));
}

#[test]
fn an_id_of_which_less_than_half_is_bare_is_not_remembered() {
    let is_remembered = |with_depth: usize| {
        let shot = Shot::screen((10..40, 10..11)).paint((10..10 + with_depth, 30..31), SCREEN, WALL_DEPTH);
        !Run::new().show(&shot).is_empty()
    };
    assert!(is_remembered(30) && !is_remembered(31));
}

#[test]
fn what_the_map_covers_is_not_bare() {
    let mut run = Run::new();
    run.show(&Shot::wall());
    run.show(&Shot::screen(PLACE));
    assert!(run.ids().is_empty());
    assert_eq!(run.expected(&Shot::screen(PLACE)), 0);
}

#[test]
fn ids_that_have_no_say_are_not_remembered() {
    let shot = Shot::wall().paint(PLACE, ABSTAIN, 0.0).paint((0..10, 0..10), 0, 0.0);
    assert!(Run::new().show(&shot).is_empty());
}

#[test]
fn nothing_is_expected_unless_a_quarter_is_bare() {
    let run = Run::that_knows(PLACE);
    let expected =
        |bare_columns: usize| run.expected(&Shot::wall().paint((20..20 + bare_columns, 15..25), SCREEN, 0.0));
    assert_eq!([0, 4, 5, 20].map(expected), [0, 0, 50, 200]);
}

#[test]
fn of_two_in_one_place_the_one_seen_last_is_expected_then_the_smaller_id() {
    let mut run = Run::that_knows(PLACE);
    run.show(&Shot::instead_of_screen(OTHER, 0.0));
    let expected = |run: &Run| run.0.recall(&Shot::screen(PLACE).frame()).expected().segments[(30, 20)];
    assert_eq!((run.ids(), expected(&run)), (vec![SCREEN, OTHER], OTHER));
    run.0.depthless.segments.iter_mut().for_each(|segment| segment.last_seen = 0);
    assert_eq!(expected(&run), SCREEN);
    run.0.depthless.segments[0].last_seen = 1;
    assert_eq!(expected(&run), SCREEN);
}

#[test]
fn a_new_view_replaces_the_old_one() {
    let mut run = Run::that_knows(PLACE);
    run.show(&Shot::screen((22..42, 15..25)));
    let screen = run.screen();
    assert_eq!((screen.region.left, screen.region.area, screen.last_seen), (22, 200, 1));
    assert_eq!((screen.viewpoint.map_from_camera, screen.poor_views), (LocalPose::IDENTITY, 0));
}

#[test]
fn a_view_that_the_images_border_cuts_off_does_not_replace_a_whole_one() {
    // From 30 pixels to the right, the left half of the screen is out of view.
    let from_aside = |place: Rect| Shot::screen((0..10, 15..25)).paint(place, SCREEN, 0.0).aside(30.0);
    let mut run = Run::that_knows(PLACE);
    run.show(&from_aside((0..10, 15..25)));
    assert_eq!((run.screen().region.left, run.screen().last_seen), (20, 1), "as it was predicted");
    // One column of eleven is new.
    run.show(&from_aside((0..11, 15..25)));
    assert_eq!((run.screen().region.left, run.screen().last_seen), (20, 2), "about as it was predicted");
    run.show(&from_aside((0..14, 15..25)));
    assert_eq!((run.screen().region.left, run.screen().region.area), (0, 140), "four columns of 14 were not known");
    assert_eq!(run.screen().viewpoint.map_from_camera, from_aside(PLACE).pose);
}

#[test]
fn poor_views_replace_a_better_one_only_after_some() {
    let mut run = Run::that_knows(PLACE);
    let poor = Shot::screen(PLACE).paint((29..40, 15..25), 0, 0.0);
    for time in 1..=MAX_POOR_VIEWS {
        run.show(&poor);
        assert_eq!((run.screen().poor_views, run.screen().region.area), (time, 200));
    }
    run.show(&poor);
    assert_eq!((run.screen().poor_views, run.screen().region.area), (0, 90));
    // Half of it is not poor.
    let mut run = Run::that_knows(PLACE);
    run.show(&Shot::screen(PLACE).paint((30..40, 15..25), 0, 0.0));
    assert_eq!((run.screen().poor_views, run.screen().region.area), (0, 100));
}

#[test]
fn a_good_view_starts_the_count_of_poor_ones_anew() {
    let mut run = Run::that_knows(PLACE);
    let cut_off = Shot::screen((0..10, 15..25)).aside(30.0);
    run.show(&Shot::screen(PLACE).paint((29..40, 15..25), 0, 0.0));
    assert_eq!(run.screen().poor_views, 1);
    run.show(&cut_off);
    assert_eq!((run.screen().poor_views, run.screen().region.area), (0, 200));
}

#[test]
fn a_plane_with_the_same_support_is_taken_from_the_new_view() {
    let mut run = Run::that_knows(PLACE);
    let mut nearer = Shot::screen(PLACE);
    nearer.depth.pixels_mut().iter_mut().filter(|depth| **depth > 0.0).for_each(|depth| *depth = 1.9);
    run.show(&nearer);
    assert!((run.screen().plane.inverse - Vec3::Z / 1.9).length() < 1e-3, "{:?}", run.screen().plane);
}

#[test]
fn the_plane_that_served_so_far_is_kept_if_there_is_no_depth_around_any_more() {
    let nothing_around = Shot::wall().paint((0..60, 0..40), 0, 0.0);
    let mut run = Run::that_knows(PLACE);
    assert_eq!(run.screen().plane.support, plane::Support::Fit);
    // From half a metre nearer it is 4/3 times as large.
    let nearer = Shot {
        pose: Pose::from_matrix((Mat4::from_translation(Vec3::Z * 0.5)).as_dmat4()).unwrap().relative_to(DVec3::ZERO),
        ..nothing_around.clone()
    };
    let nearer = nearer.paint((17..43, 13..27), SCREEN, 0.0);
    run.show(&nearer);
    let kept = run.screen().plane;
    assert_eq!(kept.support, plane::Support::Fit);
    assert!((kept.inverse - Vec3::Z / 1.5).length() < 1e-3, "{kept:?}");
    // Elsewhere it is not the one that was known.
    run.show(&nothing_around.paint((20..40, 21..31), SCREEN, 0.0));
    assert_eq!(run.screen().plane.support, plane::Support::None);
}

/// Whether a screen is forgotten that `shot` does not show, after so many frames.
fn is_forgotten(shot: &Shot, frames: u8) -> bool {
    let mut run = Run::that_knows(PLACE);
    (0..frames).for_each(|_| _ = run.show(shot));
    !run.ids().contains(&SCREEN)
}

#[test]
fn what_is_contradicted_five_times_is_forgotten() {
    let gone = Shot::instead_of_screen(WALL, WALL_DEPTH);
    assert!(!is_forgotten(&gone, MAX_CONTRADICTIONS - 1) && is_forgotten(&gone, MAX_CONTRADICTIONS));
    let mut run = Run::that_knows(PLACE);
    for _ in 0..3 {
        (1..MAX_CONTRADICTIONS).for_each(|_| _ = run.show(&Shot::instead_of_screen(OTHER, 0.0)));
        assert_eq!(run.screen().contradictions, MAX_CONTRADICTIONS - 1);
        run.show(&Shot::screen(PLACE));
        assert_eq!(run.screen().contradictions, 0, "seen in between");
    }
}

#[test]
fn only_another_surface_or_prediction_in_its_place_contradicts() {
    let shown = |depth: f32, id: SegmentId| is_forgotten(&Shot::instead_of_screen(id, depth), 3 * MAX_CONTRADICTIONS);
    assert!(shown(0.0, OTHER), "another prediction");
    assert!(!shown(0.0, 0) && !shown(0.0, ABSTAIN), "none, or one without a say");
    assert!(shown(1.95, OTHER) && shown(5.0, OTHER), "a surface where it was, or behind");
    assert!(!shown(1.85, OTHER), "one that hides it");
}

#[test]
fn a_surface_contradicts_whatever_is_predicted_there() {
    // In the first frame the map does not have it yet.
    let contradictions = |depth: f32, id: SegmentId| {
        let mut run = Run::that_knows(PLACE);
        run.show(&Shot::instead_of_screen(id, depth));
        run.screen().contradictions
    };
    assert_eq!([0, OTHER].map(|id| contradictions(1.95, id)), [1, 1]);
    assert_eq!([0, OTHER].map(|id| contradictions(1.85, id)), [0, 0], "it hides the screen");
}

#[test]
fn it_takes_more_than_half_of_its_place_to_contradict() {
    let shown = |columns: usize| {
        let shot = Shot::instead_of_screen(0, 0.0).paint((20..20 + columns, 15..25), OTHER, 0.0);
        is_forgotten(&shot, 2 * MAX_CONTRADICTIONS)
    };
    assert!(!shown(10) && shown(11));
}

#[test]
fn what_is_partly_out_of_view_is_not_contradicted() {
    // Two columns of twenty are out of view, then three.
    let forgotten = |pixels: f32| is_forgotten(&Shot::wall().aside(20.0 + pixels), 2 * MAX_CONTRADICTIONS);
    assert!(forgotten(1.9) && !forgotten(3.1));
}

#[test]
fn a_surface_of_the_map_contradicts_unless_it_hides() {
    // The map learns of a surface there; then the frame has no depth.
    let shown = |depth: f32| {
        let mut run = Run::that_knows(PLACE);
        run.show(&Shot::instead_of_screen(OTHER, depth));
        let before = run.screen().contradictions;
        run.show(&Shot::instead_of_screen(0, 0.0));
        run.screen().contradictions - before
    };
    assert_eq!([1.5, 1.97].map(shown), [0, 1]);
}
