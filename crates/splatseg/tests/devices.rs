//! Devices: what the command says of them, and a run on one.

mod support;

use splatseg_models::device::{DeviceError, DeviceName};
use std::path::Path;
use support::{finish, splatseg};

/// A small trained FastSAM, whose architecture is all that matters here.
const WEIGHTS: &str = "../models/tests/data/fastsam/fastsam_mini_statedict.safetensors";

#[test]
fn every_device_is_listed_with_what_it_is_or_lacks() {
    let ended = finish(splatseg().arg("devices"));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let names: Vec<&str> = ended.out.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(names, ["cpu", "gpu", "cuda", "vulkan", "metal"], "{}", ended.out);
    if !DeviceName::Cuda.is_built() {
        assert!(ended.out.contains("cuda    not part of this program: build it with --features cuda"), "{}", ended.out);
    }
}

#[test]
fn an_unknown_device_is_refused_with_the_names_of_all() {
    let ended = finish(splatseg().args(["run", "synthetic:frames=1", "--out", "nowhere", "--device", "tpu"]));
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("cpu, gpu, cuda, vulkan or metal"), "{}", ended.err);
}

#[test]
fn a_run_on_the_gpu_gives_the_ids_of_the_cpu() {
    if let Err(error @ (DeviceError::NoAdapter(_) | DeviceError::NotBuilt(_))) = DeviceName::Gpu.open() {
        // Not `println!`, whose output the test runner hides when a test passes.
        let line = format!("\nskipped: a_run_on_the_gpu_gives_the_ids_of_the_cpu: {error}\n");
        let _ = std::io::Write::write_all(&mut std::io::stderr(), line.as_bytes());
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let run = |device: &str| -> Vec<Vec<u8>> {
        let out = folder.path().join(device);
        let mut command = splatseg();
        command.args(["run", "synthetic:frames=2,width=96,height=72,objects=8", "--device", device, "--out"]);
        command.arg(&out).args(["--segmenter", "fastsam", "--weights", WEIGHTS]);
        let ended = finish(command.args(["--set", "fastsam.image_size=96", "--set", "fastsam.confidence=0.05"]));
        assert_eq!(ended.code, 0, "{}", ended.err);
        ids(&out)
    };
    assert_eq!(run("gpu"), run("cpu"));
}

/// The id images of a run.
fn ids(out: &Path) -> Vec<Vec<u8>> {
    let mut files: Vec<_> =
        std::fs::read_dir(out.join("segments")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert_eq!(files.len(), 2);
    files.iter().map(|file| std::fs::read(file).unwrap()).collect()
}
