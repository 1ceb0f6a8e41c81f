//! Responses of a perfect promptable model to prompts.

use super::scene::TrueFrame;
use splatseg_geometry::{Click, Mask, Prompt, SegmentId};
use splatseg_tracking::TrackerError;
use std::collections::BTreeSet;

/// Checks that a prompt is within a frame of `size` = (width, height).
pub(super) fn checked(track: SegmentId, prompt: &Prompt, size: (usize, usize)) -> Result<(), TrackerError> {
    let (width, height) = size;
    let inside = |x: f32, y: f32| {
        let inside = (0.0..=width as f32).contains(&x) && (0.0..=height as f32).contains(&y);
        if inside { Ok(()) } else { Err(TrackerError::ClickOutside { track, x, y, width, height }) }
    };
    match prompt {
        Prompt::Mask(mask) if (mask.width(), mask.height()) != size => {
            Err(TrackerError::MaskSize { track, found: (mask.width(), mask.height()), expected: size })
        }
        Prompt::Mask(_) => Ok(()),
        Prompt::Points { bounding_box, clicks } => {
            if let Some([x0, y0, x1, y1]) = bounding_box {
                inside(*x0, *y0)?;
                inside(*x1, *y1)?;
            }
            clicks.iter().try_for_each(|click| inside(click.x, click.y))
        }
        Prompt::MoreClicks(clicks) => clicks.iter().try_for_each(|click| inside(click.x, click.y)),
    }
}

/// Returns the objects that a track follows after a [`checked`] prompt. `before` are its objects in this frame if its
/// mask is not empty.
///
/// - A **mask** or a **box** selects the objects of which it covers more than half.
/// - **Clicks** without a box, at least one of them positive, select one object, the [`clicked`] one.
/// - **Clicks with a box** correct the box's selection. Further clicks, or only negative ones, correct `before`.
///   Objects under negative clicks are removed, and the [`clicked`] object is added.
pub(super) fn answered(
    prompt: &Prompt,
    frame: &TrueFrame,
    before: Option<&BTreeSet<SegmentId>>,
) -> BTreeSet<SegmentId> {
    let shown = || before.cloned().unwrap_or_default();
    let (mut objects, clicks) = match prompt {
        Prompt::Mask(mask) => return frame.mostly_in(mask),
        Prompt::Points { bounding_box: Some(corners), clicks } => {
            (frame.mostly_in(&filled(*corners, frame.size())), clicks)
        }
        Prompt::Points { bounding_box: None, clicks } if clicks.iter().any(|click| click.positive) => {
            return clicked(clicks, frame).into_iter().collect();
        }
        Prompt::Points { bounding_box: None, clicks } | Prompt::MoreClicks(clicks) => (shown(), clicks),
    };
    for object in clicks.iter().filter(|click| !click.positive).filter_map(|click| object_under(click, frame)) {
        objects.remove(&object);
    }
    objects.extend(clicked(clicks, frame));
    objects
}

/// Returns the object selected by clicks: the one with the most positive clicks, minus the negative clicks on it. Ties
/// go to the earliest click. `None` if every object has more negative than positive clicks. Clicks on unlabelled pixels
/// are ignored.
fn clicked(clicks: &[Click], frame: &TrueFrame) -> Option<SegmentId> {
    let hits: Vec<(SegmentId, bool)> =
        clicks.iter().filter_map(|click| Some((object_under(click, frame)?, click.positive))).collect();
    let count = |object, positive| hits.iter().filter(|hit| **hit == (object, positive)).count();
    let candidates = hits.iter().filter(|(_, positive)| *positive).map(|(object, _)| *object);
    let agreeing: Vec<SegmentId> = candidates.filter(|object| count(*object, true) >= count(*object, false)).collect();
    // Ties go to the first.
    agreeing.into_iter().rev().max_by_key(|object| count(*object, true) - count(*object, false))
}

fn object_under(click: &Click, frame: &TrueFrame) -> Option<SegmentId> {
    let (width, height) = frame.size();
    frame.object_at(((click.x as usize).min(width - 1), (click.y as usize).min(height - 1)))
}

fn filled([x0, y0, x1, y1]: [f32; 4], (width, height): (usize, usize)) -> Mask {
    let inside = |place: usize, from: f32, to: f32| (from..to).contains(&(place as f32 + 0.5));
    Mask::from_fn(width, height, |column, row| inside(column, x0, x1) && inside(row, y0, y1))
}
