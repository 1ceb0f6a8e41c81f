//! Objects of the synthetic room, named by a function that knows colours.

use splatseg::dataset::{FrameStream, GroundTruth, open_scene};
use splatseg::memory::Attached;
use splatseg::objects::ObjectName;
use splatseg::pipeline::{NameObjectsError, NamedMap, ObjectToName};
use splatseg::{Pipeline, Settings};
use splatseg_files::StateBlock;
use std::collections::BTreeMap;
use std::error::Error;

const ROOM: &str = "synthetic:frames=8,width=96,height=72,objects=6";

/// The mean colour of an object, and what is strongest in it.
fn color(object: ObjectToName<'_>) -> Result<ObjectName, Box<dyn Error + Send + Sync>> {
    let pixels = object.view.image.pixels().iter().zip(object.view.mask.pixels());
    let shown: Vec<[u8; 3]> = pixels.filter(|(_, shows)| **shows).map(|(pixel, _)| *pixel).collect();
    let mean = [0, 1, 2]
        .map(|channel| shown.iter().map(|pixel| f32::from(pixel[channel])).sum::<f32>() / shown.len().max(1) as f32);
    let label = if mean[0] >= mean[2] { "red" } else { "blue" };
    Ok(ObjectName { label: Some(label.to_owned()), embedding: mean.to_vec(), ..ObjectName::default() })
}

fn run(pipeline: &mut Pipeline, settings: &Settings) {
    let scene = open_scene(ROOM, &settings.dataset).unwrap();
    for processed in pipeline.run(FrameStream::open(scene, &settings.dataset, GroundTruth::Skip).unwrap()) {
        processed.unwrap().result.unwrap();
    }
}

fn labels(pipeline: &Pipeline) -> BTreeMap<u32, Option<String>> {
    pipeline.object_list().all().map(|object| (object.id, object.label.clone())).collect()
}

#[test]
fn names_are_given_once_saved_and_loaded() {
    let (settings, folder) = (Settings::default(), tempfile::tempdir().unwrap());
    let [map, again, without] = ["map.ply", "again.ply", "without.ply"].map(|name| folder.path().join(name));
    let mut pipeline = Pipeline::builder(&settings).keep_views().build().unwrap();
    run(&mut pipeline, &settings);
    pipeline.save_memory(&without).unwrap();
    let calls = pipeline.name_objects(color).unwrap();
    assert!(calls >= 4, "{calls}");
    assert_eq!(pipeline.name_objects(color).unwrap(), 0, "the views are the same");
    let named = labels(&pipeline).values().flatten().count();
    assert_eq!(named, calls);
    assert!(!pipeline.find_label("red").is_empty());

    // The object most similar to an embedding is the one that has it.
    let id = pipeline.find_label("red")[0];
    let embedding = pipeline.names().embedding(id).to_vec();
    let (found, similarity) = pipeline.find(&embedding).unwrap()[0];
    assert!(similarity > 0.999, "{similarity}");
    assert!(pipeline.names().label(found).is_some());

    pipeline.save_memory(&map).unwrap();
    let loaded = Pipeline::builder(&settings).saved_memory(&map).build().unwrap();
    assert_eq!(loaded.names(), pipeline.names());
    loaded.save_memory(&again).unwrap();
    assert!(NamedMap::load(&again).unwrap().names == *pipeline.names());
    let saved = NamedMap::load(&map).unwrap();
    assert_eq!(saved.names.find_label("red"), pipeline.find_label("red"));
    assert!(NamedMap::load(&without).unwrap().names.is_empty());
}

#[test]
fn errors_of_the_function_and_missing_views_are_told() {
    let settings = Settings::default();
    let mut pipeline = Pipeline::builder(&settings).build().unwrap();
    assert!(matches!(pipeline.name_objects(color), Err(NameObjectsError::NoViews)));

    let mut pipeline = Pipeline::builder(&settings).keep_views().build().unwrap();
    run(&mut pipeline, &settings);
    let mut first = true;
    let error = pipeline.name_objects(|object| match std::mem::take(&mut first) {
        true => color(object),
        false => Err("no network".into()),
    });
    assert!(error.unwrap_err().to_string().ends_with("no network"));
    assert_eq!(pipeline.names().labels().count(), 1, "names given before the error stay");
    let mut length = 3;
    let error = pipeline.name_objects(|object| {
        length += 1;
        Ok(ObjectName { embedding: vec![1.0; length], ..color(object)? })
    });
    assert!(matches!(error, Err(NameObjectsError::Name { .. })), "{error:?}");
}

#[test]
fn damaged_names_in_a_map_are_an_error_that_names_the_file() {
    let (settings, folder) = (Settings::default(), tempfile::tempdir().unwrap());
    let map = folder.path().join("map.ply");
    let mut pipeline = Pipeline::builder(&settings).build().unwrap();
    run(&mut pipeline, &settings);
    let mut names = StateBlock::default();
    names.put("id", &[], [1u32]);
    names.put("score", &[], [1.0f64]);
    names.put_json("labels.json", &["two\nlines"]);
    let names = names.to_bytes().unwrap();
    let attached = Attached { keyframes: None, names: Some(&names), history: None };
    pipeline.memory().unwrap().save_with(&map, attached).unwrap();
    for error in [
        NamedMap::load(&map).err().unwrap().to_string(),
        Pipeline::builder(&settings).saved_memory(&map).build().err().unwrap().to_string(),
    ] {
        assert!(error.contains("map.ply") && error.contains("control characters"), "{error}");
    }
}
