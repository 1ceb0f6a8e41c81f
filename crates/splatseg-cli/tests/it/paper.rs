//! `splatseg bench --preset paper`: the paper's tables from folders of scenes and checkpoints.

use crate::standins::write_standins;
use crate::support::{Ended, RECOGNISED_AS_EDGETAM, finish, read_json, splatseg, write_zeros};
use serde_json::{Value, json};
use splatseg_dataset::{DatasetSettings, open_scene};
use splatseg_test_scenes::shared_folder;
use std::fs;
use std::path::{Path, PathBuf};

fn bench_paper(out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["bench", "--preset", "paper", "--out"]).arg(out).args(more))
}

/// Returns `../shared`. If it is missing, prints a message and returns `None`.
fn shared(test: &str) -> Option<PathBuf> {
    shared_folder(test).map(|folder| folder.canonicalize().unwrap())
}

/// Writes stand-ins for the data sets with a few frames of the rendered rooms, see `cargo xtask make-standins`.
fn standins(shared: &Path, folder: &Path, frames: usize) -> PathBuf {
    let open = |name: &str| open_scene(shared.join("data/rooms").join(name), &DatasetSettings::default()).unwrap();
    let scenes = ["dev-a", "dev-b"].map(open);
    let out = folder.join("standins");
    write_standins(&scenes.each_ref().map(|scene| scene.as_ref()), frames, &out).unwrap();
    out
}

/// Options for small networks, so that a frame takes less than a minute.
const SMALL: [&str; 8] = [
    "--set",
    "fastsam.image_size=320",
    "--set",
    "fastsam.max_det=8",
    "--set",
    "memory.num_codes=64",
    "--set",
    "memory.num_steps=1",
];

/// Copies small checkpoints of FastSAM, and of SAM 2.1 if `with_sam2`, to a folder under other names.
fn weights(shared: &Path, folder: &Path, with_sam2: bool) {
    fs::create_dir_all(folder).unwrap();
    fs::copy(shared.join("golden/fastsam/fastsam_mini.pt"), folder.join("any name.pt")).unwrap();
    if with_sam2 {
        fs::copy(shared.join("golden/sam2/sam2_mini.pt"), folder.join("sam2.pt")).unwrap();
    }
}

fn rows(out: &Path) -> Vec<Value> {
    read_json(&out.join("results.json")).as_array().unwrap().clone()
}

#[test]
fn every_row_that_the_inputs_allow_is_measured() {
    let Some(shared) = shared("every_row_that_the_inputs_allow_is_measured") else { return };
    let folder = tempfile::tempdir().unwrap();
    let standins = standins(&shared, folder.path(), 2);
    // dev-a is the only available scene of the validation split.
    fs::write(standins.join("ScanNet/scannetv2_val.txt"), "dev-a\nscene9999_00\n").unwrap();
    // One of MVPd's two videos is accepted.
    let video = "00800-dev-a.0000000000.0000000100";
    let accepted = json!({"accepted": [video], "rejected": ["00800-dev-b.0000000000.0000000100"]});
    fs::write(standins.join("MVPd/test/empty_videos.json"), accepted.to_string()).unwrap();
    let (networks, out) = (folder.path().join("weights"), folder.path().join("out"));
    weights(&shared, &networks, false);
    let [scannet, mvpd, instances] = ["ScanNet", "MVPd", "instances"].map(|name| standins.join(name));
    let folders =
        [("--scannet", &scannet), ("--mvpd", &mvpd), ("--weights-dir", &networks), ("--instances", &instances)];
    let folders = folders.map(|(option, folder)| [option, folder.to_str().unwrap()]);
    let arguments = [folders.as_flattened(), &SMALL, &["--stride", "1"]].concat();

    // Without SAM 2.1, its rows are listed with their missing inputs.
    let ended = bench_paper(&out, &arguments);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let text = fs::read_to_string(out.join("paper.md")).unwrap();
    for line in [
        "| SAM2, detections (needs weights of SAM 2.1) | – | – | – | – | – | – | – | – |",
        "| *FastSAM-Splat, the paper* | *48.07* | *44.15* | *41.98* | *40.75* | *43.74* | *38.39* | *32.83* | *44.89* |",
        "| *OV2Seg, Swin-base, the paper* | *40.22* | *38.58* | *37.43* | *36.52* | *38.19* |",
        "| *1, ground truth, the paper* |  |  |  |  | *54.89* | *37.29* |  |  |",
        "- sam2.1_hiera_base_plus.pt: SAM2 and SAM2-Splat: https://github.com/facebookresearch/sam2",
        "- 1 scenes of scannetv2_val.txt, starting with scene9999_00: http://www.scan-net.org, after signing its terms of use",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}\n{text}");
    }
    assert!(text.contains("test: 1 videos, 1 rejected by empty_videos.json"), "{text}");
    assert!(!text.contains("- FastSAM-x.pt:"), "{text}");
    assert!(fs::read_to_string(out.join("paper.html")).unwrap().contains("FastSAM-Splat, the paper</th>"));
    assert!(fs::read_to_string(out.join("paper.csv")).unwrap().contains("Methods on MVPd,FastSAM,paper,vsq,49.17,"));
    // FastSAM, FastSPAM, FastSAM-Splat and four other dimensions; on MVPd only the methods.
    let (scannet, mvpd) = (out.join("scannet-mv"), out.join("mvpd"));
    assert_eq!((rows(&scannet).len(), rows(&mvpd).len()), (8, 3));
    check_mvpd(&mvpd, video);
    let tables = fs::read_to_string(scannet.join("tables.md")).unwrap();
    assert!(tables.contains("| SQ | AP | AP50 | AP25 | frames/s |"), "{tables}");

    weights(&shared, &networks, true);
    let arguments = [&arguments[..], &["--set", "sam2.image_size=128"]].concat();
    let ended = bench_paper(&out, &arguments);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let text = fs::read_to_string(out.join("paper.md")).unwrap();
    assert!(!text.contains("needs weights"), "{text}");
    // ScanNet-MV: seven methods, five dimensions, four choices of categories (except none, which is SAM2), three numbers of
    // clicks from two sources. MVPd: five methods.
    assert_eq!((rows(&scannet).len(), rows(&mvpd).len()), (7 + 5 + 4 + 6, 5), "{text}");
    assert_eq!(ended.out.matches(": reused").count(), 7 + 3, "{}", ended.out);
    // The efficiency row has the parameters of the backbone and of the memory.
    let splat = text.lines().rfind(|line| line.starts_with("| SAM2-Splat, detections |")).unwrap();
    assert!(!splat.contains('–'), "{splat}");
}

/// Asserts that MVPd is read and scored as in its benchmark.
fn check_mvpd(out: &Path, video: &str) {
    for row in rows(out) {
        assert_eq!(row["scene"], video);
        let dataset = &row["settings"]["dataset"];
        assert_eq!((&dataset["resize"], &dataset["crop_border"]), (&json!("320x240"), &json!(0)), "{dataset}");
        let result = read_json(&out.join(row["file"].as_str().unwrap()));
        assert_eq!(result["inputs"]["score"]["min_ground_truth_area"], json!(0.001));
    }
}

#[test]
fn a_dry_run_lists_every_row_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let empty = ["scannet", "mvpd", "weights"].map(|name| folder.path().join(name));
    empty.iter().for_each(|empty| fs::create_dir(empty).unwrap());
    let out = folder.path().join("out");
    let options = ["--scannet", "--mvpd", "--weights-dir"].iter().zip(&empty);
    let mut arguments: Vec<&str> = options.flat_map(|(option, folder)| [option, folder.to_str().unwrap()]).collect();
    arguments.push("--dry-run");
    let ended = bench_paper(&out, &arguments);
    assert_eq!((ended.code, out.exists()), (0, false), "{}", ended.err);
    for line in [
        "- FastSAM-x.pt: every row except those prompted with ground truth: https://github.com/CASIA-IVA-Lab/FastSAM",
        "- MVPd, its split `test`",
        "Clicks per re-prompted object (SAM2-Splat, ScanNet-MV)",
        "  5, ground truth             needs ScanNet, weights of SAM 2.1; missing: ScanNet, weights of SAM 2.1; ",
        "  SAM2-Splat, detections      needs MVPd, weights of FastSAM, weights of SAM 2.1; missing: MVPd, ",
        "  Tube-Link, Swin-large       the paper's row; score predictions with `splatseg eval`",
        "28 of the rows cannot be measured yet",
    ] {
        assert!(ended.out.lines().any(|found| found.starts_with(line)), "{line}\n{}", ended.out);
    }

    let Some(shared) = shared("a_dry_run_lists_every_row_and_writes_nothing") else { return };
    let standins = standins(&shared, folder.path(), 3);
    let archives = standins.join("MVPd-archives");
    weights(&shared, &empty[2], true);
    let scannet = standins.join("ScanNet");
    let folders = [("--scannet", &scannet), ("--mvpd", &archives), ("--weights-dir", &empty[2])];
    let folders = folders.map(|(option, folder)| [option, folder.to_str().unwrap()]);
    let ended = bench_paper(&out, &[folders.as_flattened(), &["--stride", "2", "--dry-run"]].concat());
    assert_eq!((ended.code, out.exists()), (0, false), "{}", ended.err);
    // Two of the three frames of two scenes.
    for line in [
        "Methods on MVPd: 2 videos, 4 frames",
        "  FastSAM                     needs MVPd, weights of FastSAM; nothing missing; 14 s (rough)",
        "  D = 28                      needs ScanNet, weights of FastSAM; nothing missing; the same runs as a row above",
    ] {
        assert!(ended.out.lines().any(|found| found == line), "{line}\n{}", ended.out);
    }
    assert!(!ended.out.contains("cannot be measured yet"), "{}", ended.out);
}

#[test]
fn a_tracker_that_the_paper_does_not_use_adds_rows() {
    let folder = tempfile::tempdir().unwrap();
    let (weights, out) = (folder.path().join("weights"), folder.path().join("out"));
    fs::create_dir(&weights).unwrap();
    write_zeros(&weights.join("my edgetam.safetensors"), &RECOGNISED_AS_EDGETAM);
    let arguments = ["--weights-dir", weights.to_str().unwrap(), "--dry-run"];
    let ended = bench_paper(&out, &arguments);
    assert_eq!(ended.code, 0, "{}", ended.err);
    for line in [
        "not in the paper: EdgeTAM, ",
        // The paper's rows keep their network.
        "  SAM2, detections            needs ScanNet, weights of FastSAM, weights of SAM 2.1; missing: ",
        "  SAM2-Splat, detections, my edgetam needs ScanNet, weights of FastSAM; missing: ScanNet, weights of FastSAM; ",
        "  SAM2-Splat, ground truth, my edgetam needs ScanNet; missing: ScanNet; ",
        "  SAM2, detections, my edgetam needs MVPd, weights of FastSAM; missing: MVPd, weights of FastSAM; ",
        "34 of the rows cannot be measured yet",
    ] {
        assert!(ended.out.lines().any(|found| found.starts_with(line)), "{line}\n{}", ended.out);
    }
    let ended = bench_paper(&out, &[&arguments[..], &["--tracker", "sim"]].concat());
    assert_eq!(ended.code, 0, "{}", ended.err);
    assert!(!ended.out.contains("edgetam"), "{}", ended.out);
}

#[test]
fn without_inputs_their_sources_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let ended = bench_paper(&folder.path().join("out"), &[]);
    assert_eq!(ended.code, 2);
    let expected = "error: no paper benchmark can run: give --scannet or --mvpd, and --weights-dir";
    assert_eq!(ended.err.trim(), expected);
    for source in ["scan-net.org", "FastSAM-x.pt", "github.com/facebookresearch/sam2", "github.com/opipari/MVPd"] {
        assert!(ended.out.contains(source), "{}", ended.out);
    }
    for option in ["--scannet", "--mvpd", "--weights-dir"] {
        let ended = bench_paper(&folder.path().join("out"), &[option, "/nowhere"]);
        assert_eq!(ended.code, 2);
        assert!(ended.err.contains("/nowhere"), "{option}: {}", ended.err);
    }
    // The paper's tables replace only files of an earlier benchmark.
    fs::create_dir(folder.path().join("mine")).unwrap();
    fs::write(folder.path().join("mine/paper.md"), "mine").unwrap();
    let room = ["--scenes", "synthetic:frames=1,width=64,height=48", "--segmenter", "oracle", "--max-frames", "1"];
    for more in [&[][..], &["--overwrite"]] {
        let ended = bench_paper(&folder.path().join("mine"), &[&room[..], more].concat());
        assert_eq!((ended.code, ended.err.lines().count()), (2, 1), "{}", ended.err);
    }
    assert_eq!(fs::read_to_string(folder.path().join("mine/paper.md")).unwrap(), "mine");
}
