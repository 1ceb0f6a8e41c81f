//! JSON files with predicted masks, as `splatseg eval` reads them, from a grammar: nearly all damaged files would be
//! refused by the JSON parser.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use serde_json::{Map, Value, json};
use splatseg::evaluation::{EvaluationOptions, Ids, MissingFrames, evaluate};
use splatseg_dataset::{DatasetSettings, SyntheticScene};
use splatseg_fuzz::Place;
use splatseg_metrics::ScoreSettings;
use std::cell::OnceCell;
use std::path::Path;

const ROOM: &str = "synthetic:frames=2,width=16,height=12,objects=2";

#[derive(Arbitrary, Debug)]
struct File {
    annotations: Vec<Annotation>,
    images: Option<Vec<(Text, Text)>>,
    frames: Option<Vec<Text>>,
    wrapped: bool,
    resized: bool,
    per_frame: bool,
}

#[derive(Arbitrary, Debug)]
struct Annotation {
    id: Option<Text>,
    track_id: Option<Text>,
    place: Option<(At, Text)>,
    masks: Masks,
}

#[derive(Arbitrary, Debug)]
enum At {
    Frame,
    FileName,
    Image,
    ImageId,
    VideoId,
}

#[derive(Arbitrary, Debug)]
enum Masks {
    One(Mask),
    Track(Vec<Option<Mask>>),
    Missing,
}

#[derive(Arbitrary, Debug)]
struct Mask {
    size: Option<(u16, u16)>,
    counts: Counts,
}

#[derive(Arbitrary, Debug)]
enum Counts {
    List(Vec<u16>),
    Any(Vec<u64>),
    Compressed(Vec<u8>),
    Missing,
}

/// A name or number.
#[derive(Arbitrary, Debug)]
enum Text {
    Number(u8),
    Large(i64),
    Padded(u8),
    Path(u8),
    Any(String),
    Null,
}

impl Text {
    fn json(&self) -> Value {
        match self {
            Self::Number(number) => json!(number % 4),
            Self::Large(number) => json!(number),
            Self::Padded(number) => json!(format!("{:06}", number % 4)),
            Self::Path(number) => json!(format!("a/b\\{}.jpg", number % 4)),
            Self::Any(text) => json!(text),
            Self::Null => Value::Null,
        }
    }
}

impl Mask {
    fn json(&self) -> Value {
        let counts = match &self.counts {
            Counts::List(counts) => json!(counts),
            Counts::Any(counts) => json!(counts),
            Counts::Compressed(bytes) => {
                json!(bytes.iter().map(|byte| char::from(48 + byte % 64)).collect::<String>())
            }
            Counts::Missing => Value::Null,
        };
        let (height, width) = self.size.unwrap_or((12, 16));
        json!({"size": [height, width], "counts": counts})
    }
}

impl Annotation {
    fn json(&self) -> Value {
        let mut entries = Map::new();
        let mut add = |key: &str, value: Option<Value>| entries.extend(value.map(|value| (key.to_owned(), value)));
        add("id", self.id.as_ref().map(Text::json));
        add("track_id", self.track_id.as_ref().map(Text::json));
        if let Some((place, text)) = &self.place {
            let key = match place {
                At::Frame => "frame",
                At::FileName => "file_name",
                At::Image => "image",
                At::ImageId => "image_id",
                At::VideoId => "video_id",
            };
            add(key, Some(text.json()));
        }
        match &self.masks {
            Masks::One(mask) => add("segmentation", Some(mask.json())),
            Masks::Track(masks) => {
                add(
                    "segmentations",
                    Some(masks.iter().map(|mask| mask.as_ref().map_or(Value::Null, Mask::json)).collect()),
                );
            }
            Masks::Missing => {}
        }
        Value::Object(entries)
    }
}

impl File {
    fn json(&self) -> Value {
        let list: Value = self.annotations.iter().map(Annotation::json).collect();
        if !self.wrapped {
            return list;
        }
        let mut document = json!({"annotations": list});
        if let Some(images) = &self.images {
            let image = |(id, name): &(Text, Text)| json!({"id": id.json(), "file_name": name.json()});
            document["images"] = images.iter().map(image).collect();
        }
        if let Some(frames) = &self.frames {
            document["frames"] = frames.iter().map(Text::json).collect();
        }
        document
    }
}

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });
thread_local!(static SCENE: SyntheticScene =
    SyntheticScene::new(ROOM.parse().expect("settings of a room")).expect("a room"));

fn template(folder: &Path) {
    std::fs::write(folder.join("masks.json"), "[]").expect("a temporary file");
}

fuzz_target!(|file: File| {
    let input = [&[0], file.json().to_string().as_bytes()].concat();
    let mut dataset = DatasetSettings::default();
    dataset.resize = file.resized.then(|| "8x6".parse().expect("a size"));
    let ids = if file.per_frame { Ids::PerFrame } else { Ids::Lasting };
    let options = EvaluationOptions {
        score: ScoreSettings::default(),
        missing: MissingFrames::Allowed,
        ids,
        video: None,
        min_score: 0.0,
        truth: None,
    };
    Place::with_input(&PLACE, template, &input, |folder| {
        SCENE.with(|scene| {
            if let Ok(found) = evaluate(scene, &dataset, &folder.join("masks.json"), &options) {
                assert_eq!(found.score.counts().frames, 2);
            }
        });
    });
});
