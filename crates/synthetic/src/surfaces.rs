//! Exact surfaces of a scene, to measure the errors of others.

use super::SyntheticScene;
use super::solids::{Shape, Solid};
use glam::{Vec2, Vec3};

impl SyntheticScene {
    /// Distance of a point from the nearest surface in a frame, metres, whether the camera sees that or not. World
    /// coordinates.
    pub fn distance_to_surface(&self, point: Vec3, frame: usize) -> f32 {
        if self.movers.is_empty() {
            return distance(&self.scenery.solids, point);
        }
        distance(&self.scenery.at(frame, &self.movers).solids, point)
    }
}

fn distance(solids: &[Solid], point: Vec3) -> f32 {
    solids.iter().map(|solid| solid.distance(point)).fold(f32::INFINITY, f32::min)
}

impl Solid {
    /// Distance of a point from the solid's surface, metres, also for points inside.
    fn distance(&self, point: Vec3) -> f32 {
        let from_center = point - self.center;
        let turned = Vec2::new(self.turn.x, -self.turn.y).rotate(from_center.truncate());
        self.shape.signed_distance(turned.extend(from_center.z)).abs()
    }
}

impl Shape {
    /// Distance of a point from the surface, negative inside, in the shape's coordinates.
    fn signed_distance(self, point: Vec3) -> f32 {
        let of_corner = |beyond: Vec3| beyond.max(Vec3::ZERO).length() + beyond.max_element().min(0.0);
        match self {
            Self::Box(half) => of_corner(point.abs() - half),
            Self::Sphere(radius) => point.length() - radius,
            Self::Cylinder(radius, half) => {
                let beyond = Vec2::new(point.truncate().length() - radius, point.z.abs() - half);
                beyond.max(Vec2::ZERO).length() + beyond.max_element().min(0.0)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SyntheticSettings;
    use crate::rays::Caster;

    #[test]
    fn points_that_rays_hit_are_on_a_surface() {
        let scene = SyntheticScene::new(SyntheticSettings { moving: 3, ..SyntheticSettings::default() }).unwrap();
        for frame in [0, 17, 40] {
            let (image, scenery) = (scene.cast_rays(frame), scene.scenery.at(frame, &scene.movers));
            let caster = Caster { scenery: &scenery, intrinsics: scene.intrinsics, pose: scene.camera_pose(frame) };
            for (column, row) in
                (0..240).step_by(7).flat_map(|row| (0..320).step_by(9).map(move |column| (column, row)))
            {
                let ray = caster.direction((column, row));
                let depth = image[(column, row)].depth;
                let at = |along: f32| scene.distance_to_surface(caster.pose.translation() + ray * along, frame);
                assert!(at(depth) < 1e-4, "{column}, {row}: {}", at(depth));
                assert!(at(0.9 * depth) > 0.0 && at(0.9 * depth) <= 0.11 * depth * ray.length());
            }
        }
        assert!((Shape::Cylinder(0.3, 0.5).signed_distance(Vec3::new(0.7, 0.0, 0.8)) - 0.5).abs() < 1e-6);
        assert!((Shape::Box(Vec3::splat(0.5)).signed_distance(Vec3::new(0.4, 0.0, 0.0)) + 0.1).abs() < 1e-6);
    }
}
