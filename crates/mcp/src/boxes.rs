//! Distances between boxes, and what they cover of the floor.

use glam::{DQuat, DVec2, DVec3};
use splatseg_objects::OrientedBox;

/// Steps of the search for the nearest points of two boxes.
const STEPS: usize = 200;
/// The search ends when a step changes the distance by less, metres.
const SETTLED: f64 = 1e-5;

/// Places this far outside a box count as in it, metres.
const EDGE: f64 = 0.01;

/// A box of any orientation, in double precision. World coordinates, metres.
#[derive(Clone, Copy, Debug)]
pub struct SolidBox {
    center: DVec3,
    half: DVec3,
    rotation: DQuat,
}

impl SolidBox {
    pub fn new(of: &OrientedBox) -> Self {
        Self { center: of.center, half: of.size.as_dvec3() / 2.0, rotation: of.rotation.as_dquat().normalize() }
    }

    /// A box without extent.
    pub fn point(center: DVec3) -> Self {
        Self { center, half: DVec3::ZERO, rotation: DQuat::IDENTITY }
    }

    /// Its centre.
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// The point of the box that is nearest to a place.
    fn nearest_to(&self, place: DVec3) -> DVec3 {
        let own = self.rotation.inverse() * (place - self.center);
        self.center + self.rotation * own.clamp(-self.half, self.half)
    }

    /// True if a place is in the box or nearly so.
    pub fn has(&self, place: DVec3) -> bool {
        self.nearest_to(place).distance(place) <= EDGE
    }

    /// The nearest points of this box and another one; the same point twice if they overlap. Projects a point onto either
    /// box in turn, which converges to the nearest pair of two convex sets (Cheney and Goldstein 1959).
    pub fn nearest_pair(&self, other: &Self) -> (DVec3, DVec3) {
        let (mut own, mut distance) = (self.center, f64::INFINITY);
        let mut there = other.nearest_to(own);
        for _ in 0..STEPS {
            own = self.nearest_to(there);
            there = other.nearest_to(own);
            let now = own.distance(there);
            if distance - now < SETTLED {
                break;
            }
            distance = now;
        }
        (own, there)
    }

    /// Distance to another box, metres; 0 if they touch.
    pub fn distance(&self, other: &Self) -> f64 {
        let (own, there) = self.nearest_pair(other);
        own.distance(there)
    }

    /// Its corners.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|corner| {
            let side = |axis: usize| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
            self.center + self.rotation * (self.half * DVec3::new(side(0), side(1), side(2)))
        })
    }

    /// Lowest and highest point along a direction.
    pub fn extent(&self, direction: DVec3) -> (f64, f64) {
        let heights = self.corners().map(|corner| corner.dot(direction));
        (heights.into_iter().fold(f64::INFINITY, f64::min), heights.into_iter().fold(f64::NEG_INFINITY, f64::max))
    }
}

/// The convex polygon around points, counter-clockwise (Andrew's monotone chain).
pub fn convex_hull(mut points: Vec<DVec2>) -> Vec<DVec2> {
    points.sort_by(|one, other| one.x.total_cmp(&other.x).then(one.y.total_cmp(&other.y)));
    points.dedup_by(|one, other| one.distance(*other) < 1e-9);
    if points.len() < 3 {
        return points;
    }
    let half = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for point in points {
            while let [.., before, last] = chain[..] {
                if (last - before).perp_dot(point - last) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut hull = half(&mut points.iter().copied());
    hull.extend(half(&mut points.iter().rev().copied()));
    hull
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Quat, Vec3};
    use std::f32::consts::FRAC_PI_4;

    fn solid(center: [f64; 3], size: [f32; 3], turn: f32) -> SolidBox {
        let rotation = Quat::from_rotation_z(turn);
        SolidBox::new(&OrientedBox { center: center.into(), size: Vec3::from(size), rotation })
    }

    #[test]
    fn distances_are_those_of_the_nearest_points() {
        let unit = solid([0.0; 3], [1.0; 3], 0.0);
        assert!((unit.distance(&solid([2.0, 0.3, 0.0], [1.0; 3], 0.0)) - 1.0).abs() < 1e-4);
        // A box on its edge reaches half a diagonal further.
        let turned = solid([2.0, 0.0, 0.0], [1.0; 3], FRAC_PI_4);
        assert!((unit.distance(&turned) - (1.5 - 0.5f64.sqrt())).abs() < 1e-4, "{}", unit.distance(&turned));
        assert!(unit.distance(&solid([0.4, 0.0, 0.0], [1.0; 3], 0.1)) < 1e-9);
        assert!((unit.distance(&SolidBox::point(DVec3::new(0.5, 0.5, 1.5))) - 1.0).abs() < 1e-9);
        // Two corners.
        let corner = solid([2.0, 2.0, 0.0], [1.0; 3], 0.0);
        assert!((corner.distance(&unit) - 2f64.sqrt()).abs() < 1e-4);
        assert_eq!(turned.extent(DVec3::Z), (-0.5, 0.5));
    }

    #[test]
    fn a_hull_has_the_outer_points_only() {
        let points = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0], [1.0, 0.5], [1.0, 0.0]].map(DVec2::from);
        assert_eq!(convex_hull(points.to_vec()), [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [0.0, 1.0]].map(DVec2::from));
        assert_eq!(convex_hull(vec![DVec2::ZERO; 3]), [DVec2::ZERO]);
    }
}
