//! Relations between objects that are certain from geometry: on, in, under, beside. `docs/OBJECTS.md` defines each for
//! users.
//!
//! A wrong relation is worse than a missing one, so each needs surfaces that were seen all around the contact.

mod contact;
mod upright;

use crate::ObjectSurfaces;
use contact::{is_beside, is_under, surroundings};
use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{MapView, SegmentId};
use std::collections::BTreeMap;
use upright::Upright;

/// How an object is placed relative to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RelationKind {
    /// It stands or lies on the other, whose surface was seen around its foot.
    On,
    /// The other is around its lower part, and below it: fruit in a bowl.
    In,
    /// The other is above all of it and not farther than a metre: a box under a table.
    Under,
    /// Both are on the same thing, within 20 cm of each other. The one with the lower id is the subject.
    Beside,
}

/// A relation between two objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Relation {
    /// Id of the object that is on, in, under or beside the other.
    pub subject: SegmentId,
    /// How it is placed.
    pub relation: RelationKind,
    /// Id of the other object.
    pub object: SegmentId,
}

/// The relations between the objects of a map that count, by subject. `up` is a unit vector in world coordinates.
pub fn relations(map: &MapView<'_>, up: Vec3) -> Vec<Relation> {
    relations_of(map, &ObjectSurfaces::of(map), up)
}

/// As [`relations`], with the surfaces of the map's objects.
pub fn relations_of(map: &MapView<'_>, surfaces: &ObjectSurfaces, up: Vec3) -> Vec<Relation> {
    let carried = map.carried_ids();
    let objects: Vec<Upright> = surfaces
        .points()
        .par_iter()
        .filter(|(id, _)| carried.contains(id) && !map.is_tentative(**id))
        .filter_map(|(id, points)| Upright::new(*id, points, up))
        .collect();
    let placed: Vec<Option<Relation>> = objects.par_iter().map(|object| placed(object, &objects)).collect();
    let supporters: BTreeMap<SegmentId, Relation> =
        placed.into_iter().flatten().map(|relation| (relation.subject, relation)).collect();
    let mut found: Vec<Relation> = supporters.values().copied().collect();
    let others: Vec<Vec<Relation>> =
        objects.par_iter().map(|object| under_and_beside(object, &objects, &supporters)).collect();
    found.extend(others.into_iter().flatten());
    found.sort_unstable();
    found
}

/// The object that another one is on or in: one at most, whose surface surrounds it clearly more than any other does.
fn placed(object: &Upright, objects: &[Upright]) -> Option<Relation> {
    let others = objects.iter().filter(|other| other.id != object.id && object.may_be_on(other));
    let mut found: Vec<_> = others.map(|other| (surroundings(object, other), other.id)).collect();
    found.sort_by_key(|(around, id)| (std::cmp::Reverse(around.at_foot), *id));
    let (best, other) = *found.first()?;
    let relation = |relation| Some(Relation { subject: object.id, relation, object: other });
    let next = found.get(1).map_or(0, |(around, _)| around.at_foot);
    if best.is_around_lower_part() {
        return relation(RelationKind::In);
    }
    (best.is_at_foot() && next + 2 <= best.at_foot).then_some(())?;
    relation(RelationKind::On)
}

fn under_and_beside(
    object: &Upright,
    objects: &[Upright],
    supporters: &BTreeMap<SegmentId, Relation>,
) -> Vec<Relation> {
    let on = |id: SegmentId| supporters.get(&id).filter(|one| one.relation == RelationKind::On).map(|one| one.object);
    let mut found = Vec::new();
    for other in objects.iter().filter(|other| other.id != object.id) {
        let is_carried = on(other.id) == Some(object.id) || on(object.id) == Some(other.id);
        if !is_carried && is_under(object, other) {
            found.push(Relation { subject: object.id, relation: RelationKind::Under, object: other.id });
        }
        let same = on(object.id).is_some() && on(object.id) == on(other.id);
        if same && object.id < other.id && is_beside(object, other) {
            found.push(Relation { subject: object.id, relation: RelationKind::Beside, object: other.id });
        }
    }
    found
}
