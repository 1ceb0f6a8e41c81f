//! The plan of a floor with a ramp.

use glam::{DMat4, DVec3, Vec2, Vec3};
use splatseg_geometry::{Image, Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::DepthView;
use splatseg_places::{FloorPlan, PlanFile, PlanSettings};
use splatseg_test_scenes::camera;
use std::collections::{BTreeMap, BTreeSet};

/// Planes of the floor: from and to which x, z at the first, and how much z rises per metre of x.
const FLOOR: [(f32, f32, f32, f32); 3] = [(-1.0, 3.0, 0.0, 0.0), (3.0, 5.0, 0.0, 0.1), (5.0, 9.0, 0.2, 0.0)];
/// Corners of a box on the higher part.
const BOX: [Vec3; 2] = [Vec3::new(6.75, -0.25, 0.2), Vec3::new(7.25, 0.25, 0.6)];

/// Where a ray meets the floor and the box, in lengths of `way`.
fn meets(from: Vec3, way: Vec3) -> [Option<f32>; 2] {
    let on_floor = FLOOR.into_iter().filter_map(|(first, last, z, rise)| {
        let length = (z + rise * (from.x - first) - from.z) / (way.z - rise * way.x);
        let point = from + length * way;
        (length > 0.0 && (first..=last).contains(&point.x) && point.y.abs() < 3.0).then_some(length)
    });
    let [one, other] = BOX.map(|corner| (corner - from) / way);
    let (enters, leaves) = (one.min(other).max_element(), one.max(other).min_element());
    [on_floor.min_by(f32::total_cmp), (enters > 0.0 && enters < leaves).then_some(enters)]
}

/// A camera 1.5 m above the floor that looks down by 45 degrees, in a direction of the compass.
fn pose(x: f64, y: f64, yaw: f64) -> Pose {
    let forward = DVec3::new(yaw.cos(), yaw.sin(), -1.0).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let axes = [right, forward.cross(right), forward].map(|axis| axis.extend(0.0));
    Pose::from_matrix(DMat4::from_cols(axes[0], axes[1], axes[2], DVec3::new(x, y, 1.6).extend(1.0))).unwrap()
}

#[test]
fn a_ramp_is_no_obstacle() {
    let camera = camera(96, 72, 60.0);
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    let [floor, thing]: [SegmentId; 2] = [memory.new_segment().unwrap(), memory.new_segment().unwrap()];
    let mut views = Vec::new();
    for step in 0..64 {
        let pose = pose(
            0.5 * f64::from(step / 4),
            f64::from(step % 2) - 0.5,
            std::f64::consts::FRAC_PI_2 * f64::from(step % 4),
        );
        let from = pose.translation().as_vec3();
        let sight = |column: usize, row: usize| {
            let ray = camera.unproject(Vec2::new(column as f32, row as f32), 1.0);
            match meets(from, pose.rotation().as_mat3() * ray) {
                [floor_at, Some(box_at)] if floor_at.is_none_or(|floor_at| box_at < floor_at) => (box_at, thing),
                [Some(floor_at), _] => (floor_at, floor),
                [None, _] => (0.0, 0),
            }
        };
        let depth = Image::from_fn(96, 72, |column, row| sight(column, row).0);
        let labels = SegmentMap::from_fn(96, 72, |column, row| sight(column, row).1);
        let color = Image::filled(96, 72, [120; 3]);
        let frame = RgbdFrame::new(step.to_string(), color, depth.clone(), camera, pose).unwrap();
        let recall = memory.recall(&frame);
        memory.update(recall, &labels, &BTreeSet::new()).unwrap();
        views.push(DepthView { world_from_camera: pose, intrinsics: camera, depth });
    }
    let plan = FloorPlan::new(&memory.map(), &views, PlanSettings::default()).unwrap();
    let (low, high) = plan.floor_heights();
    assert!(low.abs() < 0.03 && (high - 0.2).abs() < 0.03, "{low} {high}");
    // Its higher part is above `min_height`, but not above the floor there.
    let heights = |id: SegmentId| plan.footprints()[&id].heights;
    assert!(heights(floor).0 > -0.05 && heights(floor).1 < 0.05, "{:?}", heights(floor));
    assert!((heights(thing).1 - 0.4).abs() < 0.05, "{:?}", heights(thing));
    let file = PlanFile::new(&plan, &BTreeMap::new(), None, 0.2);
    let places: Vec<(SegmentId, bool)> =
        file.objects.iter().map(|object| (object.id, !object.approach.is_empty())).collect();
    assert_eq!(places, [(floor, false), (thing, true)]);
}
