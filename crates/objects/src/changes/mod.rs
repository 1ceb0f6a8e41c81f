//! Changes between two maps of a place: the content of `changes.json`. `docs/MAP_CHANGES.md` describes each key
//! for users.
//!
//! An object is gone only if the later run looked through its place, and new only if the earlier run did. The views of
//! the keyframes decide (`views.rs`). Of the gone and the new ones, those of the same shape and colour have moved
//! (`moved.rs`).

mod moved;
mod views;

pub use views::{DepthView, PlaceSight, place_sights};

use crate::{ObjectShape, object_shapes};
use glam::{DVec3, IVec3};
use moved::{Appearance, pairs};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{MapView, SegmentId};
use std::collections::BTreeMap;
use views::sight;

/// An object is judged by at most this many of its points.
const MAX_POINTS: usize = 300;

/// Objects with fewer Gaussians are left out: fragments and mistakes.
const MIN_POINTS: usize = 12;

/// At least this share of an object's points must have been looked at.
const MIN_OBSERVED: f64 = 0.3;

/// An object's place is empty if this share of its observed points is.
const MIN_EMPTY: f64 = 0.5;

/// Two objects are at the same place if their points are in the same cells of this side, metres.
const CELL: f64 = 0.06;

/// The objects of a map, and what a run saw.
#[derive(Clone, Debug, Default)]
pub struct ObservedMap {
    objects: Vec<MapObject>,
    views: Vec<DepthView>,
}

#[derive(Clone, Debug)]
struct MapObject {
    id: SegmentId,
    shape: ObjectShape,
    /// Centres of its Gaussians, world coordinates, metres.
    points: Vec<DVec3>,
    appearance: Appearance,
}

/// Differences between two maps of a place.
///
/// Programs read `changes.json` with `serde_json::from_str::<MapChanges>`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapChanges {
    /// [`MapChanges::FORMAT`].
    pub format: String,
    /// [`MapChanges::VERSION`].
    pub version: u32,
    /// Objects whose place is empty now, by id.
    pub gone: Vec<ChangedObject>,
    /// Objects whose place was empty before, by id.
    pub new: Vec<ChangedObject>,
    /// Objects that are at another place, by the id before.
    pub moved: Vec<MovedObject>,
    /// Objects that are still there, by the id before.
    pub unchanged: Vec<UnchangedObject>,
    /// Objects whose place the later run did not look at, by id.
    pub not_looked_at: Vec<ChangedObject>,
    /// Objects at places that the earlier run did not look at, by id.
    pub newly_seen: Vec<ChangedObject>,
}

/// An object of one of the maps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ChangedObject {
    /// Its id in its map.
    pub id: SegmentId,
    /// Its shape, world coordinates.
    pub shape: ObjectShape,
    /// Share of its points, 0 to 1, that the other run looked at.
    pub observed: f64,
    /// Share of these, 0 to 1, that agree with the verdict; of objects in `not_looked_at` and `newly_seen`, the share of all
    /// points that the other run did not look at.
    pub confidence: f64,
}

/// An object that is at another place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MovedObject {
    /// The object in the earlier map.
    pub before: ChangedObject,
    /// The object in the later map.
    pub after: ChangedObject,
    /// Distance between the centres of the two boxes, metres.
    pub distance: f64,
}

/// An object that is still there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct UnchangedObject {
    /// Its id in the earlier map.
    pub id: SegmentId,
    /// Its id in the later map; null if no object there covers most of it.
    pub id_after: Option<SegmentId>,
}

/// How a run saw the place of an object: shares of all points, and of the observed ones.
#[derive(Clone, Copy, Debug)]
struct Verdict {
    observed: f64,
    empty: f64,
}

impl ObservedMap {
    /// The objects of a map that were seen in two frames or more, and the views of a run.
    pub fn new(map: &MapView<'_>, views: Vec<DepthView>) -> Self {
        let mut gaussians: BTreeMap<SegmentId, Vec<usize>> = BTreeMap::new();
        for (index, (id, surface)) in map.segment_ids().into_iter().zip(map.surfaces).enumerate() {
            if surface.has_place() {
                gaussians.entry(id).or_default().push(index);
            }
        }
        let shapes = object_shapes(map).into_iter();
        let object = |(id, shape): (SegmentId, ObjectShape)| {
            let of_object = gaussians.get(&id).filter(|gaussians| gaussians.len() >= MIN_POINTS)?;
            let points = of_object.iter().map(|index| map.means[*index].as_dvec3() + map.origin).collect();
            let colors = of_object.iter().map(|index| (map.colors[*index], map.radii[*index].powi(2)));
            let appearance = Appearance::new(colors, shape.oriented_box.size);
            (!map.is_tentative(id)).then_some(MapObject { id, shape, points, appearance })
        };
        Self { objects: shapes.filter_map(object).collect(), views }
    }

    /// The appearances of some of its objects.
    fn appearances(&self, objects: &[ChangedObject]) -> Vec<&Appearance> {
        let of = |object: &ChangedObject| self.objects.iter().find(|other| other.id == object.id);
        objects.iter().filter_map(of).map(|object| &object.appearance).collect()
    }
}

impl MapObject {
    fn seen_by(&self, views: &[DepthView]) -> Verdict {
        let step = self.points.len().div_ceil(MAX_POINTS);
        let points: Vec<&DVec3> = self.points.iter().step_by(step).collect();
        let sights: Vec<PlaceSight> = points.par_iter().map(|point| sight(views, **point)).collect();
        let count = |kind| sights.iter().filter(|sight| **sight == kind).count() as f64;
        let (seen, empty) = (count(PlaceSight::Seen), count(PlaceSight::Empty));
        let observed = seen + empty;
        Verdict { observed: observed / sights.len().max(1) as f64, empty: empty / observed.max(1.0) }
    }

    fn with(&self, verdict: Verdict, confidence: f64) -> ChangedObject {
        let rounded = |share: f64| (share * 1e3).round() / 1e3;
        ChangedObject {
            id: self.id,
            shape: self.shape.clone(),
            observed: rounded(verdict.observed),
            confidence: rounded(confidence),
        }
    }
}

impl Verdict {
    fn is_observed(self) -> bool {
        self.observed >= MIN_OBSERVED
    }

    fn is_empty(self) -> bool {
        self.is_observed() && self.empty >= MIN_EMPTY
    }
}

impl MapChanges {
    /// The value of the key `format`.
    pub const FORMAT: &'static str = "splatseg-changes";
    /// The value of the key `version`.
    pub const VERSION: u32 = 1;

    /// Compares two maps in the same world coordinates. The views of `after` are those of the later run only.
    pub fn between(before: &ObservedMap, after: &ObservedMap) -> Self {
        let mut changes = Self {
            format: Self::FORMAT.to_owned(),
            version: Self::VERSION,
            gone: Vec::new(),
            new: Vec::new(),
            moved: Vec::new(),
            unchanged: Vec::new(),
            not_looked_at: Vec::new(),
            newly_seen: Vec::new(),
        };
        let places = Places::new(&after.objects);
        for object in &before.objects {
            let verdict = object.seen_by(&after.views);
            if verdict.is_empty() {
                changes.gone.push(object.with(verdict, verdict.empty));
            } else if verdict.is_observed() {
                changes.unchanged.push(UnchangedObject { id: object.id, id_after: places.most(object) });
            } else {
                changes.not_looked_at.push(object.with(verdict, 1.0 - verdict.observed));
            }
        }
        for object in &after.objects {
            let now = object.seen_by(&after.views);
            if !now.is_observed() || now.empty >= MIN_EMPTY {
                continue;
            }
            let verdict = object.seen_by(&before.views);
            if verdict.is_empty() {
                changes.new.push(object.with(verdict, verdict.empty));
            } else if !verdict.is_observed() {
                changes.newly_seen.push(object.with(verdict, 1.0 - verdict.observed));
            }
        }
        changes.pair_moved(before, after);
        changes
    }

    /// Finds the gone and new objects that are the same thing.
    fn pair_moved(&mut self, before: &ObservedMap, after: &ObservedMap) {
        let (gone, new) = (before.appearances(&self.gone), after.appearances(&self.new));
        let pairs = pairs(&gone, &new);
        for (gone, new) in &pairs {
            let (before, after) = (self.gone[*gone].clone(), self.new[*new].clone());
            let distance = before.shape.oriented_box.center.distance(after.shape.oriented_box.center);
            self.moved.push(MovedObject { before, after, distance: (distance * 1e4).round() / 1e4 });
        }
        let is_moved = |id: SegmentId, side: fn(&MovedObject) -> SegmentId, moved: &[MovedObject]| {
            moved.iter().any(|object| side(object) == id)
        };
        self.gone.retain(|object| !is_moved(object.id, |moved| moved.before.id, &self.moved));
        self.new.retain(|object| !is_moved(object.id, |moved| moved.after.id, &self.moved));
        self.moved.sort_by_key(|moved| moved.before.id);
    }
}

/// The objects of a map by place.
struct Places(BTreeMap<[i32; 3], BTreeMap<SegmentId, usize>>);

impl Places {
    fn new(objects: &[MapObject]) -> Self {
        let mut places: BTreeMap<[i32; 3], BTreeMap<SegmentId, usize>> = BTreeMap::new();
        for object in objects {
            for point in &object.points {
                *places.entry(cell(*point).to_array()).or_default().entry(object.id).or_default() += 1;
            }
        }
        Self(places)
    }

    /// The object that covers most of another one's place, if it covers half.
    fn most(&self, object: &MapObject) -> Option<SegmentId> {
        let mut counts: BTreeMap<SegmentId, usize> = BTreeMap::new();
        for point in &object.points {
            let here = self.0.get(&cell(*point).to_array()).into_iter().flatten();
            // Of several objects in a cell the one with the most points.
            if let Some((id, _)) = here.max_by_key(|(id, count)| (**count, std::cmp::Reverse(**id))) {
                *counts.entry(*id).or_default() += 1;
            }
        }
        let (id, count) = counts.into_iter().max_by_key(|(id, count)| (*count, std::cmp::Reverse(*id)))?;
        (2 * count >= object.points.len()).then_some(id)
    }
}

fn cell(point: DVec3) -> IVec3 {
    (point / CELL).floor().as_ivec3()
}
