//! Which places of a scene are free, from its exact geometry.

use super::SyntheticScene;
use super::solids::{Shape, Solid};
use glam::Vec2;

impl SyntheticScene {
    /// Returns true if something stands at a place between two heights above the floor, metres: a wall, or a thing at its
    /// initial position.
    pub fn is_occupied(&self, place: Vec2, heights: (f32, f32)) -> bool {
        self.scenery.solids.iter().any(|solid| solid.stands_at(place, heights))
    }

    /// Returns the number of the room that a place is in, from 0; in the doorways between rooms there is none. A corridor
    /// is one room.
    pub fn room_at(&self, place: Vec2) -> Option<usize> {
        self.scenery.areas.iter().position(|area| area.contains(place))
    }
}

impl Solid {
    fn stands_at(&self, place: Vec2, (low, high): (f32, f32)) -> bool {
        let half_height = self.shape.half_height();
        if self.center.z + half_height <= low || self.center.z - half_height >= high {
            return false;
        }
        let offset = Vec2::new(self.turn.x, -self.turn.y).rotate(place - self.center.truncate());
        match self.shape {
            Shape::Box(half) => offset.abs().cmple(half.truncate()).all(),
            Shape::Cylinder(radius, _) => offset.length() <= radius,
            Shape::Sphere(radius) => {
                // The widest part between the two heights.
                let apart = (low - self.center.z).max(self.center.z - high).max(0.0);
                offset.length_squared() <= radius * radius - apart * apart
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_walls_and_doorways_are_told_apart() {
        let scene = SyntheticScene::new("synthetic:tour=4,seed=3".parse().unwrap()).unwrap();
        let robot = (0.1, 1.8);
        // The doorway between rooms 0 and 1, below its lintel; the wall beside it.
        assert!(!scene.is_occupied(Vec2::new(0.0, 2.33), robot) && scene.is_occupied(Vec2::new(0.0, 2.33), (0.1, 2.2)));
        assert!(scene.is_occupied(Vec2::new(0.04, 3.5), robot));
        assert_eq!(
            [Vec2::ONE, Vec2::new(-1.0, 1.0), Vec2::new(0.0, 2.33)].map(|place| scene.room_at(place)),
            [Some(0), Some(1), None]
        );
        for thing in scene.things() {
            let (top, place) = (thing.center.z + thing.size.z / 2.0, thing.center.truncate());
            assert!(scene.is_occupied(place, (0.0, top)), "{thing:?}");
            let beside = place + Vec2::from_angle(thing.turn) * (thing.size.x / 2.0 + 0.01);
            assert!(
                scene.is_occupied(beside - Vec2::from_angle(thing.turn) * 0.02, (thing.center.z - 0.01, top)),
                "{thing:?}"
            );
        }
    }
}
