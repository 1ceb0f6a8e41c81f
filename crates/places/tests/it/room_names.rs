//! Names of rooms: by hand, and from the objects in them.

use crate::seen_tour::SeenTour;
use glam::DVec3;
use splatseg_objects::{ObjectName, ObjectNames, RoomNameSource};
use splatseg_places::FloorPlan;

fn names(plan: &FloorPlan) -> Vec<Option<(&str, RoomNameSource)>> {
    plan.rooms().iter().map(|room| room.name.as_deref().zip(room.name_source)).collect()
}

/// Checks the names of the rooms of a tour with four rooms.
pub fn check(tour: &SeenTour) {
    let mut plan = tour.plan.clone();
    let mut given = ObjectNames::default();
    let objects: Vec<u32> = plan.footprints().keys().copied().collect();
    let in_room = |plan: &FloorPlan, room: u32| {
        *objects.iter().find(|id| plan.room_of(**id).is_some_and(|found| found.id == room)).unwrap()
    };
    // A bed by hand, a toilet by a network that is sure, and a stove by one that is not.
    let by_network =
        |label: &str, score| ObjectName { label: Some(label.to_owned()), score: Some(score), ..ObjectName::default() };
    given.set_by_hand(in_room(&plan, 1), Some("bed")).unwrap();
    given.set(in_room(&plan, 2), by_network("toilet", 0.8), 1.0).unwrap();
    given.set(in_room(&plan, 3), by_network("stove", 0.3), 1.0).unwrap();
    plan.name_rooms(&given);
    let derived = |name| Some((name, RoomNameSource::Derived));
    assert_eq!(names(&plan), [derived("bedroom"), derived("bathroom"), None, None]);

    // A person's name holds, and of two in one room the later one. A place in the wall names the room beside it.
    let place = plan.place_of(&plan.rooms()[0]);
    let by_hand = |name| Some((name, RoomNameSource::ByHand));
    given.rooms_mut().add(place, "guest room").unwrap();
    given.rooms_mut().add(plan.place_of(&plan.rooms()[3]), "hall").unwrap();
    given.rooms_mut().add(place + DVec3::new(0.1, 0.0, 1.0), "nursery").unwrap();
    given.rooms_mut().add(DVec3::new(1e3, 0.0, 0.0), "far away").unwrap();
    let saved = ObjectNames::from_bytes(&given.to_bytes()).unwrap();
    assert_eq!(saved, given);
    plan.name_rooms(&saved);
    assert_eq!(names(&plan), [by_hand("nursery"), derived("bathroom"), None, by_hand("hall")]);

    // The room is found by the place, whatever its number.
    given.rooms_mut().remove(|_| true);
    plan.name_rooms(&given);
    assert_eq!(names(&plan)[3], None);
}
