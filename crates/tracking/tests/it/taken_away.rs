//! Flat objects that are taken away: depth cannot distinguish a mask of the surface below from a merged mask.

use crate::exact_masks::{evidence, method};
use splatseg_geometry::{Image, Mask, Pose, RgbdFrame, ScoredMask, SegmentMap};
use splatseg_test_scenes::camera;
use splatseg_tracking::Method;

const SIZE: (usize, usize) = (80, 60);

/// Number of frames within which an object must be gone.
const PATIENCE: usize = 10;

/// Returns the number of frames that still show a flat object once it is gone, after `present` frames with it.
/// `columns` is its width.
fn frames_as_ghost(present: usize, columns: usize, thing: [u8; 3]) -> usize {
    let (width, height) = SIZE;
    let intrinsics = camera(width, height, 75.0);
    let truth = |is_there: bool| {
        SegmentMap::from_fn(width, height, |column, row| {
            let is_inside = (20..20 + columns).contains(&column) && (20..40).contains(&row);
            if is_inside && is_there { 2 } else { 1 }
        })
    };
    let mut method = method(evidence());
    let mut show = |is_there: bool| {
        let truth = truth(is_there);
        let color = truth.map(|id| if *id == 2 { thing } else { [90; 3] });
        let frame = RgbdFrame::new("0", color, Image::filled(width, height, 2.0), intrinsics, Pose::IDENTITY).unwrap();
        let masks = Mask::of_segments(&truth).into_iter().map(|(_, mask)| ScoredMask { mask, score: 1.0 });
        let shown = method.process_masks(&frame, &masks.collect::<Vec<_>>()).unwrap().segments;
        shown[(20 + columns / 2, 30)] != shown[(2, 2)]
    };
    assert_eq!((0..present).filter(|_| show(true)).count(), present, "it has an id of its own");
    let shown: Vec<bool> = (0..40).map(|_| show(false)).collect();
    shown.iter().rposition(|is_shown| *is_shown).map_or(0, |last| last + 1)
}

#[test]
fn a_flat_object_is_gone_within_ten_frames_however_long_it_was_present() {
    for present in [1, 3, 10, 100, 300] {
        for (columns, color) in [(10, [180, 40, 40]), (40, [180, 40, 40]), (40, [90, 140, 90])] {
            let frames = frames_as_ghost(present, columns, color);
            assert!(frames < PATIENCE, "{color:?}, seen for {present} frames: shown for {frames} more");
        }
    }
}

#[test]
fn a_flat_object_with_the_colour_of_the_wall_is_gone_eventually() {
    let frames = frames_as_ghost(300, 40, [90; 3]);
    assert!(frames < 25, "shown for {frames} more frames");
}
