//! A small network of Depth Anything V2's kind. Its weights are given by a formula: what it predicts is smooth, and wrong.

use safetensors::tensor::{Dtype, TensorView, serialize_to_file};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Writes a checkpoint to a folder and returns its path. Its depth is relative, between about 2 and 3 m once a scale is
/// assumed.
pub fn write_depth_network(folder: &Path) -> PathBuf {
    // The names and shapes of the authors' code, in miniature.
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/tests/data/depth_anything/official.json");
    let reference: Value = serde_json::from_str(&std::fs::read_to_string(file).unwrap()).unwrap();
    let tensors: Vec<(String, Vec<usize>, Vec<u8>)> = reference["tensors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|entry| {
            let name = entry[0].as_str().unwrap().to_owned();
            let shape: Vec<usize> = serde_json::from_value(entry[1].clone()).unwrap();
            let bytes = weights(&name, &shape).iter().flat_map(|weight| weight.to_le_bytes()).collect();
            (name, shape, bytes)
        })
        .collect();
    let views = tensors
        .iter()
        .map(|(name, shape, bytes)| (name.clone(), TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap()));
    let path = folder.join("small_depth.safetensors");
    serialize_to_file(views, None, &path).unwrap();
    path
}

fn weights(name: &str, shape: &[usize]) -> Vec<f32> {
    let fan_in: usize = shape.iter().skip(1).product();
    let (offset, scale) = match name.rsplit('.').next().unwrap() {
        // The last layer: inverse depth that varies little.
        "weight" if shape == [1, 32, 1, 1] => (0.0, 0.02),
        "bias" if shape == [1] => (0.5, 0.0),
        "weight" if shape.len() >= 2 => (0.0, (3.0 / fan_in as f32).sqrt()),
        "weight" => (1.0, 0.1),
        "bias" => (0.0, 0.05),
        _ => (0.0, 0.5),
    };
    let mut state = name.bytes().fold(1u32, |state, byte| state.wrapping_mul(31).wrapping_add(u32::from(byte)));
    let mut next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..shape.iter().product()).map(|_| offset + scale * next()).collect()
}
