//! The best view of each object as an image, kept while frames are processed.

use crate::seen::{CLEARLY_BETTER, score};
use crate::{ObjectNames, ObjectSighting, ObjectView};
use splatseg_geometry::{CowImage, RemappedId, SegmentId, SegmentMap};
use std::collections::BTreeMap;

/// The best view of each object, at most 64 MiB in all: beyond it, the views of the objects unseen longest are dropped.
///
/// A view is replaced by one whose pixels times confidence are clearly more; views cut by the image border count a
/// quarter.
#[derive(Clone, Debug, Default)]
pub struct KeptViews {
    views: BTreeMap<SegmentId, KeptView>,
    /// Pixels of all views.
    pixels: usize,
}

#[derive(Clone, Debug)]
struct KeptView {
    view: ObjectView,
    score: f64,
    last_frame: usize,
}

impl KeptView {
    fn pixels(&self) -> usize {
        self.view.mask.pixels().len()
    }
}

impl KeptViews {
    /// Maximum side of a view, pixels: the input of common networks for images.
    pub const MAX_SIDE: usize = 224;
    /// Maximum number of pixels of all views. Each takes 4 bytes, colour and mask.
    pub const MAX_PIXELS: usize = 1 << 24;

    /// Keeps the views of a frame that are better than the ones so far. `color` and `segments` are `[height, width]`,
    /// sRGB and the id of each pixel.
    pub fn record(&mut self, color: &CowImage<'_, [u8; 3]>, segments: &SegmentMap, sightings: &[ObjectSighting]) {
        for sighting in sightings {
            let kept = self.views.get_mut(&sighting.id).map(|kept| {
                kept.last_frame = sighting.last_frame;
                kept.score
            });
            let score = score(sighting, color.size());
            if kept.is_some_and(|kept| score <= CLEARLY_BETTER * kept) {
                continue;
            }
            let view = ObjectView::cut(color, segments, sighting.id, &sighting.bounding_box, Self::MAX_SIDE);
            // An object under others has a box, but no pixels of its own.
            if let Some(view) = view.filter(|view| view.mask.pixels().contains(&true)) {
                self.insert(sighting.id, KeptView { view, score, last_frame: sighting.last_frame });
            }
        }
        self.drop_longest_unseen();
    }

    fn drop_longest_unseen(&mut self) {
        if self.pixels <= Self::MAX_PIXELS {
            return;
        }
        let mut order: Vec<(usize, SegmentId)> = self.views.iter().map(|(id, kept)| (kept.last_frame, *id)).collect();
        order.sort_unstable();
        // A little more than needed, so that a full store is not searched in every frame.
        for (_, id) in order {
            if self.pixels <= Self::MAX_PIXELS / 16 * 15 {
                break;
            }
            self.forget(id);
        }
    }

    fn insert(&mut self, id: SegmentId, kept: KeptView) {
        self.forget(id);
        self.pixels += kept.pixels();
        self.views.insert(id, kept);
    }

    fn remove(&mut self, id: SegmentId) -> Option<KeptView> {
        let kept = self.views.remove(&id)?;
        self.pixels -= kept.pixels();
        Some(kept)
    }

    /// Drops the view of an object, e.g. because its id now stands for another object.
    pub fn forget(&mut self, id: SegmentId) {
        self.remove(id);
    }

    /// Gives the views of ids that turned out to be other ids' objects to those. The better of two views stays.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped.iter().filter(|remapped| remapped.from != remapped.into) {
            let Some(other) = self.remove(*from) else { continue };
            if self.views.get(into).is_none_or(|kept| other.score > kept.score) {
                self.insert(*into, other);
            }
        }
    }

    /// The objects to be named, by increasing id: those without a name, and those whose view is clearly better than the one
    /// they were named from.
    pub fn to_name(&self, names: &ObjectNames) -> impl Iterator<Item = SegmentId> {
        let is_new = |(id, kept): &(&SegmentId, &KeptView)| {
            names.score(**id).is_none_or(|named| kept.score > CLEARLY_BETTER * named)
        };
        self.views.iter().filter(is_new).map(|(id, _)| *id)
    }

    /// The view of an object and its score, by which views of the same object compare.
    pub fn view(&self, id: SegmentId) -> Option<(&ObjectView, f64)> {
        self.views.get(&id).map(|kept| (&kept.view, kept.score))
    }
}
