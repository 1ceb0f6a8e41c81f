//! The map and its objects as ROS 2 messages.

use super::frame_messages::number;
use super::{MAP, WORLD};
use crate::segment_color;
use glam::DVec3;
use splatseg_geometry::{MapView, SegmentId};
use splatseg_objects::{LabelScore, Object, OrientedBox};
use splatseg_ros::{
    BoundingBox3d, ColorRgba, Detection3d, Detection3dArray, Header, Marker, MarkerArray, ObjectHypothesis,
    ObjectHypothesisWithPose, Point, PointCloud2, PointField, PoseMessage, PoseWithCovariance, Quaternion, Time,
    Vector3, action, marker_type,
};
use std::io;

/// Colour of points without an object.
const NO_OBJECT: [u8; 3] = [128; 3];
/// Bytes of a point: x, y, z, colour, id, and colour once more.
const POINT_BYTES: usize = 24;
/// Namespaces of the markers.
const BOXES: &str = "boxes";
const IDS: &str = "ids";
/// Opacity of the boxes: their contents stay visible.
pub(crate) const BOX_OPACITY: f32 = 0.35;
/// Height of the ids' digits, metres.
pub(crate) const TEXT_HEIGHT: f32 = 0.08;

/// An object that has a box.
pub struct ShownObject {
    /// Its lasting id.
    pub id: SegmentId,
    /// When it was first seen, nanoseconds.
    pub first_seen: i64,
    /// Number of frames that show it.
    pub frames: usize,
    /// Its label, if it has one.
    pub label: Option<String>,
    /// How clearly that fits, if it is known.
    pub label_score: Option<f32>,
    /// Other labels that fit, best first.
    pub label_alternatives: Vec<LabelScore>,
    /// Its box, world coordinates.
    pub oriented_box: OrientedBox,
}

impl ShownObject {
    /// Returns an object of a run's list; `None` if it has no shape. `first_seen` is in nanoseconds.
    pub fn new(first_seen: i64, object: &Object) -> Option<Self> {
        Some(Self {
            id: object.id,
            first_seen,
            frames: object.frames,
            label: object.label.clone(),
            label_score: object.label_score,
            label_alternatives: object.label_alternatives.clone(),
            oriented_box: object.shape.as_ref()?.oriented_box,
        })
    }

    /// Its id, followed by its label if it has one.
    pub fn text(&self) -> String {
        match &self.label {
            Some(label) => format!("{} {label}", self.id),
            None => self.id.to_string(),
        }
    }

    /// Red, green and blue, 0 to 1.
    pub fn color(&self) -> [f32; 3] {
        segment_color(self.id).map(|channel| f32::from(channel) / 255.0)
    }
}

/// The points of a map, encoded for a message.
pub struct PointBytes {
    /// Coordinate frame of the points.
    frame_id: &'static str,
    bytes: Vec<u8>,
}

impl PointBytes {
    /// The centres of a map's Gaussians, in the colours of their objects, without those whose distance is not known.
    /// They are in the frame [`MAP`] if the map's
    /// origin is not the world's.
    pub fn of(map: &MapView<'_>) -> Self {
        // ROS viewers take 32-bit points only.
        let frame_id = if map.origin == DVec3::ZERO { WORLD } else { MAP };
        Self { frame_id, bytes: point_bytes(map, DVec3::ZERO) }
    }

    /// As [`Self::of`], in [`WORLD`]. Far from its origin, points are less exact.
    pub fn in_world(map: &MapView<'_>) -> Self {
        Self { frame_id: WORLD, bytes: point_bytes(map, map.origin) }
    }

    /// The message. `rgb` is a 32-bit integer stored as a float, the ROS convention. Rerun does not support that, but
    /// makes each field a component of its points: it reads their colours from a field `colors` with red in the highest
    /// byte.
    ///
    /// # Errors
    /// If a size does not fit into 32 bits.
    pub fn message(&self, stamp: Time) -> io::Result<PointCloud2<'_>> {
        let field =
            |(name, datatype): (&str, u8), offset| PointField { name: name.to_owned(), offset, datatype, count: 1 };
        let fields = [
            ("x", PointField::FLOAT32),
            ("y", PointField::FLOAT32),
            ("z", PointField::FLOAT32),
            ("rgb", PointField::FLOAT32),
            ("segment_id", PointField::UINT32),
            ("colors", PointField::UINT32),
        ];
        Ok(PointCloud2 {
            header: Header { stamp, frame_id: self.frame_id.to_owned() },
            height: 1,
            width: number(self.bytes.len() / POINT_BYTES)?,
            fields: fields.into_iter().zip((0..).step_by(4)).map(|(part, offset)| field(part, offset)).collect(),
            is_bigendian: false,
            point_step: number(POINT_BYTES)?,
            row_step: number(self.bytes.len())?,
            data: &self.bytes,
            is_dense: true,
        })
    }
}

/// Encodes the centres of Gaussians, moved by `offset`.
fn point_bytes(map: &MapView<'_>, offset: DVec3) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(POINT_BYTES * map.gaussian_count());
    let known = map.means.iter().zip(map.segment_ids()).zip(map.surfaces).filter(|(_, surface)| surface.has_place());
    for (mean, id) in known.map(|(point, _)| point).filter(|(mean, _)| mean.is_finite()) {
        let mean = (mean.as_dvec3() + offset).as_vec3();
        bytes.extend(mean.to_array().into_iter().flat_map(f32::to_le_bytes));
        let [red, green, blue] = if id == 0 { NO_OBJECT } else { segment_color(id) };
        // The low byte of the colour comes first.
        bytes.extend([blue, green, red, 0]);
        bytes.extend(id.to_le_bytes());
        bytes.extend(u32::from_be_bytes([red, green, blue, 255]).to_le_bytes());
    }
    bytes
}

/// Markers for the box and the id of each object.
pub fn markers(objects: &[ShownObject]) -> MarkerArray<'static> {
    MarkerArray { markers: objects.iter().flat_map(|object| [box_marker(object), id_marker(object)]).collect() }
}

/// As [`markers`], for all objects that there are. The first marker deletes those of earlier messages, so that whoever misses
/// one, or comes later, shows no object that is gone.
pub fn all_markers(objects: &[ShownObject]) -> MarkerArray<'static> {
    let mut message = markers(objects);
    message.markers.insert(0, Marker { action: action::DELETE_ALL, ..Marker::default() });
    message
}

fn marker_id(id: SegmentId) -> i32 {
    i32::try_from(id).unwrap_or(i32::MAX)
}

/// The classes that an object may have: its label, then the alternatives. The score is that of the label; of an object
/// without one, or with a label given by hand, it is the confidence of its id.
fn hypotheses(object: &Object) -> impl Iterator<Item = ObjectHypothesis> {
    let score = object.label.as_ref().and(object.label_score).or(object.confidence).map_or(1.0, f64::from);
    let first = ObjectHypothesis { class_id: object.label.clone().unwrap_or_default(), score };
    let others = object.label_alternatives.iter();
    let other = |other: &LabelScore| ObjectHypothesis { class_id: other.label.clone(), score: f64::from(other.score) };
    std::iter::once(first).chain(others.map(other))
}

/// The boxes of objects, with the lasting id of each as text. An object with a label has it as its first class, and other
/// labels that fit as further ones.
pub fn detections<'a>(header: &Header, objects: impl Iterator<Item = &'a Object>) -> Detection3dArray {
    let detection = |object: &Object| {
        let OrientedBox { center, size, rotation } = object.shape.as_ref()?.oriented_box;
        let (turn, size) = (rotation.as_dquat(), size.as_dvec3());
        let center = PoseMessage {
            position: Point { x: center.x, y: center.y, z: center.z },
            orientation: Quaternion { x: turn.x, y: turn.y, z: turn.z, w: turn.w },
        };
        let hypothesis = |hypothesis: ObjectHypothesis| ObjectHypothesisWithPose {
            hypothesis,
            pose: PoseWithCovariance { pose: center.clone(), ..PoseWithCovariance::default() },
        };
        Some(Detection3d {
            header: header.clone(),
            results: hypotheses(object).map(hypothesis).collect(),
            bbox: BoundingBox3d { center, size: Vector3 { x: size.x, y: size.y, z: size.z } },
            id: object.id.to_string(),
        })
    };
    Detection3dArray { header: header.clone(), detections: objects.filter_map(detection).collect() }
}

fn box_marker(object: &ShownObject) -> Marker<'static> {
    let turn = object.oriented_box.rotation.as_dquat();
    let size = object.oriented_box.size.as_dvec3();
    let [r, g, b] = object.color();
    let mut marker = marker(object, BOXES, marker_type::CUBE);
    marker.pose.orientation = Quaternion { x: turn.x, y: turn.y, z: turn.z, w: turn.w };
    marker.scale = Vector3 { x: size.x, y: size.y, z: size.z };
    marker.color = ColorRgba { r, g, b, a: BOX_OPACITY };
    marker
}

fn id_marker(object: &ShownObject) -> Marker<'static> {
    let mut marker = marker(object, IDS, marker_type::TEXT_VIEW_FACING);
    marker.scale.z = f64::from(TEXT_HEIGHT);
    marker.color = ColorRgba { r: 1.0, g: 1.0, b: 1.0, a: 1.0 };
    marker.text = object.text();
    marker
}

/// A permanent marker at an object's centre.
fn marker(object: &ShownObject, namespace: &str, kind: i32) -> Marker<'static> {
    let center = object.oriented_box.center;
    Marker {
        header: Header { stamp: Time::from_nanoseconds(object.first_seen), frame_id: WORLD.to_owned() },
        ns: namespace.to_owned(),
        id: marker_id(object.id),
        kind,
        pose: PoseMessage {
            position: Point { x: center.x, y: center.y, z: center.z },
            orientation: Quaternion::default(),
        },
        ..Marker::default()
    }
}
