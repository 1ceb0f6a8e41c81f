//! `splatseg export --as scene-graph`: its JSON against the schema of docs/scene_graph.schema.json.

use crate::export::{exported, place, refused};
use serde_json::{Value, json};
use splatseg_objects::SceneGraph;
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

fn schema() -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/scene_graph.schema.json");
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The first place where a value does not fit a schema. Knows the words that our schema uses, and `required` and
/// `properties` together allow no other keys, so that none is forgotten.
fn misfit(root: &Value, schema: &Value, value: &Value, place: &str) -> Option<String> {
    for (word, rule) in schema.as_object().unwrap() {
        let fits = match word.as_str() {
            "description" | "title" | "$schema" | "$id" | "$defs" => true,
            "$ref" => {
                let name = rule.as_str().unwrap().strip_prefix("#/$defs/").unwrap();
                return misfit(root, &root["$defs"][name], value, place);
            }
            "const" => value == rule,
            "enum" => rule.as_array().unwrap().contains(value),
            "anyOf" => rule.as_array().unwrap().iter().any(|rule| misfit(root, rule, value, place).is_none()),
            "type" => match rule {
                Value::Array(kinds) => kinds.iter().any(|kind| is_of(kind, value)),
                kind => is_of(kind, value),
            },
            "minimum" => !value.as_f64().is_some_and(|value| value < rule.as_f64().unwrap()),
            "maximum" => !value.as_f64().is_some_and(|value| value > rule.as_f64().unwrap()),
            "minItems" => value.as_array().is_none_or(|items| items.len() as u64 >= rule.as_u64().unwrap()),
            "maxItems" => value.as_array().is_none_or(|items| items.len() as u64 <= rule.as_u64().unwrap()),
            "items" => {
                let mut items = value.as_array().into_iter().flatten().enumerate();
                let found = items.find_map(|(at, item)| misfit(root, rule, item, &format!("{place}[{at}]")));
                if found.is_some() {
                    return found;
                }
                true
            }
            "required" => rule.as_array().unwrap().iter().all(|key| value.get(key.as_str().unwrap()).is_some()),
            "properties" => {
                for (key, value) in value.as_object().into_iter().flatten() {
                    let place = format!("{place}.{key}");
                    let found = rule.get(key).map_or(Some(place.clone()), |rule| misfit(root, rule, value, &place));
                    if found.is_some() {
                        return found;
                    }
                }
                true
            }
            other => panic!("unknown word {other}"),
        };
        if !fits {
            return Some(format!("{place}: {word}"));
        }
    }
    None
}

fn is_of(kind: &Value, value: &Value) -> bool {
    match kind.as_str().unwrap() {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "null" => value.is_null(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        other => panic!("unknown type {other}"),
    }
}

#[test]
fn a_scene_graph_fits_its_schema() {
    let folder = place();
    let ended = exported(folder.path(), &["--as", "scene-graph", "--out", "home.json"]);
    let text = fs::read_to_string(folder.path().join("home.json")).unwrap();
    let value: Value = serde_json::from_str(&text).unwrap();
    let schema = schema();
    assert_eq!(misfit(&schema, &schema, &value, "graph"), None);
    let graph: SceneGraph = serde_json::from_str(&text).unwrap();
    assert!(graph.objects.len() >= 5 && graph.frames == 18 && graph.rooms.len() == 1, "{}", ended.out);
    let ids: BTreeSet<u32> = graph.objects.iter().map(|object| object.id).collect();
    assert!(graph.relations.iter().all(|one| ids.contains(&one.subject) && ids.contains(&one.object)));
    assert!(graph.objects.iter().all(|object| object.last_seen.frame.is_some_and(|frame| frame < 18)));
    assert!(graph.up.unwrap().z > 0.99);

    // The check finds faults.
    let changed = |path: &str, with: Value| {
        let mut value = value.clone();
        *value.pointer_mut(path).unwrap() = with;
        misfit(&schema, &schema, &value, "graph")
    };
    assert_eq!(changed("/version", json!(2)).as_deref(), Some("graph.version: const"));
    assert_eq!(changed("/objects/0/id", json!(-1)).as_deref(), Some("graph.objects[0].id: minimum"));
    assert!(changed("/objects/0/last_seen", json!({ "frame": 1 })).is_some());
    assert!(changed("/objects/0/box", json!(3)).is_some());
}

#[test]
fn a_graph_is_replaced_only_by_a_graph() {
    let folder = place();
    let export = ["--as", "scene-graph", "--out", "home.json"];
    exported(folder.path(), &export);
    assert!(refused(folder.path(), &export).contains("exists: give --overwrite"));
    exported(folder.path(), &[export.as_slice(), &["--overwrite"]].concat());
    fs::write(folder.path().join("other.json"), "{}").unwrap();
    let error = refused(folder.path(), &["--as", "scene-graph", "--out", "other.json", "--overwrite"]);
    assert!(error.contains("exists and is not a scene graph by splatseg"), "{error}");
    let error = refused(folder.path(), &["--as", "scene-graph", "--out", "new.json", "--id", "1"]);
    assert!(error.contains("--id: a scene graph has all objects"), "{error}");
}
