//! Shapes of objects against the synthetic room's own geometry. The rules were chosen on the rooms of seeds 100 to 109.

use glam::{DVec3, EulerRot, Mat3, Quat, Vec2, Vec3};
use splatseg_dataset::{Scene, SyntheticScene, SyntheticSettings, Thing, ThingKind};
use splatseg_geometry::{Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::{ObjectList, ObjectLog, ObjectShape, ObjectState, object_shapes};
use splatseg_tracking::FrameOutput;
use std::collections::BTreeMap;

/// Cells along each side of a face, to see how much of it was seen.
const CELLS: usize = 8;
/// Points along each axis of a box when volumes are compared.
const VOLUME_SAMPLES: usize = 32;
/// A side of which at least this much was seen counts as seen.
const SEEN: f32 = 0.95;
/// Smaller boxes are a few pixels wide.
const MIN_SIDE: f32 = 0.2;

/// Which cells of a box's faces the frames have shown: -x, +x, -y, +y, -z, +z.
#[derive(Clone, Copy)]
struct SeenFaces([[bool; CELLS * CELLS]; 6]);

impl Default for SeenFaces {
    fn default() -> Self {
        Self([[false; CELLS * CELLS]; 6])
    }
}

impl SeenFaces {
    fn note(&mut self, thing: &Thing, point: Vec3) {
        let place = Mat3::from_rotation_z(-thing.turn) * (point - thing.center) / thing.size;
        let axis = place.abs().max_position();
        let cell = |axis: usize| (((place[axis] + 0.5) * CELLS as f32) as usize).min(CELLS - 1);
        let face = 2 * axis + usize::from(place[axis] > 0.0);
        self.0[face][cell((axis + 1) % 3) * CELLS + cell((axis + 2) % 3)] = true;
    }

    fn share(&self, face: usize) -> f32 {
        self.0[face].iter().filter(|seen| **seen).count() as f32 / (CELLS * CELLS) as f32
    }

    /// Whether two sides or more were seen, and the top.
    fn is_box_seen(&self) -> bool {
        (0..4).filter(|face| self.share(*face) >= SEEN).count() >= 2 && self.share(5) >= SEEN
    }

    fn area(&self, size: Vec3) -> f32 {
        let face_areas = [size.y * size.z, size.x * size.z, size.x * size.y];
        (0..6).map(|face| self.share(face) * face_areas[face / 2]).sum()
    }
}

/// A box: middle, size, axes.
#[derive(Clone, Copy)]
struct Cuboid(Vec3, Vec3, Mat3);

impl Cuboid {
    fn volume(&self) -> f32 {
        self.1.element_product()
    }

    fn iou(&self, other: &Self) -> f32 {
        let side = VOLUME_SAMPLES;
        let inside = (0..side.pow(3)).filter(|index| {
            let cell = [index % side, index / side % side, index / side / side].map(|cell| cell as f32 + 0.5);
            let point = self.0 + self.2 * (self.1 * (Vec3::from(cell) / side as f32 - 0.5));
            (other.2.transpose() * (point - other.0)).abs().cmple(0.5 * other.1).all()
        });
        let shared = self.volume() * inside.count() as f32 / side.pow(3) as f32;
        shared / (self.volume() + other.volume() - shared)
    }
}

/// A room, what a memory makes of it that is shown the true ids, and what the frames show of each thing.
struct Seen {
    things: Vec<Thing>,
    memory: SplatMemory,
    log: ObjectLog,
    faces: BTreeMap<SegmentId, SeenFaces>,
    /// Least and largest coordinates of what the frames show of each thing, world.
    extents: BTreeMap<SegmentId, (Vec3, Vec3)>,
}

/// Shows a room to a memory; `place` moves the world.
fn seen_room(settings: SyntheticSettings, place: Pose) -> Seen {
    let scene = SyntheticScene::new(settings).unwrap();
    let things = scene.things();
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    (1..=things.last().unwrap().id).for_each(|_| _ = memory.new_segment().unwrap());
    let mut seen = Seen { things, memory, log: ObjectLog::default(), faces: BTreeMap::new(), extents: BTreeMap::new() };
    for index in 0..scene.frame_count() {
        let frame = scene.read_frame(index).unwrap();
        let truth = scene.read_ground_truth(index).unwrap().unwrap();
        seen.note_faces(&frame, &truth);
        let (color, depth) = (frame.color().clone(), frame.depth().clone());
        let pose = place * *frame.world_from_camera();
        let frame = RgbdFrame::new(frame.name(), color, depth, *frame.intrinsics(), pose).unwrap();
        let recall = seen.memory.recall(&frame);
        seen.memory.update(recall, &truth).unwrap();
        seen.log.record(&FrameOutput::from_segments(truth));
    }
    seen
}

impl Seen {
    fn note_faces(&mut self, frame: &RgbdFrame, truth: &SegmentMap) {
        for row in 0..frame.height() {
            for column in 0..frame.width() {
                let (id, depth) = (truth[(column, row)], frame.depth()[(column, row)]);
                let Some(thing) = self.things.iter().find(|thing| thing.id == id) else { continue };
                let point = frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), depth);
                let point = frame.world_from_camera().to_world(point);
                self.faces.entry(id).or_default().note(thing, point);
                let (min, max) = self.extents.entry(id).or_insert((point, point));
                (*min, *max) = (min.min(point), max.max(point));
            }
        }
    }

    /// The boxes that are large enough and were seen from two sides and from above.
    fn boxes(&self) -> impl Iterator<Item = &Thing> {
        let is_large = |thing: &&Thing| thing.kind == ThingKind::Box && thing.size.min_element() >= MIN_SIDE;
        self.things
            .iter()
            .filter(is_large)
            .filter(|thing| self.faces.get(&thing.id).is_some_and(SeenFaces::is_box_seen))
    }
}

fn room(seed: u64) -> SyntheticSettings {
    SyntheticSettings { frames: 48, seed, ..SyntheticSettings::default() }
}

fn oriented(shape: &ObjectShape) -> Cuboid {
    let found = shape.oriented_box;
    Cuboid(found.center, found.size, Mat3::from_quat(found.rotation))
}

fn aligned(shape: &ObjectShape) -> Cuboid {
    let found = shape.axis_aligned_box;
    Cuboid(0.5 * (found.min + found.max), found.max - found.min, Mat3::IDENTITY)
}

#[test]
fn boxes_that_were_seen_from_two_sides_are_where_they_stand() {
    let (mut count, mut exact) = (0, 0);
    for seed in 1..=3 {
        let seen = seen_room(room(seed), Pose::IDENTITY);
        let shapes = object_shapes(&seen.memory);
        for thing in seen.boxes() {
            let shape = &shapes[&thing.id];
            let axes = Mat3::from_rotation_z(thing.turn);
            let iou = oriented(shape).iou(&Cuboid(thing.center, thing.size, axes));
            let (min, max) = seen.extents[&thing.id];
            let outer = Cuboid(0.5 * (min + max), max - min, Mat3::IDENTITY);
            let aligned_iou = aligned(shape).iou(&outer);
            let off = shape.oriented_box.center.distance(thing.center);
            let ratio = shape.area_m2 / seen.faces[&thing.id].area(thing.size);
            println!("seed {seed}: {thing:?} {shape:?}: off {off:.3}, IoU {iou:.2} {aligned_iou:.2}, area {ratio:.2}");
            assert!(off < 0.04 && iou >= 0.7 && aligned_iou >= 0.7, "seed {seed}, object {}", thing.id);
            assert!((0.4..1.1).contains(&ratio), "seed {seed}, object {}: area off by {ratio}", thing.id);
            count += 1;
            exact += usize::from(off < 0.03);
        }
    }
    assert!(count >= 5 && 10 * exact >= 9 * count, "{exact} of {count} boxes within 3 cm");
}

#[test]
fn boxes_turn_with_the_world() {
    // The same room, as a camera sees it whose first pose is not upright.
    let rotation = Quat::from_euler(EulerRot::XYZ, 0.5, -0.8, 1.1);
    let place = Pose::from_quaternion(DVec3::new(4.0, -2.0, 1.0), rotation.as_dquat()).unwrap();
    let seen = seen_room(room(4), place);
    let shapes = object_shapes(&seen.memory);
    for thing in seen.boxes() {
        let axes = Mat3::from_quat(rotation) * Mat3::from_rotation_z(thing.turn);
        let truth = Cuboid(place.to_world(thing.center), thing.size, axes);
        let iou = oriented(&shapes[&thing.id]).iou(&truth);
        assert!(iou >= 0.7, "object {}: IoU {iou:.2}", thing.id);
    }
    assert!(seen.boxes().count() > 0);
}

#[test]
fn the_list_has_what_the_log_and_the_memory_know() {
    let small = SyntheticSettings { frames: 4, width: 96, height: 72, objects: 8, ..SyntheticSettings::default() };
    let seen = seen_room(small, Pose::IDENTITY);
    let list = ObjectList::new(&seen.log, Some(&seen.memory));
    assert_eq!(list, ObjectList::new(&seen.log, Some(&seen.memory)));
    assert_eq!(list.frames, 4);
    for (id, record) in seen.log.records() {
        let object = list.objects.iter().find(|object| object.id == *id).unwrap();
        let (first, last) = (object.first_frame.as_ref().unwrap(), object.last_frame.as_ref().unwrap());
        assert_eq!((first.number, last.number, object.frames), (record.first_frame, record.last_frame, record.frames));
        let expected = if record.frames > 1 { ObjectState::Remembered } else { ObjectState::Tentative };
        assert!(object.state == Some(expected) || object.shape.is_none(), "{object:?}");
        assert_eq!(object.color, object.shape.as_ref().map(|shape| shape.color));
    }
    // An id that was given and that nothing carries.
    let mut memory = seen.memory;
    let carried = memory.carried_ids();
    let id = memory.new_segment().unwrap();
    assert!(!memory.carried_ids().contains(&id) && !carried.contains(&id));
    let mut log = seen.log;
    log.record(&FrameOutput::from_segments(SegmentMap::filled(2, 2, id)));
    let list = ObjectList::new(&log, Some(&memory));
    let object = list.objects.iter().find(|object| object.id == id).unwrap();
    assert_eq!((object.state, &object.shape), (Some(ObjectState::Forgotten), &None));
}
