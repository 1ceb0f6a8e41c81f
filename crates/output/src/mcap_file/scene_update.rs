//! Boxes of objects as Foxglove messages: <https://docs.foxglove.dev/docs/sdk/schemas/scene-update>, as JSON.

use crate::ros_messages::{BOX_OPACITY, ShownObject, TEXT_HEIGHT, WORLD};
use glam::Quat;
use serde::Serialize;
use serde_json::{Value, json};
use splatseg_objects::LabelScore;
use splatseg_ros::Time;

/// Entities to show from a time on. Entities with other ids stay.
#[derive(Debug, Serialize)]
pub(super) struct SceneUpdate {
    deletions: [(); 0],
    entities: Vec<Entity>,
}

/// An object: its box and its id.
#[derive(Debug, Serialize)]
struct Entity {
    timestamp: Seconds,
    frame_id: &'static str,
    id: String,
    /// 0: until it is replaced.
    lifetime: Seconds,
    frame_locked: bool,
    metadata: Vec<KeyValue>,
    cubes: [Cube; 1],
    texts: [Text; 1],
    // An entity must have all these lists.
    arrows: [(); 0],
    spheres: [(); 0],
    cylinders: [(); 0],
    lines: [(); 0],
    triangles: [(); 0],
    models: [(); 0],
}

/// A time or a duration.
#[derive(Debug, Serialize)]
struct Seconds {
    sec: i32,
    nsec: u32,
}

#[derive(Debug, Serialize)]
struct KeyValue {
    key: &'static str,
    value: String,
}

#[derive(Debug, Serialize)]
struct Cube {
    pose: FoxglovePose,
    size: Xyz<f32>,
    color: Rgba,
}

#[derive(Debug, Serialize)]
struct Text {
    pose: FoxglovePose,
    billboard: bool,
    font_size: f32,
    scale_invariant: bool,
    color: Rgba,
    text: String,
}

#[derive(Debug, Serialize)]
struct FoxglovePose {
    position: Xyz<f64>,
    orientation: Xyzw,
}

#[derive(Debug, Serialize)]
struct Xyz<T> {
    x: T,
    y: T,
    z: T,
}

#[derive(Debug, Serialize)]
struct Xyzw {
    x: f32,
    y: f32,
    z: f32,
    w: f32,
}

#[derive(Debug, Serialize)]
struct Rgba {
    r: f32,
    g: f32,
    b: f32,
    a: f32,
}

impl SceneUpdate {
    /// Foxglove's name of the type.
    pub(super) const NAME: &'static str = "foxglove.SceneUpdate";
}

impl<T> From<[T; 3]> for Xyz<T> {
    fn from([x, y, z]: [T; 3]) -> Self {
        Self { x, y, z }
    }
}

/// The message that shows objects.
pub(super) fn scene_update(objects: &[ShownObject]) -> SceneUpdate {
    SceneUpdate { deletions: [], entities: objects.iter().map(entity).collect() }
}

/// Properties of an object: `frames`, `label`, `label_score`, and `label_alternatives` as `cup 0.31, bowl 0.12`.
fn metadata(object: &ShownObject) -> Vec<KeyValue> {
    let mut known = vec![KeyValue { key: "frames", value: object.frames.to_string() }];
    if let Some(label) = &object.label {
        known.push(KeyValue { key: "label", value: label.clone() });
        known.extend(object.label_score.map(|score| KeyValue { key: "label_score", value: format!("{score:.2}") }));
    }
    let other = |other: &LabelScore| format!("{} {:.2}", other.label, other.score);
    if !object.label_alternatives.is_empty() {
        let value = object.label_alternatives.iter().map(other).collect::<Vec<_>>().join(", ");
        known.push(KeyValue { key: "label_alternatives", value });
    }
    known
}

fn entity(object: &ShownObject) -> Entity {
    let shape = &object.oriented_box;
    let pose = |turn: Quat| FoxglovePose {
        position: shape.center.to_array().into(),
        orientation: Xyzw { x: turn.x, y: turn.y, z: turn.z, w: turn.w },
    };
    let [r, g, b] = object.color();
    let stamp = Time::from_nanoseconds(object.first_seen);
    Entity {
        timestamp: Seconds { sec: stamp.sec, nsec: stamp.nanosec },
        frame_id: WORLD,
        id: object.id.to_string(),
        lifetime: Seconds { sec: 0, nsec: 0 },
        frame_locked: false,
        metadata: metadata(object),
        cubes: [Cube {
            pose: pose(shape.rotation),
            size: shape.size.to_array().into(),
            color: Rgba { r, g, b, a: BOX_OPACITY },
        }],
        texts: [Text {
            pose: pose(Quat::IDENTITY),
            billboard: true,
            font_size: TEXT_HEIGHT,
            scale_invariant: false,
            color: Rgba { r: 1.0, g: 1.0, b: 1.0, a: 1.0 },
            text: object.text(),
        }],
        arrows: [],
        spheres: [],
        cylinders: [],
        lines: [],
        triangles: [],
        models: [],
    }
}

/// The JSON schema of [`SceneUpdate`]: the parts of Foxglove's schema that are used here.
pub(super) fn schema() -> Value {
    let number = || json!({ "type": "number" });
    let text = || json!({ "type": "string" });
    let flag = || json!({ "type": "boolean" });
    let list = |items: Value| json!({ "type": "array", "items": items });
    let nothing = || list(json!({ "type": "object", "properties": {} }));
    let object = |title: &str, properties: Value| {
        let required: Vec<&String> = properties.as_object().into_iter().flat_map(|map| map.keys()).collect();
        json!({ "title": title, "type": "object", "required": required, "properties": properties })
    };
    let seconds = |title| object(title, json!({ "sec": { "type": "integer" }, "nsec": { "type": "integer" } }));
    let vector = || object("foxglove.Vector3", json!({ "x": number(), "y": number(), "z": number() }));
    let turn = || {
        let parts = json!({ "x": number(), "y": number(), "z": number(), "w": number() });
        object("foxglove.Quaternion", parts)
    };
    let pose = || object("foxglove.Pose", json!({ "position": vector(), "orientation": turn() }));
    let color = || object("foxglove.Color", json!({ "r": number(), "g": number(), "b": number(), "a": number() }));
    let metadata = object("foxglove.KeyValuePair", json!({ "key": text(), "value": text() }));
    let cube = object("foxglove.CubePrimitive", json!({ "pose": pose(), "size": vector(), "color": color() }));
    let label = json!({
        "pose": pose(), "billboard": flag(), "font_size": number(), "scale_invariant": flag(), "color": color(),
        "text": text(),
    });
    let entity = json!({
        "timestamp": seconds("time"), "frame_id": text(), "id": text(), "lifetime": seconds("duration"),
        "frame_locked": flag(), "metadata": list(metadata), "cubes": list(cube),
        "texts": list(object("foxglove.TextPrimitive", label)), "arrows": nothing(), "spheres": nothing(),
        "cylinders": nothing(), "lines": nothing(), "triangles": nothing(), "models": nothing(),
    });
    let entities = list(object("foxglove.SceneEntity", entity));
    object(SceneUpdate::NAME, json!({ "deletions": nothing(), "entities": entities }))
}
