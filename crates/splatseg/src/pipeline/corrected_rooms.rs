//! Rooms, and the names of rooms, move with a corrected map.

use super::Pipeline;
use glam::DVec3;
use splatseg_geometry::{KeyframeId, MapCorrection, Pose};
use splatseg_odometry::KeyframePlace;
use splatseg_places::KnownRooms;
use std::collections::BTreeMap;

impl Pipeline {
    /// Moves rooms and their names with the map. The keyframes have their corrected poses.
    pub(super) fn correct_rooms(&mut self, correction: &MapCorrection) {
        let (names, rooms) = (&mut self.names.names, &mut self.history.rooms);
        if names.rooms().is_empty() && rooms.is_empty() {
            return;
        }
        let camera = |(id, place): (KeyframeId, KeyframePlace)| {
            let old_from_new = correction.new_from_old.get(&id).map_or(Pose::IDENTITY, Pose::inverse);
            (id, (old_from_new * place.world_from_keyframe).translation())
        };
        let cameras: Vec<(KeyframeId, DVec3)> = self.poses.keyframes().into_iter().map(camera).collect();
        names.rooms_mut().correct(correction, &cameras);
        rooms.correct(correction, &cameras);
    }

    /// Sets the rooms so far to those of a plan that was begun when the keyframes were where `begun` has them. If they have
    /// been corrected since, the rooms move with them.
    pub(super) fn set_rooms_of_plan(&mut self, mut rooms: KnownRooms, begun: &BTreeMap<KeyframeId, KeyframePlace>) {
        let now = self.poses.keyframes();
        let moved = begun.iter().filter_map(|(id, before)| {
            let (before, now) = (before.world_from_keyframe, now.get(id)?.world_from_keyframe);
            (before != now).then(|| (*id, now * before.inverse()))
        });
        let correction = MapCorrection { new_from_old: moved.collect(), joined: Vec::new() };
        if !correction.new_from_old.is_empty() {
            let camera = |(id, place): (&KeyframeId, &KeyframePlace)| (*id, place.world_from_keyframe.translation());
            rooms.correct(&correction, &begun.iter().map(camera).collect::<Vec<_>>());
        }
        self.set_rooms(rooms);
    }
}
