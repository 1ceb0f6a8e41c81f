//! Devices: their list and errors, and runs on a GPU.

use crate::support::{FASTSAM_WEIGHTS, finish, splatseg};
use splatseg_dataset::read_segments_png;
use splatseg_geometry::SegmentMap;
use splatseg_models::device::{DeviceError, DeviceName};
use splatseg_test_scenes::skipped;

#[test]
fn every_device_is_listed_with_what_it_is_or_lacks() {
    let ended = finish(splatseg().arg("devices"));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let names: Vec<&str> = ended.out.lines().filter_map(|line| line.split_whitespace().next()).collect();
    assert_eq!(names, ["cpu", "gpu", "cuda", "vulkan", "metal"], "{}", ended.out);
    if !DeviceName::Cuda.is_built() {
        assert!(ended.out.contains("cuda    not built in: build splatseg with --features cuda"), "{}", ended.out);
    }
}

#[test]
fn an_unknown_device_is_refused_with_the_names_of_all() {
    let ended = finish(splatseg().args(["run", "synthetic:frames=1", "--out", "nowhere", "--device", "tpu"]));
    assert_eq!(ended.code, 2);
    assert!(ended.err.contains("[possible values: cpu, gpu, cuda, vulkan, metal]"), "{}", ended.err);
}

#[test]
fn the_learned_segmenter_on_the_gpu_gives_the_ids_of_the_cpu() {
    if !has_gpu("the_learned_segmenter_on_the_gpu_gives_the_ids_of_the_cpu") {
        return;
    }
    let scene = "synthetic:frames=2,width=160,height=120,objects=8";
    let run = |device: &str| ids_of(scene, 2, &["--device", device]);
    assert_agree(&run("gpu"), &run("cpu"));
}

#[test]
fn a_network_on_the_gpu_gives_the_ids_of_the_cpu() {
    let test = "a_network_on_the_gpu_gives_the_ids_of_the_cpu";
    if !has_gpu(test) {
        return;
    }
    let network = ["--segmenter", "fastsam", "--weights", FASTSAM_WEIGHTS, "--set", "fastsam.image_size=160"];
    let scene = "synthetic:frames=2,width=160,height=120,objects=8";
    let run = |device: &str| ids_of(scene, 2, &[&network[..], &["--device", device]].concat());
    assert_agree(&run("gpu"), &run("cpu"));
}

/// Returns true if there is a GPU or a software driver; otherwise reports that the test is skipped.
fn has_gpu(test: &str) -> bool {
    let opened = DeviceName::Gpu.open();
    if let Err(error @ (DeviceError::NoAdapter(_) | DeviceError::NotBuilt(_))) = &opened {
        skipped(test, &error.to_string());
    }
    opened.is_ok()
}

/// Returns the id images of a run.
fn ids_of(scene: &str, frames: usize, more: &[&str]) -> Vec<SegmentMap> {
    let folder = tempfile::tempdir().unwrap();
    let ended = finish(splatseg().args(["run", scene, "--out"]).arg(folder.path()).args(more));
    assert_eq!(ended.code, 0, "{}", ended.err);
    let mut files: Vec<_> = std::fs::read_dir(folder.path().join("segments")).unwrap().collect();
    assert_eq!(files.len(), frames);
    files.sort_by_key(|file| file.as_ref().unwrap().path());
    files.into_iter().map(|file| read_segments_png(&file.unwrap().path()).unwrap()).collect()
}

/// GPUs may round differently from the CPU: one of a thousand pixels may differ.
fn assert_agree(found: &[SegmentMap], expected: &[SegmentMap]) {
    for (frame, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!(expected.pixels().iter().any(|id| *id > 0), "frame {frame} shows nothing");
        let differ = found.pixels().iter().zip(expected.pixels()).filter(|(a, b)| a != b).count();
        assert!(1000 * differ <= expected.pixels().len(), "frame {frame}: {differ} pixels differ");
    }
}
