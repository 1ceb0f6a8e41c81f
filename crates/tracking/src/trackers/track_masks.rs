//! The tracks of one frame as a list of ids and masks, by increasing id.

use crate::{Tracker, TrackingError};
use splatseg_geometry::{Mask, Prompt, SegmentId};
use std::collections::BTreeSet;

/// Creates a track for each mask with the corresponding id in `ids`, in one call of the tracker, and adds them to the
/// frame's tracks. Returns the ids without a track, because the tracker found nothing: their masks are too thin for it.
pub(crate) fn add_tracks(
    tracker: &mut dyn Tracker,
    tracks: &mut Vec<(SegmentId, Mask)>,
    new_objects: &[&Mask],
    ids: &[SegmentId],
) -> Result<BTreeSet<SegmentId>, TrackingError> {
    let prompts: Vec<(SegmentId, Prompt)> =
        ids.iter().zip(new_objects).map(|(id, mask)| (*id, Prompt::Mask((*mask).clone()))).collect();
    prompt_tracks(tracker, tracks, &prompts)?;
    let new: BTreeSet<SegmentId> = ids.iter().copied().collect();
    let is_empty = |(id, mask): &&(SegmentId, Mask)| new.contains(id) && mask.is_empty();
    let empty = tracks.iter().filter(is_empty).map(|(id, _)| *id).collect();
    remove_tracks(tracker, tracks, &empty);
    Ok(empty)
}

/// Prompts the tracker in one call, and stores the resulting masks in the frame's tracks.
pub(crate) fn prompt_tracks(
    tracker: &mut dyn Tracker,
    tracks: &mut Vec<(SegmentId, Mask)>,
    prompts: &[(SegmentId, Prompt)],
) -> Result<(), TrackingError> {
    if prompts.is_empty() {
        return Ok(());
    }
    for (id, mask) in tracker.prompt(prompts)? {
        match tracks.binary_search_by_key(&id, |(id, _)| *id) {
            Ok(place) => tracks[place].1 = mask,
            Err(place) => tracks.insert(place, (id, mask)),
        }
    }
    Ok(())
}

/// Removes tracks from the tracker and from the frame's tracks.
pub(crate) fn remove_tracks(
    tracker: &mut dyn Tracker,
    tracks: &mut Vec<(SegmentId, Mask)>,
    removed: &BTreeSet<SegmentId>,
) {
    removed.iter().for_each(|track| tracker.remove(*track));
    tracks.retain(|(id, _)| !removed.contains(id));
}

/// Returns the tracks whose object is in the frame.
pub(crate) fn visible(tracks: Vec<(SegmentId, Mask)>) -> Vec<(SegmentId, Mask)> {
    tracks.into_iter().filter(|(_, mask)| !mask.is_empty()).collect()
}
