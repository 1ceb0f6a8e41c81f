//! Checkpoints written by Ultralytics and Meta (reference data in `../shared`).

use safetensors::{Dtype as FileDtype, SafeTensors};
use serde_json::Value;
use splatseg_models::checkpoint::{Architecture, Checkpoint, Dtype, Format};
use splatseg_test_scenes::shared_folder;
use std::path::Path;

fn open(path: &Path) -> Checkpoint {
    Checkpoint::open(path).unwrap_or_else(|error| panic!("{error}"))
}

fn names(checkpoint: &Checkpoint) -> Vec<&str> {
    checkpoint.tensors().map(|tensor| tensor.name()).collect()
}

/// Names and shapes of a manifest, in the order of the state dict.
fn manifest(path: &Path) -> Vec<(String, Vec<usize>)> {
    let manifest: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    serde_json::from_value(manifest["tensors"].clone()).unwrap()
}

/// Reads the values of a float16 tensor without the code under test.
fn halves(tensors: &SafeTensors<'_>, name: &str) -> Vec<f32> {
    let tensor = tensors.tensor(name).unwrap();
    assert_eq!(tensor.dtype(), FileDtype::F16);
    tensor.data().as_chunks().0.iter().map(|bytes| half::f16::from_le_bytes(*bytes).to_f32()).collect()
}

#[test]
fn every_layout_of_ultralytics_gives_the_same_tensors() {
    let Some(folder) = shared_folder("every_layout_of_ultralytics").map(|shared| shared.join("golden/fastsam")) else {
        return;
    };
    let bytes = std::fs::read(folder.join("fastsam_mini_statedict.safetensors")).unwrap();
    let truth = SafeTensors::deserialize(&bytes).unwrap();
    for file in
        ["fastsam_mini.pt", "fastsam_mini_ema.pt", "fastsam_mini_v80120.pt", "fastsam_mini_statedict.safetensors"]
    {
        let checkpoint = open(&folder.join(file));
        assert_eq!(checkpoint.tensors().count(), 417, "{file}");
        assert_eq!(truth.len(), 417);
        for tensor in checkpoint.tensors() {
            let name = tensor.name();
            let expected = truth.tensor(name).unwrap();
            assert_eq!(tensor.shape(), expected.shape(), "{file}: {name}");
            if name.ends_with("num_batches_tracked") {
                assert_eq!(tensor.dtype(), Dtype::I64, "{file}: {name}");
                continue;
            }
            assert_eq!(tensor.dtype(), Dtype::F16, "{file}: {name}");
            assert_eq!(checkpoint.read_f32(name, tensor.shape()).unwrap(), halves(&truth, name), "{file}: {name}");
        }
        assert_eq!(checkpoint.architecture(), Architecture::YoloV8Seg { scale: None, width: 8, depth: 1, classes: 1 });
    }
}

#[test]
fn a_module_keeps_its_order_configuration_and_epsilon() {
    let Some(folder) = shared_folder("a_module_keeps_its_order").map(|shared| shared.join("golden/fastsam")) else {
        return;
    };
    // The small network has the same modules as s, in the same order.
    let order: Vec<String> = manifest(&folder.join("manifest_s.json")).into_iter().map(|(name, _)| name).collect();
    for file in ["fastsam_mini.pt", "fastsam_mini_ema.pt", "fastsam_mini_v80120.pt"] {
        let checkpoint = open(&folder.join(file));
        assert_eq!(names(&checkpoint), order, "{file}");
        assert_eq!(checkpoint.format(), Format::Torch);
        assert_eq!(checkpoint.batch_norm_eps(), Some(1e-3), "{file}");
        assert_eq!(checkpoint.class(), Some("SegmentationModel"), "{file}");
        let yaml = checkpoint.configuration().unwrap();
        assert_eq!(yaml["nc"], 1, "{file}");
        assert_eq!(yaml["backbone"].as_array().unwrap().len(), 10, "{file}");
        assert_eq!(yaml["head"][12], serde_json::json!([[15, 18, 21], 1, "Segment", ["nc", 32, 256]]), "{file}");
    }
    let plain = open(&folder.join("fastsam_mini_statedict.safetensors"));
    assert_eq!((plain.format(), plain.configuration(), plain.batch_norm_eps()), (Format::Safetensors, None, None));
}

#[test]
fn a_trained_checkpoint_is_recognised() {
    let Some(path) = shared_folder("a_trained_checkpoint").map(|shared| shared.join("models/fastsam-rooms-n.pt"))
    else {
        return;
    };
    let checkpoint = open(&path);
    assert_eq!(
        checkpoint.architecture(),
        Architecture::YoloV8Seg { scale: Some('n'), width: 16, depth: 1, classes: 1 }
    );
    // The README states 3.26 M parameters, including the constant of the DFL.
    let parameters: usize = checkpoint
        .tensors()
        .filter(|tensor| !tensor.name().contains("running_") && !tensor.name().ends_with("num_batches_tracked"))
        .map(|tensor| tensor.elements())
        .sum();
    assert!((3_250_000..3_270_000).contains(&parameters), "{parameters}");
    assert!(checkpoint.read_f32("model.0.conv.weight", &[16, 3, 3, 3]).unwrap().iter().all(|value| value.is_finite()));
}

#[test]
fn metas_state_dicts_are_read() {
    let Some(folder) = shared_folder("metas_state_dicts").map(|shared| shared.join("golden/sam2")) else { return };
    let checkpoint = open(&folder.join("sam2_mini.pt"));
    assert_eq!(checkpoint.tensors().count(), 435);
    assert!(checkpoint.tensors().all(|tensor| tensor.dtype() == Dtype::F32));
    assert_eq!(checkpoint.architecture(), Architecture::Sam2 { size: None, is_2_1: true, width: 16, blocks: 9 });
    assert_eq!((checkpoint.class(), checkpoint.configuration()), (None, None));
    for tensor in checkpoint.tensors() {
        let numbers = checkpoint.read_f32(tensor.name(), tensor.shape()).unwrap();
        assert_eq!(numbers.len(), tensor.elements());
        assert!(numbers.iter().all(|value| value.is_finite()), "{}", tensor.name());
    }
}
