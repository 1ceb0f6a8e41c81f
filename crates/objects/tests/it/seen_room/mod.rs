//! A memory of the synthetic room, together with the room's true geometry.

use glam::{Mat3, Vec2, Vec3};
use splatseg_dataset::{Scene, SyntheticScene, SyntheticSettings, Thing, ThingKind};
use splatseg_geometry::{Pose, RgbdFrame, SegmentId, SegmentMap};
use splatseg_memory::{MemorySettings, SplatMemory};
use splatseg_objects::ObjectShape;
use splatseg_test_scenes::truth;
use std::collections::{BTreeMap, BTreeSet};

/// Cells along each side of a face, to measure how much of it was seen.
const CELLS: usize = 8;
/// Points along each axis of a box when volumes are compared.
const VOLUME_SAMPLES: usize = 32;
/// A side counts as seen if at least this share of it was seen.
const SEEN: f32 = 0.95;
/// Minimum side of a box, metres; smaller boxes are a few pixels wide.
const MIN_SIDE: f32 = 0.2;

/// The seen cells of a box's faces: -x, +x, -y, +y, -z, +z.
#[derive(Clone, Copy)]
pub struct SeenFaces([[bool; CELLS * CELLS]; 6]);

impl Default for SeenFaces {
    fn default() -> Self {
        Self([[false; CELLS * CELLS]; 6])
    }
}

impl SeenFaces {
    fn record(&mut self, thing: &Thing, point: Vec3) {
        let place = Mat3::from_rotation_z(-thing.turn) * (point - thing.center) / thing.size;
        let axis = place.abs().max_position();
        let cell = |axis: usize| (((place[axis] + 0.5) * CELLS as f32) as usize).min(CELLS - 1);
        let face = 2 * axis + usize::from(place[axis] > 0.0);
        self.0[face][cell((axis + 1) % 3) * CELLS + cell((axis + 2) % 3)] = true;
    }

    fn share(&self, face: usize) -> f32 {
        self.0[face].iter().filter(|seen| **seen).count() as f32 / (CELLS * CELLS) as f32
    }

    /// True if at least two sides and the top were seen.
    fn is_box_seen(&self) -> bool {
        (0..4).filter(|face| self.share(*face) >= SEEN).count() >= 2 && self.share(5) >= SEEN
    }

    pub fn area(&self, size: Vec3) -> f32 {
        let face_areas = [size.y * size.z, size.x * size.z, size.x * size.y];
        (0..6).map(|face| self.share(face) * face_areas[face / 2]).sum()
    }
}

/// A box: centre, size, axes.
#[derive(Clone, Copy)]
pub struct Cuboid(pub Vec3, pub Vec3, pub Mat3);

impl Cuboid {
    fn volume(&self) -> f32 {
        self.1.element_product()
    }

    pub fn iou(&self, other: &Self) -> f32 {
        let side = VOLUME_SAMPLES;
        let inside = (0..side.pow(3)).filter(|index| {
            let cell = [index % side, index / side % side, index / side / side].map(|cell| cell as f32 + 0.5);
            let point = self.0 + self.2 * (self.1 * (Vec3::from(cell) / side as f32 - 0.5));
            (other.2.transpose() * (point - other.0)).abs().cmple(0.5 * other.1).all()
        });
        // Counted in cells, which may round up.
        let shared = (self.volume() * inside.count() as f32 / side.pow(3) as f32).min(other.volume());
        shared / (self.volume() + other.volume() - shared)
    }
}

/// Errors of the boxes found for a thing.
pub struct BoxErrors {
    /// Distance between the centres of the oriented box and the thing, metres.
    pub off: f32,
    /// IoU of the oriented box and the thing.
    pub iou: f32,
    /// IoU of the axis-aligned box and the bounds of the seen part of the thing.
    pub aligned_iou: f32,
}

/// A room, a memory updated with the true ids, and the seen parts of each thing.
pub struct Seen {
    pub memory: SplatMemory,
    /// The true ids of each frame.
    pub truths: Vec<SegmentMap>,
    things: Vec<Thing>,
    pub faces: BTreeMap<SegmentId, SeenFaces>,
    /// Minimum and maximum coordinates of the seen part of each thing, world.
    extents: BTreeMap<SegmentId, (Vec3, Vec3)>,
}

/// Records a room in a memory; `place` moves the world.
pub fn seen_room(settings: SyntheticSettings, place: Pose) -> Seen {
    let scene = SyntheticScene::new(settings).unwrap();
    let things = scene.things();
    let mut memory = SplatMemory::new(MemorySettings::default(), 0, &mut |_| {}).unwrap();
    (1..=things.last().unwrap().id).for_each(|_| _ = memory.new_segment().unwrap());
    let mut seen = Seen { memory, truths: Vec::new(), things, faces: BTreeMap::new(), extents: BTreeMap::new() };
    for index in 0..scene.frame_count() {
        let frame = scene.read_frame(index).unwrap();
        let truth = truth(&scene, index);
        seen.record_faces(&frame, &truth);
        let (color, depth) = (frame.color().clone(), frame.depth().clone());
        let pose = place * *frame.world_from_camera();
        let frame = RgbdFrame::new(frame.name(), color, depth, *frame.intrinsics(), pose).unwrap();
        let recall = seen.memory.recall(&frame);
        seen.memory.update(recall, &truth, &BTreeSet::new()).unwrap();
        seen.truths.push(truth);
    }
    seen
}

impl Seen {
    fn record_faces(&mut self, frame: &RgbdFrame, truth: &SegmentMap) {
        for row in 0..frame.height() {
            for column in 0..frame.width() {
                let (id, depth) = (truth[(column, row)], frame.depth()[(column, row)]);
                let Some(thing) = self.things.iter().find(|thing| thing.id == id) else { continue };
                let point = frame.intrinsics().unproject(Vec2::new(column as f32, row as f32), depth);
                let point = frame.world_from_camera().to_world(point).as_vec3();
                self.faces.entry(id).or_default().record(thing, point);
                let (min, max) = self.extents.entry(id).or_insert((point, point));
                (*min, *max) = (min.min(point), max.max(point));
            }
        }
    }

    /// Errors of the boxes of a thing.
    pub fn box_errors(&self, thing: &Thing, shape: &ObjectShape) -> BoxErrors {
        let axes = Mat3::from_rotation_z(thing.turn);
        let (min, max) = self.extents[&thing.id];
        BoxErrors {
            off: shape.oriented_box.center.as_vec3().distance(thing.center),
            iou: oriented(shape).iou(&Cuboid(thing.center, thing.size, axes)),
            aligned_iou: aligned(shape).iou(&Cuboid(0.5 * (min + max), max - min, Mat3::IDENTITY)),
        }
    }

    /// The boxes that are large enough and were seen from two sides and from above.
    pub fn boxes(&self) -> impl Iterator<Item = &Thing> {
        let is_large = |thing: &&Thing| thing.kind == ThingKind::Box && thing.size.min_element() >= MIN_SIDE;
        self.things
            .iter()
            .filter(is_large)
            .filter(|thing| self.faces.get(&thing.id).is_some_and(SeenFaces::is_box_seen))
    }
}

pub fn room(seed: u64) -> SyntheticSettings {
    SyntheticSettings { frames: 48, seed, ..SyntheticSettings::default() }
}

pub fn oriented(shape: &ObjectShape) -> Cuboid {
    let found = shape.oriented_box;
    Cuboid(found.center.as_vec3(), found.size, Mat3::from_quat(found.rotation))
}

fn aligned(shape: &ObjectShape) -> Cuboid {
    let found = shape.axis_aligned_box;
    let [min, max] = [found.min, found.max].map(|corner| corner.as_vec3());
    Cuboid(0.5 * (min + max), max - min, Mat3::IDENTITY)
}
