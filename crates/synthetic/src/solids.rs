//! Intersection of rays with the solids of the room, all in world coordinates (metres, z up).

use super::texture::Texture;
use glam::{Vec2, Vec3};
use splatseg_geometry::SegmentId;

/// Hits nearer than this (in units of the ray's direction) are self-intersections at the ray's start.
const NEAREST: f32 = 1e-3;

/// A ray; positions on it are `origin + t * direction`, `t > 0`. The direction need not have unit length.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub(super) origin: Vec3,
    pub(super) direction: Vec3,
}

/// First intersection of a ray with a solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub(super) t: f32,
    /// The same point in the solid's own coordinates, for its texture.
    pub(super) point_local: Vec3,
    /// Outward unit normal, world coordinates.
    pub(super) normal: Vec3,
}

/// A shape in its own coordinates, centred at the origin, upright.
#[derive(Clone, Copy, Debug)]
pub(super) enum Shape {
    /// Half the size along each axis, metres.
    Box(Vec3),
    /// Radius, metres.
    Sphere(f32),
    /// Radius and half the height, metres.
    Cylinder(f32, f32),
}

/// One instance in the room.
#[derive(Clone, Debug)]
pub(super) struct Solid {
    pub(super) id: SegmentId,
    pub(super) shape: Shape,
    pub(super) center: Vec3,
    /// Rotation about the vertical axis, as (cosine, sine).
    pub(super) turn: Vec2,
    pub(super) texture: Texture,
}

impl Shape {
    /// Returns half the height, metres.
    pub(super) fn half_height(self) -> f32 {
        match self {
            Self::Box(half) => half.z,
            Self::Sphere(radius) => radius,
            Self::Cylinder(_, half_height) => half_height,
        }
    }

    /// Returns the radius of the shape's footprint on the floor, whatever its rotation, metres.
    pub(super) fn footprint(self) -> f32 {
        match self {
            Self::Box(half) => half.truncate().length(),
            Self::Sphere(radius) | Self::Cylinder(radius, _) => radius,
        }
    }

    /// Returns the size of the smallest box around the shape, along its own axes, metres.
    pub(super) fn size(self) -> Vec3 {
        match self {
            Self::Box(half) => 2.0 * half,
            Self::Sphere(radius) => Vec3::splat(2.0 * radius),
            Self::Cylinder(radius, half_height) => Vec3::new(2.0 * radius, 2.0 * radius, 2.0 * half_height),
        }
    }

    /// Returns the distance along the ray and the outward normal, both in the shape's coordinates.
    fn hit(self, ray: Ray) -> Option<(f32, Vec3)> {
        match self {
            Self::Box(half) => hit_box(ray, half),
            Self::Sphere(radius) => {
                let t = quadratic_entry(ray.origin, ray.direction, radius)?;
                Some((t, (ray.origin + t * ray.direction) / radius))
            }
            Self::Cylinder(radius, half_height) => hit_cylinder(ray, radius, half_height),
        }
    }
}

impl Solid {
    /// Returns the first point, from outside, where the ray hits the solid.
    pub(super) fn hit(&self, ray: Ray) -> Option<Hit> {
        let local = Ray {
            origin: turned(ray.origin - self.center, Vec2::new(self.turn.x, -self.turn.y)),
            direction: turned(ray.direction, Vec2::new(self.turn.x, -self.turn.y)),
        };
        let (t, normal_local) = self.shape.hit(local)?;
        let point_local = local.origin + t * local.direction;
        Some(Hit { t, point_local, normal: turned(normal_local, self.turn) })
    }

    /// Returns true if a horizontal circle on top of the solid lies entirely within it. Only boxes carry things, so
    /// always false for other shapes.
    pub(super) fn has_on_top(&self, middle_world: Vec2, radius: f32) -> bool {
        let middle = Vec2::new(self.turn.x, -self.turn.y).rotate(middle_world - self.center.truncate());
        matches!(self.shape, Shape::Box(half) if (middle.abs() + radius).cmple(half.truncate()).all())
    }
}

/// Rotates a vector about the vertical axis.
fn turned(vector: Vec3, turn: Vec2) -> Vec3 {
    turn.rotate(vector.truncate()).extend(vector.z)
}

fn hit_box(ray: Ray, half: Vec3) -> Option<(f32, Vec3)> {
    // A direction of 0 gives infinities, which the comparisons below handle.
    let to_low = (-half - ray.origin) / ray.direction;
    let to_high = (half - ray.origin) / ray.direction;
    let enter = to_low.min(to_high);
    let leave = to_low.max(to_high).min_element();
    let t = enter.max_element();
    if !(t > NEAREST && t <= leave) {
        return None;
    }
    let axis = enter.max_position();
    let mut normal = Vec3::ZERO;
    normal[axis] = -ray.direction[axis].signum();
    Some((t, normal))
}

/// Returns the smaller solution t of |origin + t direction| = radius, if it lies ahead.
fn quadratic_entry(origin: Vec3, direction: Vec3, radius: f32) -> Option<f32> {
    let a = direction.length_squared();
    let half_b = origin.dot(direction);
    // Use the distance to the ray's nearest point, because the textbook discriminant loses digits far away.
    let nearest = origin - direction * (half_b / a);
    let rest = radius * radius - nearest.length_squared();
    if rest < 0.0 || a == 0.0 {
        return None;
    }
    let t = -half_b / a - (rest / a).sqrt();
    (t > NEAREST).then_some(t)
}

fn hit_cylinder(ray: Ray, radius: f32, half_height: f32) -> Option<(f32, Vec3)> {
    let flat = Vec3::new(1.0, 1.0, 0.0);
    let wall = quadratic_entry(ray.origin * flat, ray.direction * flat, radius).and_then(|t| {
        let point = ray.origin + t * ray.direction;
        (point.z.abs() <= half_height).then(|| (t, point * flat / radius))
    });
    let side = -ray.direction.z.signum();
    let t = (side * half_height - ray.origin.z) / ray.direction.z;
    let on_cap = t > NEAREST && (ray.origin + t * ray.direction).truncate().length() <= radius;
    let cap = on_cap.then_some((t, Vec3::Z * side));
    match (wall, cap) {
        (Some(wall), Some(cap)) => Some(if wall.0 <= cap.0 { wall } else { cap }),
        (wall, cap) => wall.or(cap),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec4;

    fn solid(shape: Shape) -> Solid {
        let turn = Vec2::from_angle(0.4);
        Solid { id: 1, shape, center: Vec3::new(0.3, 3.0, 0.1), turn, texture: Texture::plain([9; 3]) }
    }

    /// Evaluates a function similar to a signed distance: negative inside the shape.
    fn outside(shape: Shape, point: Vec3) -> f32 {
        match shape {
            Shape::Box(half) => (point.abs() - half).max_element(),
            Shape::Sphere(radius) => point.length() - radius,
            Shape::Cylinder(radius, half) => (point.truncate().length() - radius).max(point.z.abs() - half),
        }
    }

    #[test]
    fn hits_are_where_marching_in_small_steps_finds_them() {
        let shapes = [Shape::Box(Vec3::new(0.5, 0.3, 0.4)), Shape::Sphere(0.5), Shape::Cylinder(0.4, 0.5)];
        for solid in shapes.map(solid) {
            let mut hits = 0;
            for index in 0..400 {
                let direction = Vec3::new((index % 20) as f32 * 0.03 - 0.25, 1.0, (index / 20) as f32 * 0.03 - 0.25);
                let ray = Ray { origin: Vec3::ZERO, direction };
                let local = |t: f32| turned(direction * t - solid.center, Vec2::new(solid.turn.x, -solid.turn.y));
                let marched = (0..6000).map(|step| step as f32 * 1e-3).find(|t| outside(solid.shape, local(*t)) < 0.0);
                match (solid.hit(ray), marched) {
                    (Some(hit), Some(t)) => {
                        hits += 1;
                        assert!((hit.t - t).abs() < 2e-3, "{:?}: {} {t}", solid.shape, hit.t);
                        assert!(outside(solid.shape, hit.point_local).abs() < 1e-4);
                        let normal = Vec4::from((hit.normal, 0.0));
                        assert!((normal.length() - 1.0).abs() < 1e-4 && hit.normal.dot(direction) <= 0.0);
                    }
                    (None, None) => {}
                    // A corner thinner than a step.
                    (Some(hit), None) => assert!(outside(solid.shape, local(hit.t + 1e-3)) > -2e-3),
                    (None, Some(t)) => panic!("{:?}: missed at {t}", solid.shape),
                }
            }
            assert!(hits > 50);
        }
    }
}
