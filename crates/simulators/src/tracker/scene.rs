//! The true objects of one frame.

use splatseg_geometry::{Mask, SegmentId, SegmentMap, distance_transform};
use std::collections::{BTreeMap, BTreeSet};

/// The true objects of a frame, as masks.
#[derive(Debug)]
pub(super) struct TrueFrame {
    truth: SegmentMap,
    objects: BTreeMap<SegmentId, Mask>,
}

impl TrueFrame {
    pub(super) fn new(truth: SegmentMap) -> Self {
        let objects = Mask::of_segments(&truth).into_iter().collect();
        Self { truth, objects }
    }

    /// `(width, height)`.
    pub(super) fn size(&self) -> (usize, usize) {
        self.truth.size()
    }

    /// An empty mask.
    pub(super) fn nothing(&self) -> Mask {
        Mask::empty(self.truth.width(), self.truth.height())
    }

    /// The union of objects.
    pub(super) fn union(&self, objects: &BTreeSet<SegmentId>) -> Mask {
        let mut union = self.nothing();
        objects.iter().filter_map(|id| self.objects.get(id)).for_each(|mask| union.unite(mask));
        union
    }

    /// The objects of which `mask` covers more than half.
    pub(super) fn mostly_in(&self, mask: &Mask) -> BTreeSet<SegmentId> {
        let covers = |object: &Mask| 2 * object.intersection_area(mask) > object.area();
        self.objects.iter().filter(|(_, object)| covers(object)).map(|(id, _)| *id).collect()
    }

    /// The object at a pixel; `None` where unlabelled.
    pub(super) fn object_at(&self, (column, row): (usize, usize)) -> Option<SegmentId> {
        Some(self.truth[(column, row)]).filter(|id| *id != 0)
    }

    /// The pixels of an object within city-block distance `reach` of a mask.
    pub(super) fn within_reach(&self, mask: &Mask, object: SegmentId, reach: f64) -> Mask {
        let (Some(object), false) = (self.objects.get(&object), mask.is_empty()) else { return self.nothing() };
        let steps = steps_from(mask);
        let width = mask.width();
        Mask::from_fn(width, mask.height(), |column, row| {
            f64::from(steps[row * width + column]) <= reach && object.contains(column, row)
        })
    }

    /// The object with the longest border with a mask. Ties go to the smallest id.
    pub(super) fn neighbour(&self, mask: &Mask) -> Option<SegmentId> {
        let steps = steps_from(mask);
        let mut borders: BTreeMap<SegmentId, usize> = BTreeMap::new();
        for (id, _) in self.truth.pixels().iter().zip(steps).filter(|(id, steps)| **id != 0 && *steps == 1) {
            *borders.entry(*id).or_insert(0) += 1;
        }
        borders.into_iter().max_by_key(|(id, length)| (*length, std::cmp::Reverse(*id))).map(|(id, _)| id)
    }
}

fn steps_from(mask: &Mask) -> Vec<u32> {
    let mut inside = vec![false; mask.width() * mask.height()];
    mask.pixel_indices().for_each(|index| inside[index] = true);
    distance_transform((mask.width(), mask.height()), |index| inside[index])
}
