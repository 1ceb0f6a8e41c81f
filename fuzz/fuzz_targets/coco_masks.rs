//! COCO annotations from a grammar: nearly all damaged files would be refused by the JSON parser.
#![no_main]

use arbitrary::Arbitrary;
use libfuzzer_sys::fuzz_target;
use serde_json::{Value, json};
use splatseg_dataset::Framing;
use splatseg_fuzz::Place;
use splatseg_geometry::{Image, Intrinsics, Pose, RgbdFrame};
use splatseg_segmenter::{MaskFolder, Segmenter};
use std::cell::OnceCell;
use std::path::Path;

const WIDTH: usize = 16;
const HEIGHT: usize = 12;

#[derive(Arbitrary, Debug)]
struct File {
    annotations: Vec<Annotation>,
    wrapped: bool,
    framing: u8,
}

#[derive(Arbitrary, Debug)]
struct Annotation {
    segmentation: Segmentation,
    score: Option<Number>,
}

#[derive(Arbitrary, Debug)]
enum Segmentation {
    Runs { size: Size, counts: Counts },
    Polygon(Vec<Number>),
    Missing,
}

#[derive(Arbitrary, Debug)]
enum Size {
    Frame,
    Stored,
    Pair(Number, Number),
    List(Vec<Number>),
}

#[derive(Arbitrary, Debug)]
enum Counts {
    /// Made to cover the image.
    Fitting(Vec<u8>),
    List(Vec<Number>),
    Compressed(Vec<u8>),
    Missing,
}

#[derive(Arbitrary, Debug)]
enum Number {
    Small(u8),
    Whole(u64),
    Signed(i64),
    Fraction(f64),
    Text(u8),
    Null,
}

impl Number {
    fn json(&self) -> Value {
        match self {
            Self::Small(value) => json!(value),
            Self::Whole(value) => json!(value),
            Self::Signed(value) => json!(value),
            Self::Fraction(value) => json!(value),
            Self::Text(value) => json!(value.to_string()),
            Self::Null => Value::Null,
        }
    }
}

impl Size {
    fn json(&self) -> Value {
        match self {
            Self::Frame => json!([HEIGHT, WIDTH]),
            Self::Stored => json!([2 * HEIGHT, 2 * WIDTH]),
            Self::Pair(height, width) => json!([height.json(), width.json()]),
            Self::List(list) => list.iter().map(Number::json).collect(),
        }
    }
}

impl Counts {
    fn json(&self, pixels: usize) -> Value {
        match self {
            Self::Fitting(runs) => {
                let mut left = pixels;
                let mut fitting: Vec<usize> = Vec::new();
                for run in runs {
                    let run = usize::from(*run).min(left);
                    left -= run;
                    fitting.push(run);
                }
                fitting.push(left);
                json!(fitting)
            }
            Self::List(list) => list.iter().map(Number::json).collect(),
            Self::Compressed(bytes) => {
                // The characters that the compressed form uses.
                json!(bytes.iter().map(|byte| char::from(48 + byte % 64)).collect::<String>())
            }
            Self::Missing => Value::Null,
        }
    }
}

impl Annotation {
    fn json(&self) -> Value {
        let mut annotation = json!({"category_id": 1});
        match &self.segmentation {
            Segmentation::Runs { size, counts } => {
                let pixels = if matches!(size, Size::Stored) { 4 * WIDTH * HEIGHT } else { WIDTH * HEIGHT };
                annotation["segmentation"] = json!({"size": size.json(), "counts": counts.json(pixels)});
            }
            Segmentation::Polygon(points) => {
                annotation["segmentation"] = json!([points.iter().map(Number::json).collect::<Vec<_>>()]);
            }
            Segmentation::Missing => {}
        }
        if let Some(score) = &self.score {
            annotation["score"] = score.json();
        }
        annotation
    }
}

thread_local!(static PLACE: OnceCell<Place> = const { OnceCell::new() });

fn template(folder: &Path) {
    std::fs::write(folder.join("0.json"), "[]").expect("a temporary file");
}

fuzz_target!(|file: File| {
    let list: Value = file.annotations.iter().map(Annotation::json).collect();
    let document = if file.wrapped { json!({"annotations": list}) } else { list };
    let input = [&[0], document.to_string().as_bytes()].concat();
    let resize = (file.framing & 1 == 1).then(|| "16x12".parse().expect("a size"));
    let framing = Framing { resize, ..Framing::default() };
    let color = Image::filled(WIDTH, HEIGHT, [0; 3]);
    let depth = Image::filled(WIDTH, HEIGHT, 1.0);
    let camera = Intrinsics { width: WIDTH, height: HEIGHT, fx: 16.0, fy: 16.0, cx: 8.0, cy: 6.0 };
    let frame = RgbdFrame::new("0".to_owned(), color, depth, camera, Pose::IDENTITY).expect("a frame");
    Place::with_input(&PLACE, template, &input, |folder| {
        let mut segmenter = MaskFolder::open(folder, framing).expect("a folder with a JSON file");
        if let Ok(masks) = segmenter.segment(&frame) {
            assert!(masks.iter().all(|mask| (mask.mask.width(), mask.mask.height()) == (WIDTH, HEIGHT)));
            assert!(masks.len() <= file.annotations.len());
        }
    });
});
