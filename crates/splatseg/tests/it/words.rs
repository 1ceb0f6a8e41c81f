//! Things on a wall get names from a tiny network for images and words, which knows shapes and colours: it was trained with
//! `training/splatseg_training/words.py`.

use crate::tiny_clip::{write_network, write_vocabulary};
use splatseg::names::{ClipNames, Query, find_objects};
use splatseg::pipeline::{NamedMap, PipelineError};
use splatseg::segmenter::SegmenterError;
use splatseg::settings::SettingsLayers;
use splatseg::{
    CameraFrame, Image, Intrinsics, Mask, Pipeline, Pose, RgbdFrame, ScoredMask, SegmentId, Segmentation, Segmenter,
    Settings,
};
use splatseg_geometry::RemappedId;
use splatseg_objects::ObjectNames;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use tempfile::TempDir;

const FRAMES: usize = 6;
const CAMERA: Intrinsics = Intrinsics { fx: 260.0, fy: 260.0, cx: 159.5, cy: 119.5, width: 320, height: 240 };
const NEAR: f32 = 1.8;
const WALL: f32 = 2.0;

/// A thing: its name, colour, place and radius, metres.
struct Thing {
    name: &'static str,
    color: [u8; 3],
    place: [f32; 2],
    radius: f32,
}

const fn thing(name: &'static str, color: [u8; 3], place: [f32; 2], radius: f32) -> Thing {
    Thing { name, color, place, radius }
}

const THINGS: [Thing; 8] = [
    thing("red ball", [185, 40, 40], [-0.8, -0.42], 0.16),
    thing("blue box", [45, 80, 170], [-0.3, -0.42], 0.16),
    thing("green cone", [55, 135, 65], [0.3, -0.42], 0.18),
    thing("yellow ball", [225, 200, 60], [0.8, -0.42], 0.14),
    thing("white box", [230, 230, 225], [-0.8, 0.42], 0.18),
    thing("black cone", [32, 30, 34], [-0.3, 0.42], 0.16),
    thing("blue ball", [50, 75, 175], [0.3, 0.42], 0.18),
    thing("red box", [180, 35, 45], [0.8, 0.42], 0.11),
];

impl Thing {
    /// True if a point in the plane of the things shows it.
    fn has(&self, [x, y]: [f32; 2]) -> bool {
        let (u, v) = ((x - self.place[0]) / self.radius, (y - self.place[1]) / self.radius);
        match self.name {
            name if name.ends_with("ball") => u * u + v * v < 1.0,
            name if name.ends_with("box") => u.abs() < 0.95 && v.abs() < 0.95,
            _ => v.abs() < 1.0 && u.abs() < f32::midpoint(v, 1.0),
        }
    }
}

/// The thing that a pixel of a frame shows.
fn shown(frame: usize, (column, row): (usize, usize)) -> Option<&'static Thing> {
    let x = (column as f32 - CAMERA.cx) / CAMERA.fx * NEAR + 0.01 * frame as f32;
    let y = (row as f32 - CAMERA.cy) / CAMERA.fy * NEAR;
    THINGS.iter().find(|thing| thing.has([x, y]))
}

fn frame(number: usize) -> RgbdFrame<'static> {
    let color = Image::from_fn(CAMERA.width, CAMERA.height, |column, row| match shown(number, (column, row)) {
        Some(thing) => thing.color,
        None => [130, 125, 118 + (column / 40 + row / 40) as u8 % 2 * 6],
    });
    let depth =
        Image::from_fn(CAMERA.width, CAMERA.height, |column, row| shown(number, (column, row)).map_or(WALL, |_| NEAR));
    let mut pose = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    pose[3] = 0.01 * number as f64;
    let pose = Pose::from_row_major(pose).unwrap();
    RgbdFrame::new(number.to_string(), color, depth, CAMERA, pose).unwrap()
}

/// The true masks.
struct TrueMasks;

impl Segmenter for TrueMasks {
    fn name(&self) -> &str {
        "true-masks"
    }

    fn segment(&mut self, frame: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        let number: usize = frame.name().parse().unwrap();
        let mask = |wanted: Option<&str>| {
            let mask = Mask::from_fn(CAMERA.width, CAMERA.height, |column, row| {
                shown(number, (column, row)).map(|thing| thing.name) == wanted
            });
            ScoredMask { mask, score: 1.0 }
        };
        let masks = std::iter::once(None).chain(THINGS.iter().map(|thing| Some(thing.name))).map(mask);
        Ok(masks.collect::<Vec<_>>().into())
    }
}

/// A folder with the network, a vocabulary and a map.
struct Files(TempDir);

impl Files {
    fn new() -> Self {
        let files = Self(tempfile::tempdir().unwrap());
        write_network(&files.network());
        write_vocabulary(&files.vocabulary(), &[]);
        files
    }

    fn network(&self) -> PathBuf {
        self.0.path().join("tiny.safetensors")
    }

    fn vocabulary(&self) -> PathBuf {
        self.0.path().join("things.txt")
    }

    fn map(&self) -> PathBuf {
        self.0.path().join("map.ply")
    }

    fn names(&self) -> ClipNames {
        ClipNames::open(&self.network(), Some(&self.vocabulary())).unwrap()
    }

    fn settings(&self) -> Settings {
        self.layers().resolve().unwrap()
    }

    fn layers(&self) -> SettingsLayers {
        let mut layers = SettingsLayers::default();
        layers.add_assignment("namer=clip").unwrap();
        layers.add_assignment(&format!("names={}", self.network().display())).unwrap();
        layers.add_assignment(&format!("vocabulary={}", self.vocabulary().display())).unwrap();
        layers
    }
}

fn run(settings: &Settings) -> Result<Pipeline, PipelineError> {
    let mut pipeline = Pipeline::builder(settings).segmenter(Box::new(TrueMasks)).build()?;
    for number in 0..FRAMES {
        pipeline.step(&frame(number))?;
    }
    Ok(pipeline)
}

/// The id of each thing, and of the wall under its own name, from the last result.
fn ids(pipeline: &mut Pipeline) -> BTreeMap<&'static str, SegmentId> {
    let result = pipeline.step(&frame(FRAMES - 1)).unwrap();
    let segments = result.output.segments;
    let name = |column: usize, row: usize| shown(FRAMES - 1, (column, row)).map_or("wall", |thing| thing.name);
    let mut votes: BTreeMap<&str, BTreeMap<SegmentId, usize>> = BTreeMap::new();
    for row in 0..segments.height() {
        for (column, id) in segments.row(row).iter().enumerate() {
            *votes.entry(name(column, row)).or_default().entry(*id).or_default() += 1;
        }
    }
    votes.into_iter().map(|(name, votes)| (name, *votes.iter().max_by_key(|(_, count)| **count).unwrap().0)).collect()
}

/// Number of things with the right label.
fn right(ids: &BTreeMap<&'static str, SegmentId>, label: impl Fn(SegmentId) -> Option<String>) -> usize {
    THINGS.iter().filter(|thing| label(ids[thing.name]).as_deref() == Some(thing.name)).count()
}

#[test]
fn most_things_get_the_right_name_and_keep_it() {
    let files = Files::new();
    let mut pipeline = run(&files.settings()).unwrap();
    assert!(pipeline.names().is_empty(), "a slow namer waits for the end of the frames");
    let ids = ids(&mut pipeline);
    assert!(pipeline.finish_names().unwrap() >= THINGS.len());
    assert_eq!(pipeline.finish_names().unwrap(), 0, "the views are the same");
    let found = right(&ids, |id| pipeline.names().label(id).map(str::to_owned));
    assert!(found >= 7, "{found} of {}: {:?}", THINGS.len(), pipeline.names().labels().collect::<Vec<_>>());
    assert_eq!(pipeline.names().label(ids["wall"]), None, "the wall is no thing of the vocabulary");
    let list = pipeline.object_list();
    let object = list.objects.iter().find(|object| object.id == ids["red ball"]).unwrap();
    assert!(object.label_score.is_some_and(|score| score > 0.15), "{object:?}");

    // What a person says stays, and names survive the file and the merging of ids.
    pipeline.name_by_hand(ids["blue ball"], Some("earth")).unwrap();
    pipeline.finish_names().unwrap();
    pipeline.save_memory(files.map()).unwrap();
    let mut map = NamedMap::load(files.map()).unwrap();
    assert_eq!(map.names.label(ids["blue ball"]), Some("earth"));
    for thing in THINGS {
        assert_eq!(map.names.name(ids[thing.name]), pipeline.names().name(ids[thing.name]));
    }
    let (from, into) = (ids["blue ball"], ids["red ball"]);
    map.names.remap(&[RemappedId { from, into }]);
    assert_eq!((map.names.label(into), map.names.label(from)), (Some("earth"), None));
}

#[test]
fn things_are_found_by_words() {
    let files = Files::new();
    let mut pipeline = run(&files.settings()).unwrap();
    let ids = ids(&mut pipeline);
    pipeline.finish_names().unwrap();
    let (list, network) = (pipeline.object_list(), files.names());
    let first = |text: &str, network: Option<&ClipNames>| {
        let found = find_objects(&Query::new(text), &list, pipeline.names(), network).unwrap();
        found.first().map(|found| found.id)
    };
    for thing in THINGS {
        assert_eq!(first(thing.name, Some(&network)), Some(ids[thing.name]), "{}", thing.name);
    }
    // By label, colour and size alone.
    assert_eq!(first("the small red one", None), Some(ids["red box"]));
    assert_eq!(first("red ball", None), Some(ids["red ball"]));
    assert_eq!(first("where is the cone? the green one", None), Some(ids["green cone"]));
    assert_eq!(first("piano", None), None);
}

/// Texts, and the things that each may mean.
const QUERIES: [(&str, &[&str]); 20] = [
    ("red ball", &["red ball"]),
    ("blue box", &["blue box"]),
    ("green cone", &["green cone"]),
    ("yellow ball", &["yellow ball"]),
    ("white box", &["white box"]),
    ("black cone", &["black cone"]),
    ("blue ball", &["blue ball"]),
    ("Where is the red box?", &["red box"]),
    ("the green one", &["green cone"]),
    ("find the yellow thing", &["yellow ball"]),
    ("something black", &["black cone"]),
    ("the white object", &["white box"]),
    ("a ball that is blue", &["blue ball"]),
    ("the small red one", &["red box"]),
    ("the big red one", &["red ball"]),
    ("cone", &["green cone", "black cone"]),
    ("boxes", &["blue box", "white box", "red box"]),
    ("my ball", &["red ball", "yellow ball", "blue ball"]),
    ("the large blue ball", &["blue ball"]),
    ("small box", &["red box"]),
];

#[test]
fn most_of_twenty_queries_find_the_right_thing_first() {
    let files = Files::new();
    let mut pipeline = run(&files.settings()).unwrap();
    let ids = ids(&mut pipeline);
    pipeline.finish_names().unwrap();
    let (list, network) = (pipeline.object_list(), pipeline.names_network().unwrap());
    let wrong = |network: Option<&ClipNames>| -> Vec<&str> {
        let is_wrong = |(text, meant): &(&'static str, &[&str])| {
            let found = find_objects(&Query::new(text), &list, pipeline.names(), network).unwrap();
            let first = found.first().map(|found| found.id);
            (!meant.iter().any(|thing| first == Some(ids[thing]))).then_some(*text)
        };
        QUERIES.iter().filter_map(is_wrong).collect()
    };
    let (with, without) = (wrong(Some(&network)), wrong(None));
    println!("wrong of {}: {with:?} with the network, {without:?} by labels, colours and sizes", QUERIES.len());
    assert!(with.len() <= 3 && without.len() <= 3, "{with:?}, {without:?}");
    let nothing = find_objects(&Query::new("piano"), &list, pipeline.names(), None).unwrap();
    assert!(nothing.is_empty(), "{nothing:?}");
}

#[test]
fn things_are_named_beside_the_frames() {
    let files = Files::new();
    let mut pipeline = Pipeline::builder(&files.settings()).segmenter(Box::new(TrueMasks)).build().unwrap();
    pipeline.name_beside_frames().unwrap();
    for number in 0..FRAMES {
        pipeline.step(&frame(number)).unwrap();
    }
    // The camera rests.
    let started = Instant::now();
    while pipeline.names().labels().count() < THINGS.len() - 1 && started.elapsed() < Duration::from_secs(15) {
        pipeline.name_while_idle();
        std::thread::sleep(Duration::from_millis(1));
    }
    let ids = ids(&mut pipeline);
    let found = right(&ids, |id| pipeline.names().label(id).map(str::to_owned));
    assert!(found >= THINGS.len() - 2, "{found}: {:?}", pipeline.names().labels().collect::<Vec<_>>());
    // A label given by hand meanwhile stays, and the end names the rest.
    pipeline.name_by_hand(ids["red ball"], Some("apple")).unwrap();
    pipeline.finish_names().unwrap();
    assert_eq!(pipeline.names().label(ids["red ball"]), Some("apple"));
    let found = right(&ids, |id| pipeline.names().label(id).map(str::to_owned));
    assert!(found >= THINGS.len() - 2, "{found}");
    assert_eq!(pipeline.finish_names().unwrap(), 0);
}

/// A network that is carried out in steps between the frames gives the same embeddings as one that is not interrupted.
#[test]
fn names_from_beside_the_frames_are_the_same_bytes() {
    let files = Files::new();
    let mut pipeline = Pipeline::builder(&files.settings()).segmenter(Box::new(TrueMasks)).build().unwrap();
    pipeline.name_beside_frames().unwrap();
    for number in 0..FRAMES {
        pipeline.step(&frame(number)).unwrap();
    }
    let mut at_once = run(&files.settings()).unwrap();
    at_once.finish_names().unwrap();
    let expected: BTreeMap<SegmentId, Vec<f32>> =
        at_once.names().embeddings().map(|(id, embedding)| (id, embedding.to_vec())).collect();
    let started = Instant::now();
    while pipeline.names().embeddings().count() < expected.len() && started.elapsed() < Duration::from_secs(15) {
        pipeline.name_while_idle();
        std::thread::sleep(Duration::from_millis(1));
    }
    // An object may have been looked at before its last views.
    let is_final = |pipeline: &Pipeline| {
        pipeline.names().embeddings().filter(|(id, embedding)| expected[id] == *embedding).count()
    };
    assert!(is_final(&pipeline) >= expected.len() - 2, "{} of {}", is_final(&pipeline), expected.len());
    pipeline.finish_names().unwrap();
    assert_eq!(pipeline.names().embeddings().count(), expected.len());
}

#[test]
fn a_share_of_nothing_leaves_all_names_to_the_end() {
    let files = Files::new();
    let mut layers = files.layers();
    layers.add_assignment("clip.cpu_share=0").unwrap();
    let settings = layers.resolve().unwrap();
    let mut pipeline = Pipeline::builder(&settings).segmenter(Box::new(TrueMasks)).build().unwrap();
    pipeline.name_beside_frames().unwrap();
    pipeline.step(&frame(0)).unwrap();
    assert!(!pipeline.name_while_idle());
    assert!(pipeline.names().is_empty() && pipeline.finish_names().unwrap() >= THINGS.len());
}

#[test]
fn names_go_on_in_a_later_run_with_the_map() {
    let files = Files::new();
    let mut pipeline = run(&files.settings()).unwrap();
    let before = ids(&mut pipeline);
    pipeline.finish_names().unwrap();
    pipeline.name_by_hand(before["blue ball"], Some("earth")).unwrap();
    pipeline.save_memory(files.map()).unwrap();
    let names = pipeline.names().clone();

    // The same frames show nothing better, so every name stays as it is.
    let settings = files.settings();
    let again = Pipeline::builder(&settings).segmenter(Box::new(TrueMasks)).saved_memory(files.map());
    let mut again = again.build().unwrap();
    for number in 0..FRAMES {
        again.step(&frame(number)).unwrap();
    }
    let after = ids(&mut again);
    assert_eq!(after, before);
    again.finish_names().unwrap();
    for id in before.values() {
        assert_eq!(again.names().name(*id).map(|name| &name.label), names.name(*id).map(|name| &name.label));
    }
    assert_eq!(again.names().label(after["blue ball"]), Some("earth"));

    // Two ids that turn out to be one thing have one name, that of the person.
    let remapped = [RemappedId { from: before["red ball"], into: before["blue ball"] }];
    let mut joined = names.clone();
    joined.remap(&remapped);
    let saved = ObjectNames::from_bytes(&joined.to_bytes()).unwrap();
    assert!(saved == joined);
    assert_eq!((saved.label(before["blue ball"]), saved.label(before["red ball"])), (Some("earth"), None));
}

#[test]
fn a_map_saved_without_names_is_named_from_its_keyframes() {
    let files = Files::new();
    let mut pipeline = run(&Settings::default()).unwrap();
    let ids = ids(&mut pipeline);
    pipeline.save_memory(files.map()).unwrap();
    let mut map = NamedMap::load(files.map()).unwrap();
    assert!(map.names.is_empty());
    map.names.set_by_hand(ids["white box"], Some("fridge")).unwrap();
    assert!(map.name_from_keyframes(files.map(), &files.names()).unwrap() >= THINGS.len());
    let found = right(&ids, |id| map.names.label(id).map(str::to_owned));
    assert!(found >= 5, "{found}: {:?}", map.names.labels().collect::<Vec<_>>());
    assert_eq!(map.names.label(ids["white box"]), Some("fridge"));
    let saved = files.0.path().join("named.ply");
    map.save(&saved).unwrap();
    let again = NamedMap::load(&saved).unwrap();
    assert!(again.names == map.names && again.keyframes == map.keyframes);
}

#[test]
fn a_network_that_cannot_be_used_is_an_error_before_the_first_frame() {
    let files = Files::new();
    let settings = files.settings();
    std::fs::write(files.network(), "{}").unwrap();
    let error = Pipeline::builder(&settings).build().err().unwrap().to_string();
    assert!(error.contains("tiny.safetensors") && error.lines().count() == 1, "{error}");
}
