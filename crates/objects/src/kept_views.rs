//! The best views of each object as images, kept while frames are processed.

use crate::seen::{CLEARLY_BETTER, score};
use crate::seen_surface::{SeenSurface, share_of_new};
use crate::{ObjectNames, ObjectSighting, ObjectView};
use glam::DVec3;
use splatseg_geometry::{CameraFrame, CowImage, Intrinsics, Pose, RemappedId, SegmentId, SegmentMap};
use std::collections::BTreeMap;

/// The surface in a view is looked at again once the camera has moved this far, metres.
const MOVED: f64 = 0.05;
/// A further view counts if its new surface is worth this share of the best view.
const MIN_GAIN: f64 = 0.1;

/// A few views of each object, at most 64 MiB in all: beyond it, the further views of the objects unseen longest are dropped,
/// then their best ones.
///
/// The first view of an object is the best: the one with the most pixels times confidence; views cut by the image border
/// count a quarter. Each further view is the one that shows the most new surface, by the same measure. A view is replaced by
/// one that is clearly better, so that an approaching object does not get new views in every frame.
#[derive(Clone, Debug)]
pub struct KeptViews {
    objects: BTreeMap<SegmentId, ViewsOfObject>,
    /// Pixels of all views.
    pixels: usize,
    /// Maximum number of views of an object.
    most: usize,
}

/// A frame from which views are kept.
#[derive(Clone, Copy, Debug)]
pub struct ViewedFrame<'a> {
    /// sRGB, `[height, width]`.
    pub color: &'a CowImage<'a, [u8; 3]>,
    /// The id of each pixel, `[height, width]`.
    pub segments: &'a SegmentMap,
    /// z-depth, metres, 0 where missing; of the same view, perhaps with fewer pixels.
    pub depth: &'a CowImage<'a, f32>,
    /// The camera of the depth.
    pub intrinsics: &'a Intrinsics,
    /// The camera's pose; `None` if it is unknown. Then the frame can only have best views.
    pub world_from_camera: Option<&'a Pose>,
}

impl<'a> ViewedFrame<'a> {
    /// A camera's frame with its result.
    pub fn new(frame: &'a CameraFrame<'_>, segments: &'a SegmentMap, world_from_camera: Option<&'a Pose>) -> Self {
        Self { color: frame.color(), segments, depth: frame.depth(), intrinsics: frame.intrinsics(), world_from_camera }
    }
}

/// The views of an object, the best first.
#[derive(Clone, Debug, Default)]
struct ViewsOfObject {
    views: Vec<KeptView>,
    last_frame: usize,
    /// Place of the camera and score of the last view whose surface was looked at.
    looked_at: Option<(DVec3, f64)>,
}

#[derive(Clone, Debug)]
struct KeptView {
    view: ObjectView,
    score: f64,
    surface: SeenSurface,
    /// The score times the share of its surface that no view before it shows.
    gain: f64,
}

/// Where a new view goes.
enum Place {
    /// Before all others: the best view.
    First,
    /// In place of another.
    Of(usize),
    /// After all others.
    Last,
}

impl ViewsOfObject {
    /// The memory of the views, in pixels, of which each takes 4 bytes; what is known of their surface counts, too.
    fn pixels(&self) -> usize {
        self.views.iter().map(|kept| kept.view.mask.pixels().len() + kept.surface.size()).sum()
    }

    fn score(&self) -> f64 {
        self.views.iter().map(|kept| kept.gain).sum()
    }

    /// False if a view is hardly another one than the last that was looked at.
    fn is_worth_a_look(&mut self, score: f64, frame: &ViewedFrame<'_>) -> bool {
        if self.views.first().is_none_or(|best| score > CLEARLY_BETTER * best.score) {
            return true;
        }
        let Some(place) = frame.world_from_camera.map(Pose::translation) else { return false };
        let is_same = |(before, its): (DVec3, f64)| place.distance(before) < MOVED && score <= CLEARLY_BETTER * its;
        if self.looked_at.is_some_and(is_same) {
            return false;
        }
        self.looked_at = Some((place, score));
        true
    }

    /// Where a view with a score belongs, if anywhere. `surface` is computed only if needed.
    fn place_of(&self, score: f64, most: usize, surface: impl FnOnce() -> SeenSurface) -> Option<(Place, SeenSurface)> {
        let Some(best) = self.views.first() else { return Some((Place::First, surface())) };
        if score > CLEARLY_BETTER * best.score {
            return Some((Place::First, surface()));
        }
        let least = MIN_GAIN * best.score;
        let has_room = self.views.len() < most;
        let smallest = self.views.iter().skip(1).map(|kept| kept.gain).fold(f64::INFINITY, f64::min);
        if score <= least || !has_room && score <= CLEARLY_BETTER * smallest {
            return None;
        }
        let surface = surface();
        let shown = surface.shown_by(self.views.iter().map(|kept| &kept.surface));
        let gain_but = |but| score * share_of_new(surface.len(), &shown, but);
        if has_room && gain_but(None) > least {
            return Some((Place::Last, surface));
        }
        // The view that it beats most clearly.
        let ratio = |index: usize| gain_but(Some(index)) / self.views[index].gain.max(f64::MIN_POSITIVE);
        let ratios = (1..self.views.len()).map(|index| (index, ratio(index)));
        let (index, ratio) = ratios.max_by(|one, other| one.1.total_cmp(&other.1).then(other.0.cmp(&one.0)))?;
        (ratio > CLEARLY_BETTER).then_some((Place::Of(index), surface))
    }

    fn put(&mut self, place: &Place, kept: KeptView, most: usize) {
        match place {
            Place::First => self.views.insert(0, kept),
            Place::Of(index) => self.views[*index] = kept,
            Place::Last => self.views.push(kept),
        }
        self.keep_worthwhile(most);
    }

    /// Keeps the views that show enough that those before them do not show.
    fn keep_worthwhile(&mut self, most: usize) {
        let mut kept: Vec<KeptView> = Vec::new();
        for mut view in std::mem::take(&mut self.views) {
            let shown = view.surface.shown_by(kept.iter().map(|kept| &kept.surface));
            view.gain = match kept.first() {
                None => view.score,
                Some(_) => view.score * share_of_new(view.surface.len(), &shown, None),
            };
            if kept.first().is_none_or(|best| view.gain > MIN_GAIN * best.score) && kept.len() < most {
                kept.push(view);
            }
        }
        self.views = kept;
    }
}

impl Default for KeptViews {
    fn default() -> Self {
        Self::with_most(Self::MOST)
    }
}

impl KeptViews {
    /// Maximum side of a view, pixels: the input of common networks for images.
    pub const MAX_SIDE: usize = 224;
    /// Maximum number of pixels of all views. Each takes 4 bytes, colour and mask.
    pub const MAX_PIXELS: usize = 1 << 24;
    /// Maximum number of views of an object.
    pub const MOST: usize = 4;

    /// Keeps at most this many views of each object, at least 1.
    pub fn with_most(most: usize) -> Self {
        Self { objects: BTreeMap::new(), pixels: 0, most: most.max(1) }
    }

    /// Keeps the views of a frame that are better than those so far, or show other surface.
    pub fn record(&mut self, frame: &ViewedFrame<'_>, sightings: &[ObjectSighting]) {
        for sighting in sightings {
            self.record_object(frame, sighting);
        }
        self.drop_longest_unseen();
    }

    fn record_object(&mut self, frame: &ViewedFrame<'_>, sighting: &ObjectSighting) {
        let (id, inner) = (sighting.id, &sighting.bounding_box);
        if let Some(object) = self.objects.get_mut(&id) {
            object.last_frame = sighting.last_frame;
        }
        let score = score(sighting, frame.color.size());
        if self.objects.get_mut(&id).is_some_and(|object| !object.is_worth_a_look(score, frame)) {
            return;
        }
        let none = ViewsOfObject::default();
        let before = self.objects.get(&id).unwrap_or(&none);
        let surface = || SeenSurface::of(frame, id, inner);
        let Some((place, surface)) = before.place_of(score, self.most, surface) else { return };
        let view = ObjectView::cut(frame.color, frame.segments, id, inner, Self::MAX_SIDE);
        // An object under others has a box, but no pixels of its own.
        let Some(view) = view.filter(|view| view.mask.pixels().contains(&true)) else { return };
        let mut object = self.remove(id).unwrap_or_default();
        object.last_frame = sighting.last_frame;
        object.put(&place, KeptView { view, score, surface: surface.widened(), gain: 0.0 }, self.most);
        self.insert(id, object);
    }

    fn drop_longest_unseen(&mut self) {
        if self.pixels <= Self::MAX_PIXELS {
            return;
        }
        let mut order: Vec<(usize, SegmentId)> =
            self.objects.iter().map(|(id, object)| (object.last_frame, *id)).collect();
        order.sort_unstable();
        // A little more than needed, so that a full store is not searched in every frame.
        for left in [1, 0] {
            for (_, id) in &order {
                if self.pixels <= Self::MAX_PIXELS / 16 * 15 {
                    return;
                }
                if let Some(mut object) = self.remove(*id) {
                    object.views.truncate(left);
                    self.insert(*id, object);
                }
            }
        }
    }

    fn insert(&mut self, id: SegmentId, object: ViewsOfObject) {
        self.remove(id);
        if !object.views.is_empty() {
            self.pixels += object.pixels();
            self.objects.insert(id, object);
        }
    }

    fn remove(&mut self, id: SegmentId) -> Option<ViewsOfObject> {
        let object = self.objects.remove(&id)?;
        self.pixels -= object.pixels();
        Some(object)
    }

    /// Drops the views of an object, e.g. because its id now stands for another object.
    pub fn forget(&mut self, id: SegmentId) {
        self.remove(id);
    }

    /// Gives the views of ids that turned out to be other ids' objects to those, of which the best stay.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped.iter().filter(|remapped| remapped.from != remapped.into) {
            let Some(other) = self.remove(*from) else { continue };
            let mut joined = self.remove(*into).unwrap_or_default();
            joined.views.extend(other.views);
            joined.views.sort_by(|one, other| other.score.total_cmp(&one.score));
            joined.last_frame = joined.last_frame.max(other.last_frame);
            joined.keep_worthwhile(self.most);
            self.insert(*into, joined);
        }
    }

    /// The objects to be named, by increasing id: those without a name, and those whose views are clearly better than the
    /// ones they were named from.
    pub fn to_name(&self, names: &ObjectNames) -> impl Iterator<Item = SegmentId> {
        let is_new = |(id, object): &(&SegmentId, &ViewsOfObject)| {
            names.score(**id).is_none_or(|named| object.score() > CLEARLY_BETTER * named)
        };
        self.objects.iter().filter(is_new).map(|(id, _)| *id)
    }

    /// The views of an object, the best first, each with its weight: the square root of its pixels times confidence times
    /// the share of its surface that no view before it shows. Empty if there are none.
    pub fn views(&self, id: SegmentId) -> Vec<(&ObjectView, f64)> {
        let views = self.objects.get(&id).into_iter().flat_map(|object| &object.views);
        views.map(|kept| (&kept.view, kept.gain.sqrt())).collect()
    }

    /// The last frame that showed an object of which there are views.
    pub fn last_frame(&self, id: SegmentId) -> Option<usize> {
        self.objects.get(&id).map(|object| object.last_frame)
    }

    /// The score of an object's views together, by which those of the same object compare.
    pub fn score(&self, id: SegmentId) -> Option<f64> {
        self.objects.get(&id).map(ViewsOfObject::score)
    }
}
