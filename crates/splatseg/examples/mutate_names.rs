//! Reads damaged files and texts of everything that names need, in one process, as `mutate` of `splatseg-dataset` does with
//! scenes.
//!
//! ```sh
//! cargo run -p splatseg --example mutate_names -- 60 checkpoint     # seconds for each, readers (all)
//! ```
//!
//! | reader | input |
//! | --- | --- |
//! | `checkpoint` | `.safetensors` of a tiny CLIP network, changed in its header; then an image and a text |
//! | `config` | the JSON file beside it |
//! | `text` | texts for the tokenizer |
//! | `merges` | merges of a tokenizer; then a text |
//! | `vocabulary` | files of labels |
//! | `names` | names in a saved map |
//!
//! It prints, for each, how many inputs it has tried, how many could be used, and the longest time of one. Inputs that panic,
//! or take more than five seconds, are failures: they are kept in `target/mutated`, and the exit code is 1. Limit memory with
//! `ulimit -v`.

#[path = "../../../fuzz/src/changes.rs"]
mod changes;
#[allow(dead_code)] // The tests use more of it.
#[path = "../tests/it/tiny_clip.rs"]
mod tiny_clip;

use changes::{Random, change_places};
use splatseg::geometry::Image;
use splatseg::models::clip::{ClipNetwork, ClipTokenizer};
use splatseg::names::Vocabulary;
use splatseg::objects::{LabelScore, ObjectName, ObjectNames};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

const TOO_LONG: Duration = Duration::from_secs(5);
/// Networks with larger images are not run, because that takes long; it is not an error.
const MAX_SIDE: usize = 256;

/// Reads an input, and returns true if that can be used.
type Read = Box<dyn Fn(&[u8]) -> bool>;

/// A reader, and its valid input.
struct Reader {
    name: &'static str,
    valid: Vec<u8>,
    read: Read,
}

/// Uses a network, if it is one: its numbers may be anything.
fn use_network(path: &Path) -> bool {
    let Ok(network) = ClipNetwork::open(path) else { return false };
    let side = network.config().image_size;
    if side <= MAX_SIDE {
        let _ = network.embed_images(&[Image::from_fn(side, side, |column, row| [column as u8, row as u8, 90])]);
    }
    let _ = network.embed_texts(&["a photo of a mug"]);
    true
}

fn readers(folder: &Path) -> Vec<Reader> {
    let tiny = folder.join("tiny.safetensors");
    tiny_clip::write_network(&tiny);
    let whole = fs::read(&tiny).unwrap();
    let header = 8 + u64::from_le_bytes(*whole.first_chunk().unwrap()) as usize;
    let numbers = whole[header..].to_vec();
    // What the program stores in its own checkpoints would take the place of the file beside this one.
    let mut tensors: serde_json::Value = serde_json::from_slice(&whole[8..header]).unwrap();
    tensors.as_object_mut().unwrap().remove("__metadata__");
    let tensors = tensors.to_string();
    let header = [&(tensors.len() as u64).to_le_bytes()[..], tensors.as_bytes()].concat();
    let [changed, beside, labels] = ["changed", "beside", "labels"].map(|name| folder.join(name));
    for folder in [&changed, &beside] {
        fs::create_dir(folder).unwrap();
    }
    fs::write(beside.join("model.safetensors"), [header.as_slice(), &numbers].concat()).unwrap();
    let config = r#"{"embed_dim": 32, "quick_gelu": false, "vision_cfg": {"image_size": 32, "layers": 2, "width": 48,
        "head_width": 16, "patch_size": 8}, "text_cfg": {"context_length": 12, "vocab_size": 49408, "width": 32, "heads": 2,
        "layers": 1}, "preprocess_cfg": {"mean": [0.5, 0.5, 0.5], "std": [0.5, 0.5, 0.5]}}"#;
    fs::write(changed.join("config.json"), config).unwrap();
    let merges = "a b</w>\nl o\nlo w</w>\ne r</w>\nab</w> er</w>\n\u{120} x\n";
    let mut names = ObjectNames::default();
    for id in 1..4 {
        let alternatives = vec![LabelScore { label: "cup".to_owned(), score: 0.2 }];
        let name = ObjectName { embedding: vec![0.5; 4], score: Some(0.4), alternatives, ..ObjectName::by_hand("mug") };
        names.set(id, name, 9.0).unwrap();
    }
    let reader = |name, valid: &[u8], read: Read| Reader { name, valid: valid.to_vec(), read };
    let checkpoint = move |bytes: &[u8]| {
        let path = changed.join("model.safetensors");
        fs::write(&path, [bytes, &numbers].concat()).unwrap();
        use_network(&path)
    };
    let configured = move |bytes: &[u8]| {
        fs::write(beside.join("config.json"), bytes).unwrap();
        use_network(&beside.join("model.safetensors"))
    };
    let text = |bytes: &[u8]| {
        let tokens = ClipTokenizer::built_in().tokens(&String::from_utf8_lossy(bytes), 77);
        assert!((2..=77).contains(&tokens.len()) && tokens.iter().all(|token| *token < 49408));
        true
    };
    let merged = |bytes: &[u8]| {
        let tokenizer = ClipTokenizer::from_merges(&String::from_utf8_lossy(bytes));
        tokenizer.is_ok_and(|tokenizer| !tokenizer.tokens("lower aber ab", 16).is_empty())
    };
    let vocabulary = move |bytes: &[u8]| {
        fs::write(&labels, bytes).unwrap();
        Vocabulary::read(&labels).is_ok()
    };
    let saved = |bytes: &[u8]| ObjectNames::from_bytes(bytes).is_ok_and(|names| !names.to_bytes().is_empty());
    vec![
        reader("checkpoint", &header, Box::new(checkpoint)),
        reader("config", config.as_bytes(), Box::new(configured)),
        reader(
            "text",
            "the cat's 3 mugs \u{e9} \u{4f60}\u{597d}, isn't it? <end_of_text> &amp; \u{1f600}".as_bytes(),
            Box::new(text),
        ),
        reader("merges", merges.as_bytes(), Box::new(merged)),
        reader("vocabulary", b"# things\nmug, cup\n\"tea pot\";pot\nchair\tseat\n", Box::new(vocabulary)),
        reader("names", &names.to_bytes(), Box::new(saved)),
    ]
}

/// Tries changed inputs for a time, and prints what it has found. Returns true if nothing failed.
fn mutate(Reader { name, valid, read }: &Reader, time: Duration) -> bool {
    assert!(read(valid), "{name}: cannot be used before any change");
    let (started, mut random) = (Instant::now(), Random(7));
    let (mut inputs, mut usable, mut failures, mut longest) = (0u64, 0u64, 0u64, Duration::ZERO);
    while started.elapsed() < time {
        let mut bytes = valid.clone();
        change_places(&mut bytes, &mut random);
        let before = Instant::now();
        let is_usable = catch_unwind(AssertUnwindSafe(|| read(&bytes))).ok();
        let took = before.elapsed();
        inputs += 1;
        usable += u64::from(is_usable == Some(true));
        longest = longest.max(took);
        if is_usable.is_none() || took > TOO_LONG {
            failures += 1;
            let kept = format!("target/mutated/{name}-{inputs}");
            fs::create_dir_all("target/mutated").and_then(|()| fs::write(&kept, &bytes)).unwrap();
            println!("{name}: FAILED: {kept} ({took:.1?})");
        }
    }
    let longest = format!("{:.0} ms", longest.as_secs_f64() * 1e3);
    println!("{name:<12} {inputs:>10} {usable:>10} {longest:>10}  {failures}");
    failures == 0
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let seconds = arguments.next().and_then(|seconds| seconds.parse().ok()).unwrap_or(10);
    let wanted: Vec<String> = arguments.collect();
    let folder = tempfile::tempdir().expect("a temporary folder");
    println!("{:<12} {:>10} {:>10} {:>10}  failures", "reader", "inputs", "usable", "longest");
    let mut is_good = true;
    for reader in readers(folder.path()) {
        if wanted.is_empty() || wanted.iter().any(|wanted| wanted == reader.name) {
            is_good &= mutate(&reader, Duration::from_secs(seconds));
        }
    }
    if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
