//! Frames of simple places, rendered by casting rays at planes.

use glam::{DVec3, Vec2, Vec3};
use splatseg_geometry::{CameraFrame, Image, Intrinsics, Pose};

/// The camera of all places.
pub const CAMERA: Intrinsics = Intrinsics { fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5, width: 160, height: 120 };

/// Luminance of surfaces without texture.
const FLAT: u8 = 120;

/// A plane {p : normal · p = distance}, in metres.
pub struct Plane {
    pub normal: Vec3,
    pub distance: f32,
    pub texture: Texture,
}

#[derive(Clone, Copy, PartialEq)]
pub enum Texture {
    /// The same grey everywhere.
    Flat,
    /// Smooth blotches of some centimetres.
    Blotches,
}

/// A wall in front of the camera, two metres away and slightly turned.
pub fn wall(texture: Texture) -> Vec<Plane> {
    vec![Plane { normal: Vec3::new(0.2, 0.1, 1.0).normalize(), distance: 2.0, texture }]
}

/// A corridor along z, two metres wide, without an end in range.
pub fn corridor(texture: Texture) -> Vec<Plane> {
    let plane = |normal, distance| Plane { normal, distance, texture };
    vec![plane(Vec3::X, 1.0), plane(Vec3::NEG_X, 1.0), plane(Vec3::Y, 1.2), plane(Vec3::NEG_Y, 1.3)]
}

/// A corner of a room, textured.
pub fn corner() -> Vec<Plane> {
    let plane = |normal: Vec3, distance| Plane { normal: normal.normalize(), distance, texture: Texture::Blotches };
    vec![plane(Vec3::new(1.0, 0.0, 0.6), 1.8), plane(Vec3::new(-0.7, 0.0, 1.0), 2.0), plane(Vec3::Y, 1.1)]
}

/// A textured board that faces against z.
#[derive(Clone, Copy)]
pub struct Board {
    pub center: Vec3,
    /// Half its width and height, metres.
    pub half: Vec2,
}

impl Board {
    /// Where a ray hits the board: the distance along it, and the luminance there.
    fn hit(&self, origin: Vec3, direction: Vec3) -> Option<(f32, u8)> {
        let along = (self.center.z - origin.z) / direction.z;
        let away = origin + direction * along - self.center;
        let is_hit = along > 0.1 && away.x.abs() <= self.half.x && away.y.abs() <= self.half.y;
        is_hit.then(|| (along, grey(Texture::Blotches, away)))
    }
}

/// Renders planes from a pose. Depth beyond 8 m is missing.
pub fn render(planes: &[Plane], pose: &Pose) -> CameraFrame<'static> {
    render_with(planes, &[], pose).0
}

/// Renders planes and boards from a pose. Depth beyond 8 m is missing. The second image has the number of the board in
/// each pixel, from 1, or 0.
pub fn render_with(planes: &[Plane], boards: &[Board], pose: &Pose) -> (CameraFrame<'static>, Image<u32>) {
    let hit = |column: usize, row: usize| {
        let ray = CAMERA.unproject(Vec2::new(column as f32, row as f32), 1.0);
        let direction = (pose.rotation() * ray.as_dvec3()).as_vec3();
        let origin = pose.translation().as_vec3();
        let hits = planes.iter().filter_map(|plane| {
            let along = (plane.distance - plane.normal.dot(origin)) / plane.normal.dot(direction);
            (along > 0.1).then_some((along, plane.texture))
        });
        let plane = hits.min_by(|one, other| one.0.total_cmp(&other.0));
        let plane = plane.map(|(depth, texture)| (depth, grey(texture, origin + direction * depth), 0));
        let boards = boards.iter().zip(1..).filter_map(|(board, number)| {
            let (depth, grey) = board.hit(origin, direction)?;
            Some((depth, grey, number))
        });
        let nearest = boards.chain(plane).min_by(|one, other| one.0.total_cmp(&other.0));
        nearest.filter(|(depth, ..)| *depth <= 8.0)
    };
    let hits = Image::from_fn(CAMERA.width, CAMERA.height, hit);
    // What is too far for the depth sensor has the grey of a flat surface.
    let color = hits.map(|hit| [hit.map_or(FLAT, |(_, grey, _)| grey); 3]);
    let depth = hits.map(|hit| hit.map_or(0.0, |(depth, ..)| depth));
    let numbers = hits.map(|hit| hit.map_or(0, |(_, _, number)| number));
    (CameraFrame::new("frame", color, depth, CAMERA).unwrap(), numbers)
}

/// A pose on a gentle path to the right, forward and around, `time` in frames.
pub fn path(time: f64) -> Pose {
    let position = DVec3::new(0.006 * time, 0.05 * (0.1 * time).sin(), 0.002 * time);
    let turn = glam::DQuat::from_euler(glam::EulerRot::YXZ, 0.004 * time, 0.03 * (0.08 * time).sin(), 0.0);
    Pose::from_quaternion(position, turn).unwrap()
}

/// Distance of two poses: metres, radians.
pub fn error(found: &Pose, truth: &Pose) -> (f64, f64) {
    let difference = truth.inverse() * *found;
    let rotation = difference.rotation();
    let trace = rotation.x_axis.x + rotation.y_axis.y + rotation.z_axis.z;
    (difference.translation().length(), ((trace - 1.0) * 0.5).clamp(-1.0, 1.0).acos())
}

fn grey(texture: Texture, point: Vec3) -> u8 {
    if texture == Texture::Flat {
        return FLAT;
    }
    let wave = |direction: Vec3, phase: f32| (direction.dot(point) + phase).sin();
    let sum = wave(Vec3::new(31.0, 7.0, 17.0), 0.3)
        + wave(Vec3::new(-11.0, 29.0, 5.0), 1.1)
        + wave(Vec3::new(9.0, -19.0, 37.0), 2.0)
        + wave(Vec3::new(3.0, 5.0, -7.0), 0.7);
    (128.0 + 28.0 * sum) as u8
}
