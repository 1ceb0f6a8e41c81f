//! Sightings, confidence and best view of each object.

use crate::{BestView, BoundingBox, FrameStamp, ObjectSighting};
use serde::{Deserialize, Serialize};
use splatseg_geometry::{RemappedId, SegmentId};
use std::collections::BTreeMap;

/// A view must beat the best one so far by this factor, so that an approaching object does not get a new best view in
/// every frame.
pub(crate) const CLEARLY_BETTER: f64 = 1.2;
/// Score factor of a view in which the image border cuts the object.
const CUT_VIEW: f64 = 0.25;

/// Every object seen so far, with its best view.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenObjects {
    objects: BTreeMap<SegmentId, Sightings>,
}

/// The sightings of an object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sightings {
    /// The first frame that showed it.
    pub first_frame: FrameStamp,
    /// The last frame that showed it.
    pub last_frame: FrameStamp,
    /// Number of sightings: the frames that showed it. A frame counts twice if it showed two ids that later turned out to
    /// be this object.
    pub frames: usize,
    /// Its best view: the most pixels times confidence. Views cut by the image border count a quarter.
    pub best_view: BestView,
    score: f64,
    summed_confidence: f64,
}

impl Sightings {
    /// Mean confidence of the frames that showed the object, from 0 to 1.
    pub fn confidence(&self) -> f32 {
        (self.summed_confidence / self.frames.max(1) as f64) as f32
    }

    fn merge(&mut self, other: Self) {
        if other.first_frame.number < self.first_frame.number {
            self.first_frame = other.first_frame;
        }
        if other.last_frame.number > self.last_frame.number {
            self.last_frame = other.last_frame;
        }
        if other.score > self.score {
            self.best_view = other.best_view;
            self.score = other.score;
        }
        self.frames += other.frames;
        self.summed_confidence += other.summed_confidence;
    }
}

impl SeenObjects {
    /// All objects, by id.
    pub fn objects(&self) -> &BTreeMap<SegmentId, Sightings> {
        &self.objects
    }

    /// Replaces the sightings of some objects.
    pub fn replace(&mut self, objects: Vec<(SegmentId, Sightings)>) {
        self.objects.extend(objects);
    }

    /// The best view of an object.
    pub fn best_view_mut(&mut self, id: SegmentId) -> Option<&mut BestView> {
        self.objects.get_mut(&id).map(|object| &mut object.best_view)
    }

    /// Adds the sightings of ids that turned out to be other ids' objects to those. The better of two best views stays,
    /// with the box and the colour of the part that it showed.
    pub fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped.iter().filter(|remapped| remapped.from != remapped.into) {
            let Some(other) = self.objects.remove(from) else { continue };
            match self.objects.get_mut(into) {
                Some(kept) => kept.merge(other),
                None => drop(self.objects.insert(*into, other)),
            }
        }
    }

    /// Records the objects of the next frame, whose images have `size` `(width, height)`. Returns the objects for which
    /// this frame is the new best view; the view has no colour and no crop yet.
    pub fn record(&mut self, frame: &FrameStamp, size: (usize, usize), sightings: &[ObjectSighting]) -> Vec<SegmentId> {
        let mut improved = Vec::new();
        for sighting in sightings {
            if sighting.is_new() {
                self.objects.remove(&sighting.id);
            }
            let score = score(sighting, size);
            let view = || BestView {
                frame: frame.clone(),
                bounding_box: sighting.bounding_box,
                area_px: sighting.area,
                confidence: sighting.confidence,
                color: None,
                crop: None,
            };
            let object = self.objects.entry(sighting.id).or_insert_with(|| Sightings {
                first_frame: frame.clone(),
                last_frame: frame.clone(),
                frames: 0,
                best_view: view(),
                score,
                summed_confidence: 0.0,
            });
            let is_better = score > CLEARLY_BETTER * object.score;
            if is_better {
                object.best_view = view();
                object.score = score;
            }
            if is_better || object.frames == 0 {
                improved.push(sighting.id);
            }
            object.last_frame.clone_from(frame);
            object.frames += 1;
            object.summed_confidence += f64::from(sighting.confidence);
        }
        improved
    }
}

/// How well a frame shows an object: its pixels times confidence. Views cut by the image border count a quarter.
pub(crate) fn score(sighting: &ObjectSighting, size: (usize, usize)) -> f64 {
    let whole = sighting.area as f64 * f64::from(sighting.confidence);
    if is_cut(&sighting.bounding_box, size) { CUT_VIEW * whole } else { whole }
}

/// True if a box touches the image border.
fn is_cut(inner: &BoundingBox, (width, height): (usize, usize)) -> bool {
    inner.x == 0 || inner.y == 0 || inner.x + inner.width >= width || inner.y + inner.height >= height
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamp(number: usize) -> FrameStamp {
        FrameStamp { number, name: Some(format!("frame-{number}")), file: None, time_s: Some(number as f64 / 4.0) }
    }

    fn sighting(x: usize, area: usize, confidence: f32) -> ObjectSighting {
        let bounding_box = BoundingBox { x, y: 5, width: 10, height: 10 };
        ObjectSighting { id: 7, area, bounding_box, confidence, first_frame: 0, last_frame: 1 }
    }

    /// The frames that became the best view of object 7 when they were recorded.
    fn best_frames(seen: &mut SeenObjects, sightings: &[ObjectSighting]) -> Vec<usize> {
        let is_best = |(number, sighting): &(usize, &ObjectSighting)| {
            !seen.record(&stamp(*number), (100, 80), std::slice::from_ref(*sighting)).is_empty()
        };
        sightings.iter().enumerate().filter(is_best).map(|(number, _)| number).collect()
    }

    #[test]
    fn the_best_view_is_large_sure_and_whole() {
        let mut seen = SeenObjects::default();
        let sightings = [
            sighting(5, 40, 0.5),
            sighting(5, 45, 0.5),
            sighting(5, 45, 1.0),
            sighting(0, 90, 1.0),
            sighting(90, 90, 1.0),
            sighting(89, 55, 1.0),
        ];
        assert_eq!(best_frames(&mut seen, &sightings), [0, 2, 5]);
        let object = &seen.objects()[&7];
        assert_eq!((object.first_frame.number, object.last_frame.number, object.frames), (0, 5, 6));
        assert_eq!((object.best_view.area_px, object.best_view.frame.number), (55, 5));
        assert!((object.confidence() - 5.0 / 6.0).abs() < 1e-6);
    }

    #[test]
    fn an_object_with_an_id_of_another_replaces_it() {
        let mut seen = SeenObjects::default();
        best_frames(&mut seen, &[sighting(5, 40, 1.0)]);
        let other = ObjectSighting { first_frame: 8, last_frame: 8, ..sighting(30, 10, 0.5) };
        assert_eq!(seen.record(&stamp(8), (100, 80), &[other]), [7]);
        let object = &seen.objects()[&7];
        assert_eq!((object.first_frame.number, object.frames, object.best_view.area_px), (8, 1, 10));
    }

    #[test]
    fn joined_objects_have_the_sightings_of_both() {
        let mut seen = SeenObjects::default();
        best_frames(&mut seen, &[sighting(5, 40, 1.0), sighting(5, 40, 1.0)]);
        let piece = |frame, area, confidence| ObjectSighting {
            id: 9,
            first_frame: 2,
            last_frame: frame,
            ..sighting(30, area, confidence)
        };
        seen.record(&stamp(2), (100, 80), &[piece(2, 90, 0.5)]);
        seen.record(&stamp(3), (100, 80), &[piece(3, 90, 0.5)]);
        seen.remap(&[RemappedId { from: 9, into: 7 }, RemappedId { from: 8, into: 6 }]);
        let object = &seen.objects()[&7];
        assert_eq!(seen.objects().len(), 1);
        assert_eq!((object.first_frame.number, object.last_frame.number, object.frames), (0, 3, 4));
        assert_eq!((object.best_view.frame.number, object.best_view.area_px), (2, 90));
        assert!((object.confidence() - 0.75).abs() < 1e-6);
        // An object that was only seen under the other id gets the older one.
        seen.remap(&[RemappedId { from: 7, into: 4 }]);
        assert_eq!(seen.objects()[&4].frames, 4);
    }

    #[test]
    fn an_object_that_is_always_cut_or_unsure_has_a_best_view_too() {
        let mut seen = SeenObjects::default();
        assert_eq!(best_frames(&mut seen, &[sighting(0, 40, 0.0), sighting(0, 40, 0.0), sighting(0, 40, 0.5)]), [0, 2]);
    }
}
