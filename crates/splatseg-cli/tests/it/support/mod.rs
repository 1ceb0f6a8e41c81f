//! Helpers shared by the tests of the command.

pub mod depth_network;
pub mod nearly_full;

use assert_cmd::Command;
use serde_json::{Value, json};
use splatseg_test_scenes::copy_demo_clip;
pub use splatseg_test_scenes::file_names;
use std::fs;
use std::path::{Path, PathBuf};

/// A small video that is longer than a window of VSQ.
pub const ROOM: &str = "synthetic:frames=18,width=64,height=48,objects=6";
/// Another small video.
pub const OTHER_ROOM: &str = "synthetic:frames=17,width=64,height=48,objects=5,seed=2";

/// Options for the paper's memory with a small codebook, which is fast to compute.
pub const FEATURES: [&str; 6] =
    ["--set", "memory.kind=features", "--set", "memory.num_codes=32", "--set", "memory.feature_dim=8"];

/// Weights of FastSAM n, trained by `training/` on rendered rooms.
pub const FASTSAM_WEIGHTS: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../models/tests/data/fastsam/fastsam_rooms_n.safetensors");

/// Tensors by which EdgeTAM is recognised; the network needs many more.
pub const RECOGNISED_AS_EDGETAM: [(&str, &[usize]); 3] = [
    ("maskmem_tpos_enc", &[7, 1, 1, 64]),
    ("spatial_perceiver.latents", &[256, 64]),
    ("image_encoder.trunk.body.stages_0.blocks.0.token_mixer.conv.c.weight", &[48, 1, 3, 3]),
];

/// Writes a state dict of tensors that are zero.
pub fn write_zeros(path: &Path, tensors: &[(&str, &[usize])]) {
    let mut header = serde_json::Map::new();
    let mut bytes = 0;
    for (name, shape) in tensors {
        let end = bytes + 4 * shape.iter().product::<usize>();
        header.insert((*name).to_owned(), json!({"dtype": "F32", "shape": shape, "data_offsets": [bytes, end]}));
        bytes = end;
    }
    let header = Value::Object(header).to_string();
    let file = [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &vec![0; bytes]].concat();
    fs::write(path, file).unwrap();
}

/// Returns the `splatseg` command.
pub fn splatseg() -> Command {
    Command::new(assert_cmd::cargo::cargo_bin!("splatseg"))
}

/// Returns the `splatseg` command as a process that signals can stop. A test that runs in the background of a shell
/// without job control has inherited that SIGINT is ignored, and would pass it on.
pub fn stoppable_splatseg() -> std::process::Command {
    let program = assert_cmd::cargo::cargo_bin!("splatseg");
    if !cfg!(target_os = "linux") {
        return std::process::Command::new(program);
    }
    let mut command = std::process::Command::new("env");
    command.arg("--default-signal=HUP,INT,TERM").arg(program);
    command
}

/// Names of what a complete run writes, and `more`, sorted.
pub fn result_files(more: &[&str]) -> Vec<String> {
    let always = ["index.html", "manifest.jsonl", "objects", "objects.csv", "objects.json", "overlay", "poses.txt"];
    let names =
        always.into_iter().chain(["pictures", "segments", "summary.json", "viewer"]).chain(more.iter().copied());
    let mut names: Vec<String> = names.map(str::to_owned).collect();
    names.sort();
    names
}

/// The outcome of a command.
pub struct Ended {
    /// Exit code.
    pub code: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

/// Runs a command to its end.
pub fn finish(command: &mut Command) -> Ended {
    let output = command.output().unwrap();
    Ended {
        code: output.status.code().unwrap(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: String::from_utf8(output.stderr).unwrap(),
    }
}

/// Runs a small benchmark with a segmenter that makes errors.
pub fn bench(scenes: &[&str], out: &Path, more: &[&str]) -> Ended {
    let mut command = splatseg();
    command.arg("bench").arg("--scenes").args(scenes).arg("--out").arg(out);
    command.args(["--methods", "fastsam,fastsam-splat", "--segmenter", "oracle"]);
    command.args(["--set", "oracle.preset=fastsam-like", "--set", "oracle.min_area_px=10"]);
    command.args(["--threads", "2"]);
    finish(command.args(more))
}

/// Reads a JSON file.
pub fn read_json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// Subfolders of the demo's clip that make a scene with poses and without ground truth.
pub const CLIP_PARTS: [&str; 4] = ["color", "depth", "pose", "intrinsic"];

/// Copies a small rendered scene in ScanNet's exported layout, whose frame names are numbers.
pub fn numbered_scene(folder: &Path, frames: usize) -> PathBuf {
    let scene = folder.join("scene");
    copy_demo_clip(&CLIP_PARTS, frames, &scene);
    scene
}

/// Saves the map of a small room whose floor is seen, in a folder.
pub fn map_with_floor(folder: &Path) -> PathBuf {
    let map = folder.join("map.ply");
    let mut command = splatseg();
    command.args(["run", "synthetic:frames=30,width=96,height=72,objects=6", "--no-page", "--online"]);
    command.arg("--out").arg(folder.join("out")).arg("--save-memory").arg(&map);
    assert_eq!(finish(&mut command).code, 0);
    map
}
