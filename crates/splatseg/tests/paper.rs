//! `splatseg bench --preset paper`: the paper's tables from folders of scenes and checkpoints.

mod support;

use std::fs;
use std::path::{Path, PathBuf};
use support::{Ended, finish, read_json, splatseg};

fn bench_paper(out: &Path, more: &[&str]) -> Ended {
    finish(splatseg().args(["bench", "--preset", "paper", "--out"]).arg(out).args(more))
}

/// `../shared`, or `None`, with a line that says so, where it is missing.
fn shared(test: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared");
    if !folder.exists() {
        // Not `println!`, whose output the test runner hides when a test passes.
        let line = format!("\nskipped: {test}: ../shared is not here\n");
        let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
        return None;
    }
    Some(folder.canonicalize().unwrap())
}

/// A folder like ScanNet's. dev-a is the only one of the two scenes in the validation split that it has.
fn scannet(shared: &Path, folder: &Path) -> PathBuf {
    let scans = folder.join("scans");
    fs::create_dir_all(&scans).unwrap();
    for name in ["dev-a", "dev-b"] {
        std::os::unix::fs::symlink(shared.join("data/rooms").join(name), scans.join(name)).unwrap();
    }
    fs::write(folder.join("scannetv2_val.txt"), "dev-a\nscene9999_00\n").unwrap();
    folder.to_owned()
}

#[test]
fn every_row_that_the_inputs_allow_is_measured() {
    let Some(shared) = shared("every_row_that_the_inputs_allow_is_measured") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (weights, out) = (folder.path().join("weights"), folder.path().join("out"));
    let scannet = scannet(&shared, &folder.path().join("scannet"));
    fs::create_dir(&weights).unwrap();
    fs::copy(shared.join("golden/fastsam/fastsam_mini.pt"), weights.join("any name.pt")).unwrap();
    let folders =
        ["--scannet", scannet.to_str().unwrap(), "--weights-dir", weights.to_str().unwrap(), "--max-frames", "2"];
    let small =
        ["fastsam.image_size=320", "fastsam.max_det=8", "memory.num_codes=64"].map(|setting| ["--set", setting]);
    let arguments = [&folders[..], small.as_flattened()].concat();

    // Without SAM 2.1, its rows are listed with the inputs that they need.
    let ended = bench_paper(&out, &arguments);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let text = fs::read_to_string(out.join("paper.md")).unwrap();
    for line in [
        "| SAM2, detections (needs weights of SAM 2.1) | – | – | – | – | – | – | – | – |",
        "| *FastSAM-Splat, the paper* | *48.07* | *44.15* | *41.98* | *40.75* | *43.74* | *38.39* | *32.83* | *44.89* |",
        "- sam2.1_hiera_base_plus.pt: SAM2 and SAM2-Splat: https://github.com/facebookresearch/sam2",
        "- 1 scenes of scannetv2_val.txt, scene9999_00 the first: http://www.scan-net.org, after signing its terms of use",
    ] {
        assert!(text.lines().any(|found| found == line), "{line}\n{text}");
    }
    assert!(!text.contains("- FastSAM-x.pt:"), "{text}");
    // FastSAM, FastSPAM, FastSAM-Splat and four other dimensions.
    let measured = |out: &Path| read_json(&out.join("results.json")).as_array().unwrap().len();
    assert_eq!(measured(&out), 8);

    fs::copy(shared.join("golden/sam2/sam2_mini.pt"), weights.join("sam2.pt")).unwrap();
    let ended = bench_paper(&out, &arguments);
    assert_eq!(ended.code, 0, "{}", ended.err);
    let text = fs::read_to_string(out.join("paper.md")).unwrap();
    assert!(!text.contains("needs weights"), "{text}");
    // Seven methods, five dimensions, five choices of categories, three numbers of clicks.
    assert_eq!(measured(&out), 20);
    assert_eq!(ended.out.matches(": there already").count(), 7, "{}", ended.out);
}

#[test]
fn without_inputs_their_sources_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let ended = bench_paper(&folder.path().join("out"), &[]);
    assert_eq!(ended.code, 2);
    assert_eq!(ended.err.trim(), "error: nothing of the paper can be run: give --scannet and --weights-dir");
    for source in ["scan-net.org", "FastSAM-x.pt", "github.com/facebookresearch/sam2"] {
        assert!(ended.out.contains(source), "{}", ended.out);
    }
    let ended = bench_paper(&folder.path().join("out"), &["--scannet", "/nowhere"]);
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("/nowhere"), "{}", ended.err);
}
