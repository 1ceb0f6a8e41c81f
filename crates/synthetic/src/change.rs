//! A scene before and after a change: things that are gone, new or moved.

use super::furniture::Lane;
use super::scenery::Scenery;
use super::solids::Solid;
use super::visibility::Visibility;
use super::walk::Walk;
use glam::Vec3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Intrinsics, LocalPose, SegmentId};
use std::collections::BTreeSet;

/// Random number stream, separate from those of the furnishing (0), the movers and the noise (rows of the image).
const RANDOM_STREAM: u64 = u64::MAX - 1;
/// Number of changes of each kind.
const GONE: usize = 3;
const MOVED: usize = 2;
const NEW: usize = 2;
/// Visibility is measured from this many poses of a round.
const VIEWS: usize = 48;
/// Changed things cover at least this fraction of the image (430 pixels of 320 × 240)...
const CLEAR_FRACTION: f32 = 0.0056;
/// ...from at least this many of the poses.
const CLEAR_VIEWS: usize = 4;
/// Least distance by which a thing is moved, metres.
const MIN_MOVE: f32 = 1.0;
/// Number of places tried for a moved thing, and of those that are free, the number whose visibility is tested.
const PLACES: usize = 400;
const TESTED_PLACES: usize = 12;

/// Time of a visit to a scene that changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Visit {
    /// Before the change.
    Before,
    /// After the change. The camera walks the same path from another start, in the other direction and 0.25 m higher.
    After,
}

impl Visit {
    /// Returns its name in settings.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Before => "before",
            Self::After => "after",
        }
    }
}

/// Kind of a [`TrueChange`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ChangeKind {
    /// It was there before and is not there after.
    Gone,
    /// It is only there after.
    New,
    /// It is at another place after.
    Moved,
}

/// A difference between a scene before and after. World coordinates, metres, z up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrueChange {
    /// Id of the thing in the ground truth of both visits.
    pub id: SegmentId,
    /// The kind of change.
    pub kind: ChangeKind,
    /// Its centre before; `None` for a new thing.
    pub before: Option<Vec3>,
    /// Its centre after; `None` if it is gone.
    pub after: Option<Vec3>,
    /// Size of its bounding box along the box's own axes. The third axis is vertical.
    pub size: Vec3,
    /// Mean sRGB colour of its texture, without shading.
    pub color: [u8; 3],
}

/// Chooses changes in a scene with all its things, including the new ones.
struct Chooser<'a> {
    scenery: &'a Scenery,
    intrinsics: &'a Intrinsics,
    random: ChaCha8Rng,
    /// Poses of both visits.
    poses: [Vec<LocalPose>; 2],
    /// Things that can be changed: nothing stands on them, they stand on the floor, and both visits see them.
    waiting: Vec<SegmentId>,
    /// Lanes of all things, and those of moved things at their new places.
    lanes: Vec<Lane>,
    /// Things that are not changed any more, since a twin of theirs is.
    settled: BTreeSet<SegmentId>,
    changes: Vec<TrueChange>,
}

/// Chooses the changes: one of several twins is gone and one of several other twins moved, the rest has no twins.
/// Ordered by id. `None` if there are too few clearly visible things.
pub(super) fn choose(scenery: &Scenery, intrinsics: &Intrinsics, seed: u64) -> Option<Vec<TrueChange>> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(RANDOM_STREAM);
    let poses = [Visit::Before, Visit::After].map(|visit| {
        let walk = Walk { is_other: visit == Visit::After, ..scenery.walk };
        (0..VIEWS).map(|view| walk.pose((view * walk.frames()) as f64 / VIEWS as f64)).collect()
    });
    let lanes = scenery.lanes().into_values().collect();
    let (waiting, settled, changes) = (Vec::new(), BTreeSet::new(), Vec::new());
    let mut chooser = Chooser { scenery, intrinsics, random, poses, waiting, lanes, settled, changes };
    chooser.find_candidates();
    chooser.choose_all()?;
    chooser.changes.sort_by_key(|change| change.id);
    Some(chooser.changes)
}

impl Chooser<'_> {
    fn visibility(&self, scenery: &Scenery) -> [Visibility; 2] {
        [0, 1].map(|visit| Visibility::new(scenery, self.intrinsics, &self.poses[visit]))
    }

    fn find_candidates(&mut self) {
        let visible = self.visibility(self.scenery);
        let on_floor = |id: &SegmentId| !self.scenery.carriers.contains_key(id);
        let mut waiting: Vec<SegmentId> =
            self.scenery.unloaded_things().filter(on_floor).filter(|id| is_clear(&visible, *id)).collect();
        // Fisher-Yates shuffle.
        for last in (1..waiting.len()).rev() {
            waiting.swap(last, self.random.random_range(0..=last));
        }
        self.waiting = waiting;
    }

    fn choose_all(&mut self) -> Option<()> {
        self.choose_kind(ChangeKind::Moved, true)?;
        self.choose_kind(ChangeKind::Gone, true)?;
        for (kind, count) in [(ChangeKind::Moved, MOVED - 1), (ChangeKind::Gone, GONE - 1), (ChangeKind::New, NEW)] {
            for _ in 0..count {
                self.choose_kind(kind, false)?;
            }
        }
        Some(())
    }

    /// Changes the first suitable thing.
    fn choose_kind(&mut self, kind: ChangeKind, is_twin: bool) -> Option<()> {
        for id in self.waiting.clone() {
            let group = self.scenery.twins.iter().find(|group| group.contains(&id));
            if self.settled.contains(&id) || group.is_some() != is_twin {
                continue;
            }
            let Some(thing) = self.scenery.things().find(|thing| thing.id == id) else { continue };
            let after = match kind {
                ChangeKind::Gone => None,
                ChangeKind::New => Some(thing.center),
                ChangeKind::Moved => match self.new_place(thing) {
                    None => continue,
                    place => place,
                },
            };
            let before = (kind != ChangeKind::New).then_some(thing.center);
            let (size, color) = (thing.shape.size(), thing.texture.mean_color());
            self.changes.push(TrueChange { id, kind, before, after, size, color });
            self.settled.extend(group.into_iter().flatten().copied().chain([id]));
            return Some(());
        }
        None
    }

    /// Returns a free place for a thing, seen in both visits, and marks it as occupied.
    fn new_place(&mut self, thing: &Solid) -> Option<Vec3> {
        let site = self.scenery.site_of(thing)?;
        let footprint = thing.shape.footprint();
        let mut tested = 0;
        for _ in 0..PLACES {
            let spot = site.random_spot(&mut self.random, footprint);
            let is_far = spot.distance(thing.center.truncate()) >= MIN_MOVE;
            if !is_far || !site.is_clear(spot, footprint, &self.lanes) {
                continue;
            }
            let center = spot.extend(thing.center.z);
            let mut scenery = self.scenery.clone();
            scenery.move_thing(thing.id, center);
            if is_clear(&self.visibility(&scenery), thing.id) {
                self.lanes.push(Lane::of(&Solid { center, ..thing.clone() }));
                return Some(center);
            }
            tested += 1;
            if tested == TESTED_PLACES {
                break;
            }
        }
        None
    }
}

fn is_clear(visits: &[Visibility; 2], id: SegmentId) -> bool {
    visits.iter().all(|visible| visible.clear_views(id, CLEAR_FRACTION) >= CLEAR_VIEWS)
}

/// Returns the scene during a visit. `scenery` contains all things, those that are moved at their places before.
pub(super) fn visited(scenery: &Scenery, changes: &[TrueChange], visit: Visit) -> Scenery {
    let mut scenery = scenery.clone();
    scenery.walk.is_other = visit == Visit::After;
    for change in changes {
        match (visit, change.before, change.after) {
            (Visit::Before, None, _) | (Visit::After, _, None) => scenery.remove_thing(change.id),
            (Visit::After, _, Some(place)) => scenery.move_thing(change.id, place),
            (Visit::Before, Some(_), _) => {}
        }
    }
    scenery
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{SyntheticSettings, room, tour};

    #[test]
    fn changes_are_found_in_nearly_every_room_and_places_are_free() {
        let intrinsics = Intrinsics { fx: 288.0, fy: 288.0, cx: 159.5, cy: 119.5, width: 320, height: 240 };
        let objects = SyntheticSettings::default().objects;
        let mut found = 0;
        for seed in 0..20 {
            let scenery = if seed < 17 { room::furnished(seed, objects, 4) } else { tour::furnished(seed, 4, objects) };
            let Some(changes) = choose(&scenery, &intrinsics, seed) else { continue };
            found += 1;
            for visit in [Visit::Before, Visit::After] {
                let now = visited(&scenery, &changes, visit);
                let lanes = now.lanes();
                for thing in now.things().filter(|thing| !now.carriers.contains_key(&thing.id)) {
                    let others = lanes.iter().filter(|(id, _)| **id != thing.id && !now.carriers.contains_key(id));
                    let others: Vec<Lane> = others.map(|(_, lane)| *lane).collect();
                    let (spot, footprint) = (thing.center.truncate(), thing.shape.footprint());
                    let site = now.site_of(thing).unwrap();
                    assert!(site.is_inside(spot, footprint) && site.is_clear(spot, footprint, &others), "seed {seed}");
                }
            }
        }
        assert!(found >= 18, "changes in {found} of 20 scenes");
    }
}
