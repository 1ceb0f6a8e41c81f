//! Names of rooms. A name belongs to a place on the floor, not to a room's number: numbers change when the map grows.

use crate::NameError;
use crate::names::check_label;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{KeyframeId, MapCorrection, Pose};

/// Largest number of names.
const MOST: usize = 1000;

/// A name that a person gave a room.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RoomName {
    /// A place in the room, in world coordinates, metres.
    pub place: DVec3,
    /// A word or a few, e.g. `kitchen`.
    pub name: String,
}

/// The place to which a correction of the map moves a place, world coordinates, metres: as the keyframe whose camera was
/// nearest. `cameras` are at world coordinates before the correction; without any, the place stays.
pub fn moved_with_nearest(correction: &MapCorrection, cameras: &[(KeyframeId, DVec3)], place: DVec3) -> DVec3 {
    let distance = |(_, camera): &&(KeyframeId, DVec3)| camera.distance_squared(place);
    let nearest = cameras.iter().min_by(|one, other| distance(one).total_cmp(&distance(other)));
    nearest.map_or(place, |(keyframe, _)| correction.moved(*keyframe, place))
}

/// Who has named a room.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RoomNameSource {
    /// A person.
    ByHand,
    /// The labels of its objects: a room with a bed is a bedroom.
    Derived,
}

/// The names that persons gave the rooms of a map, in the order in which they were given. Of two names of one room, the
/// later one holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RoomNames {
    names: Vec<RoomName>,
}

impl RoomNames {
    /// True if no room was named.
    pub fn is_empty(&self) -> bool {
        self.names.is_empty()
    }

    /// The names, in the order in which they were given.
    pub fn iter(&self) -> impl DoubleEndedIterator<Item = &RoomName> {
        self.names.iter()
    }

    /// Names the room around a place, in world coordinates, metres. The name is trimmed.
    ///
    /// # Errors
    /// [`NameError`] if the name cannot be used, is empty, or is one too many.
    pub fn add(&mut self, place: DVec3, name: &str) -> Result<(), NameError> {
        let name = name.trim();
        check_label(name)?;
        let wrong = |problem| Err(NameError::Label { found: name.chars().take(20).collect(), problem });
        if name.is_empty() {
            return wrong("no letters");
        }
        if !place.is_finite() {
            return wrong("a place that is not finite");
        }
        if self.names.len() >= MOST {
            return wrong("1000 named rooms before it already");
        }
        self.names.push(RoomName { place, name: name.to_owned() });
        Ok(())
    }

    /// Moves each place with the keyframe whose camera, at these world coordinates before the correction, was nearest.
    pub fn correct(&mut self, correction: &MapCorrection, cameras: &[(KeyframeId, DVec3)]) {
        for named in &mut self.names {
            named.place = moved_with_nearest(correction, cameras, named.place);
        }
    }

    /// Drops the names of places for which `is_dropped` is true.
    pub fn remove(&mut self, is_dropped: impl Fn(DVec3) -> bool) {
        self.names.retain(|named| !is_dropped(named.place));
    }

    /// Adds the names of another map, whose world has this pose in the world of this one. They hold where both have named a
    /// room.
    ///
    /// # Errors
    /// As [`Self::add`].
    pub fn add_all(&mut self, other: &Self, self_from_other: &Pose) -> Result<(), NameError> {
        let place = |place: DVec3| self_from_other.rotation() * place + self_from_other.translation();
        other.names.iter().try_for_each(|named| self.add(place(named.place), &named.name))
    }

    pub(crate) fn to_json(&self) -> Option<&[RoomName]> {
        (!self.names.is_empty()).then_some(&self.names)
    }

    /// Names from a file.
    pub(crate) fn checked(saved: Vec<RoomName>) -> Result<Self, NameError> {
        let mut names = Self::default();
        saved.into_iter().try_for_each(|named| names.add(named.place, &named.name))?;
        Ok(names)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_move_with_the_keyframe_that_was_nearest() {
        let mut names = RoomNames::default();
        for (x, name) in [(0.5, "hall"), (4.0, "kitchen")] {
            names.add(DVec3::new(x, 0.0, 0.0), name).unwrap();
        }
        let new_from_old = [(1, Pose::from_translation(DVec3::new(0.0, 0.3, 0.0)))].into();
        let correction = MapCorrection { new_from_old, joined: Vec::new() };
        names.correct(&correction, &[(0, DVec3::Z), (1, DVec3::new(4.0, 1.0, 1.0))]);
        let places: Vec<DVec3> = names.iter().map(|named| named.place).collect();
        assert_eq!(places, [DVec3::new(0.5, 0.0, 0.0), DVec3::new(4.0, 0.3, 0.0)]);
        names.correct(&correction, &[]);
        assert_eq!(names.iter().map(|named| named.place).collect::<Vec<_>>(), places, "no keyframe is known");
    }

    #[test]
    fn names_that_cannot_be_used_are_refused_and_others_move_with_the_map() {
        let mut names = RoomNames::default();
        for wrong in ["", "  ", "a\nb", &"x".repeat(1001)] {
            assert!(names.add(DVec3::ZERO, wrong).is_err(), "{wrong:?}");
        }
        assert!(names.add(DVec3::NAN, "hall").is_err() && names.is_empty());
        names.add(DVec3::new(1.0, 2.0, 0.0), " hall ").unwrap();
        let mut other = RoomNames::default();
        other.add_all(&names, &Pose::from_translation(DVec3::new(0.5, 0.0, 1.0))).unwrap();
        let expected = RoomName { place: DVec3::new(1.5, 2.0, 1.0), name: "hall".to_owned() };
        assert_eq!(other.iter().collect::<Vec<_>>(), [&expected]);
        other.remove(|place| place.x > 1.0);
        assert!(other.is_empty());
        assert!(RoomNames::checked(vec![expected; MOST + 1]).is_err());
    }
}
