//! How a perfect promptable model understands prompts.

use super::scene::TrueFrame;
use crate::TrackerError;
use splatseg_geometry::{Mask, SegmentId};
use splatseg_models::sam2::{Click, Prompt};
use std::collections::BTreeSet;

/// That a prompt lies within a frame of `size` = (width, height).
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

/// The objects that a track follows after a [`checked`] prompt. `before` are those that it shows in this frame.
///
/// - A **mask** asks for the objects of which it covers more than half, whatever the track showed before.
/// - A **box** asks for the objects of which more than half lies in it.
/// - **Clicks** correct what the track shows: the object under a negative click is no longer part of it, that under a
///   positive one is, and a positive click has the last word. Clicks on unlabelled ground say nothing.
pub(super) fn answered(
    prompt: &Prompt,
    frame: &TrueFrame,
    before: Option<&BTreeSet<SegmentId>>,
) -> BTreeSet<SegmentId> {
    let (bounding_box, clicks) = match prompt {
        Prompt::Mask(mask) => return frame.mostly_in(mask),
        Prompt::Points { bounding_box, clicks } => (*bounding_box, clicks),
        Prompt::MoreClicks(clicks) => (None, clicks),
    };
    let mut objects = match bounding_box {
        Some(corners) => frame.mostly_in(&filled(corners, frame.size())),
        None => before.cloned().unwrap_or_default(),
    };
    let clicked = |positive: bool| {
        clicks.iter().filter(move |click| click.positive == positive).filter_map(|click| object_under(click, frame))
    };
    clicked(false).for_each(|object| {
        objects.remove(&object);
    });
    objects.extend(clicked(true));
    objects
}

fn object_under(click: &Click, frame: &TrueFrame) -> Option<SegmentId> {
    let (width, height) = frame.size();
    frame.object_at(((click.x as usize).min(width - 1), (click.y as usize).min(height - 1)))
}

fn filled([x0, y0, x1, y1]: [f32; 4], (width, height): (usize, usize)) -> Mask {
    let inside = |place: usize, from: f32, to: f32| (from..to).contains(&(place as f32 + 0.5));
    Mask::from_fn(width, height, |column, row| inside(column, x0, x1) && inside(row, y0, y1))
}
