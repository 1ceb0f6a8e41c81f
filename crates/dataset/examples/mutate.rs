//! Reads damaged files of every format in one process, without the nightly compiler and the C++ that `fuzz/` needs.
//!
//! ```sh
//! cargo run --release -p splatseg-dataset --example mutate -- 300 db3 bag     # seconds for each, readers (all)
//! ```
//!
//! Starts from the small valid files of `fuzz/src/scenes.rs`, changes one of them in up to eight places, and reads the scene.
//! The same numbers of tries make the same changes. It prints, for each reader, how many inputs it has tried, how many of them
//! still were scenes, and the longest time of one. Inputs that panic, or take more than five seconds, are failures: they are
//! kept in `target/mutated`, and the exit code is 1. Limit memory with `ulimit -v`.

#[path = "../../../fuzz/src/changes.rs"]
mod changes;
#[allow(dead_code)] // The fuzz targets use more of it.
#[path = "../../../fuzz/src/place.rs"]
mod place;
#[allow(dead_code)]
#[path = "../../../fuzz/src/scenes.rs"]
mod scenes;
#[path = "../tests/it/support/mod.rs"]
mod support;

use changes::{Random, change_places};
use place::Place;
use splatseg_dataset::{DatasetSettings, open_scene};
use std::fs;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// A reader, the template of its files, and the scenes in that: files are of the first one whose path they begin with.
type Reader = (&'static str, fn(&Path), &'static [&'static str]);

const READERS: [Reader; 18] = [
    ("mcap", scenes::mcap, &[""]),
    ("db3", scenes::db3, &["raw", "png"]),
    ("mkv", scenes::mkv, &["closed", "streamed"]),
    ("bag", scenes::bag, &scenes::BAGS),
    ("r3d", scenes::phones, &["room.r3d", "r3d"]),
    ("polycam", scenes::phones, &["polycam"]),
    ("stray", scenes::phones, &["stray"]),
    ("arkitscenes", scenes::phones, &["arkitscenes"]),
    ("nerfstudio", scenes::phones, &["nerfstudio"]),
    ("tiff", scenes::depth_files, &["doubles_tiles", "integers_opencv", "integers_deflate"]),
    ("exr", scenes::depth_files, &["halves_rle", "floats_zip", "layers_zip"]),
    ("npy_pfm", scenes::depth_files, &["floats", "floats_opencv"]),
    ("folder", scenes::folder, &["tum", "matrices"]),
    ("sens", scenes::sens, &["a/packed.sens", "b/raw.sens", "c/png.sens"]),
    ("tum", scenes::tum, &[""]),
    ("sevenscenes", scenes::sevenscenes, &[""]),
    ("scannet", scenes::scannet, &[""]),
    ("replica", scenes::replica, &[""]),
];
const TOO_LONG: Duration = Duration::from_secs(5);

/// Reads everything of a scene. Whatever is wrong with it must come back as an error. Returns true if it is one.
fn read(path: &Path) -> bool {
    let Ok(scene) = open_scene(path, &DatasetSettings::default()) else { return false };
    for index in 0..scene.frame_count().min(3) {
        let _ = (scene.frame_name(index), scene.read_recorded(index), scene.read_ground_truth(index));
    }
    true
}

/// Counts and times of one reader.
#[derive(Default)]
struct Found {
    inputs: u64,
    scenes: u64,
    longest: Duration,
    failures: u64,
}

fn mutate((name, template, parts): Reader, time: Duration) -> Found {
    let place = Place::new(template);
    let files = 0..place.files().len();
    let files: Vec<(usize, PathBuf)> = files.filter_map(|index| Some((index, place.scene_of(index, parts)?))).collect();
    for (_, scene) in &files {
        assert!(read(scene), "{}: not a scene before any change", scene.display());
    }
    let (started, mut random, mut found) = (Instant::now(), Random(7), Found::default());
    while started.elapsed() < time {
        let (index, scene) = &files[random.below(files.len())];
        let mut bytes = place.files()[*index].1.clone();
        change_places(&mut bytes, &mut random);
        let mut is_scene = None;
        let before = Instant::now();
        place.with_file(*index, &bytes, || is_scene = catch_unwind(AssertUnwindSafe(|| read(scene))).ok());
        let took = before.elapsed();
        found.inputs += 1;
        found.scenes += u64::from(is_scene == Some(true));
        found.longest = found.longest.max(took);
        if is_scene.is_none() || took > TOO_LONG {
            found.failures += 1;
            let file = place.files()[*index].0.strip_prefix(place.folder()).unwrap().display().to_string();
            let kept = PathBuf::from(format!("target/mutated/{name}-{}-{}", found.inputs, file.replace('/', "_")));
            fs::create_dir_all("target/mutated").and_then(|()| fs::write(&kept, &bytes)).unwrap();
            println!("{name}: FAILED: {} ({took:.1?})", kept.display());
        }
    }
    found
}

fn main() -> ExitCode {
    let mut arguments = std::env::args().skip(1);
    let seconds = arguments.next().and_then(|seconds| seconds.parse().ok()).unwrap_or(10);
    let wanted: Vec<String> = arguments.collect();
    let mut is_good = true;
    println!("{:<12} {:>10} {:>10} {:>10}  failures", "reader", "inputs", "scenes", "longest");
    for reader in READERS.iter().filter(|(name, ..)| wanted.is_empty() || wanted.iter().any(|wanted| wanted == name)) {
        let found = mutate(*reader, Duration::from_secs(seconds));
        let longest = format!("{:.0} ms", found.longest.as_secs_f64() * 1e3);
        println!("{:<12} {:>10} {:>10} {longest:>10}  {}", reader.0, found.inputs, found.scenes, found.failures);
        is_good &= found.failures == 0;
    }
    if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
