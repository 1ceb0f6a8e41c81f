use super::view_pairs::ViewPair;
use super::*;
use glam::{DQuat, DVec2, DVec3, Vec2, Vec3};

/// A room with a pattern on its walls, 5 × 3 × 5 m around the origin.
const HALF: Vec3 = Vec3::new(2.5, 1.5, 2.5);
/// Balls in it, with their radii: a single wall tells little.
const BALLS: [(Vec3, f32); 8] = [
    (Vec3::new(1.7, 0.2, 1.8), 0.5),
    (Vec3::new(1.9, -0.6, -0.3), 0.4),
    (Vec3::new(0.2, 0.6, 1.9), 0.4),
    (Vec3::new(-1.0, -0.3, 2.0), 0.3),
    (Vec3::new(-1.9, 0.4, 0.6), 0.5),
    (Vec3::new(-1.6, -0.5, -1.5), 0.4),
    (Vec3::new(0.3, 0.3, -1.9), 0.4),
    (Vec3::new(1.6, 0.5, -1.7), 0.3),
];

/// A number between 0 and 1 for each place of a grid.
fn hashed(place: [i32; 3]) -> f32 {
    let mixed = place.iter().fold(17u32, |hash, part| (hash ^ *part as u32).wrapping_mul(0x9E37_79B1).rotate_left(13));
    (mixed.wrapping_mul(0x85EB_CA6B) >> 16) as f32 / 65535.0
}

/// The pattern at a place: squares of 25 and of 9 cm, each of its own grey.
fn pattern(place: Vec3) -> f32 {
    [0.25, 0.09].map(|side| hashed((place / side + 1e-3).floor().as_ivec3().to_array())).iter().sum::<f32>() * 120.0
}

/// The image of a camera in the room. Its lens distorts (`k1` of the Brown model).
fn view((focal, k1): (f32, f32), turn: glam::Quat, position: Vec3) -> Image<[u8; 3]> {
    let (width, height) = (200, 150);
    let ray = |column: f32, row: f32| {
        let seen = Vec2::new(column - 99.5, row - 74.5) / (focal * width as f32);
        let steps = if k1 == 0.0 { 0 } else { 20 };
        let undistorted = (0..steps).fold(seen, |place, _| 0.5 * (place + seen / (1.0 + k1 * place.length_squared())));
        turn * undistorted.extend(1.0).normalize()
    };
    let seen = |ray: Vec3| {
        let walls = (HALF * ray.signum() - position) / ray;
        let balls = BALLS.iter().filter_map(|(center, radius)| {
            let (along, away) = (ray.dot(center - position), (center - position).length_squared());
            let depth = radius * radius - away + along * along;
            (depth > 0.0 && along > 0.0).then(|| along - depth.sqrt())
        });
        pattern(position + ray * balls.fold(walls.min_element(), f32::min))
    };
    Image::from_fn(width, height, |column, row| {
        // Four rays a pixel: edges are blurred as by a lens.
        let rays = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
        let sum: f32 = rays.iter().map(|(x, y)| seen(ray(column as f32 + x - 0.5, row as f32 + y - 0.5))).sum();
        [(0.25 * sum) as u8; 3]
    })
}

/// The frames of a camera that is carried through the room and looks around.
fn walk(lens: (f32, f32)) -> Vec<Image<[u8; 3]>> {
    (0..60)
        .map(|frame| {
            let phase = frame as f32 * 0.06;
            let turn =
                glam::Quat::from_rotation_y(0.9 * phase) * glam::Quat::from_rotation_x(0.2 * (2.0 * phase).sin());
            view(lens, turn, Vec3::new(phase.sin(), 0.3 * (1.3 * phase).sin(), 0.8 * (0.7 * phase).cos()))
        })
        .collect()
}

fn estimate_of(images: &[Image<[u8; 3]>]) -> Option<FocalLength> {
    estimated_focal_length(images.len(), &|index| images.get(index).cloned())
}

#[test]
fn wide_usual_and_long_cameras_are_told_apart() {
    for (focal, most) in [(0.5, 0.05), (0.85, 0.05), (1.4, 0.25)] {
        let found = estimate_of(&walk((focal, 0.0))).unwrap();
        let error = (found.long_sides / f64::from(focal)).ln().abs();
        println!("{focal} long sides, estimated {found:?}");
        assert!(error < most && error < 2.0 * found.deviation && !found.distorts, "{focal}: {found:?}");
    }
}

#[test]
fn a_lens_that_distorts_is_told() {
    for k1 in [-0.05, -0.1] {
        let found = estimate_of(&walk((0.5, k1))).unwrap();
        println!("0.5 long sides, k1 {k1}, estimated {found:?}");
        assert!(found.distorts, "{k1}: {found:?}");
    }
}

#[test]
fn a_camera_that_stands_still_and_noise_tell_nothing() {
    let still = view((0.85, 0.0), glam::Quat::IDENTITY, Vec3::ZERO);
    assert_eq!(estimate_of(&vec![still; 20]), None);
    let noise =
        |frame: usize| Image::from_fn(200, 150, |x, y| [(255.0 * hashed([x as i32, y as i32, frame as i32])) as u8; 3]);
    assert_eq!(estimate_of(&(0..20).map(noise).collect::<Vec<_>>()), None);
    assert_eq!((estimate_of(&[]), estimate_of(&[Image::filled(0, 0, [0; 3])])), (None, None));
}

#[test]
fn frames_that_cannot_be_read_and_threads_change_nothing_else() {
    let images = walk((0.85, 0.0));
    let without_end = |index: usize| images.get(index).filter(|_| index < 55).cloned();
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| estimated_focal_length(images.len(), &without_end)).unwrap()
    };
    assert_eq!(on(1), on(3));
    assert!((on(1).long_sides / 0.85).ln().abs() < 0.06, "{:?}", on(1));
}

/// Points at 1 to 5 m, seen before and after a motion.
fn pair(focal: f64, turn: DVec3, shift: DVec3) -> ViewPair {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut pair = ViewPair::default();
    for _ in 0..150 {
        let place = DVec2::new(rng.random_range(-0.45..0.45), rng.random_range(-0.35..0.35));
        let point = (place / focal).extend(1.0) * rng.random_range(1.0..5.0);
        let moved = DQuat::from_scaled_axis(turn) * point + shift;
        let error = DVec2::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)) * 0.001;
        pair.first.push(place);
        pair.second.push(moved.truncate() / moved.z * focal + error);
    }
    pair
}

#[test]
fn turns_and_translations_tell_the_focal_length() {
    for focal in [0.45, 0.9, 1.6] {
        for shift in [DVec3::ZERO, DVec3::new(0.3, 0.05, 0.1)] {
            let turns = [DVec3::new(0.02, 0.25, 0.01), DVec3::new(0.2, -0.1, 0.03), DVec3::new(-0.1, -0.2, 0.1)];
            let costs = turns.map(|turn| camera_motion::costs(&pair(focal, turn, shift), &focal_lengths()));
            let found = best(&sums(costs.iter())).unwrap();
            assert!((found / focal).ln().abs() < 0.03, "{focal} {shift}: {found}");
        }
    }
}

#[test]
fn parts_are_spread_over_a_long_recording() {
    assert_eq!((parts_of(20).len(), parts_of(45)), (1, vec![0..22, 22..45]));
    let parts = parts_of(9000);
    assert_eq!((parts.len(), parts[9].clone()), (10, 8100..8130));
}
