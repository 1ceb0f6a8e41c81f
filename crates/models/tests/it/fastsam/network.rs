//! The network's raw output.

use super::golden::{Golden, image, shared};
use crate::sam2_golden::test_device::device;
use burn::tensor::Device;
use splatseg_geometry::Image;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::fastsam::{FastSamConfig, FastSamNetwork, RawOutput, letterbox};
use splatseg_models::transfer::Transfers;

/// Maximum differences from float64, as suggested by the reference data: boxes in pixels, scores, coefficients,
/// prototypes.
const TOLERANCES: [f32; 4] = [5e-2, 2e-4, 1e-3, 2e-3];

/// Maximum difference relative to each group's largest magnitude.
const RELATIVE: f32 = 1e-3;

/// Returns the raw output for the bytes of an input, `[3, height, width]`.
fn run((bytes, [height, width]): (Vec<u8>, [usize; 2]), test: &str) -> Option<RawOutput> {
    let checkpoint = Checkpoint::open(&shared("golden/fastsam/fastsam_mini_statedict.safetensors", test)?).unwrap();
    let architecture = FastSamConfig::from_checkpoint(&checkpoint).unwrap();
    assert_eq!(architecture, FastSamConfig::scaled(0.33, 0.125, 1024));
    let network = FastSamNetwork::load(&checkpoint, architecture, &device()).unwrap();
    let input = bytes.iter().map(|value| f32::from(*value) / 255.0).collect();
    let before = Transfers::so_far();
    let output = network.forward(input, height, width).unwrap();
    let moved = Transfers::so_far().since(before);
    // One upload of the image and one download of the output; no transfers on the CPU.
    let expected = if device() == Device::flex() { [0, 0] } else { [1, 1] };
    assert_eq!([moved.uploads, moved.downloads], expected);
    Some(output)
}

fn whole_input(forward: &Golden) -> (Vec<u8>, [usize; 2]) {
    let shape = forward.shape("input_u8");
    (forward.bytes("input_u8"), [shape[2], shape[3]])
}

/// Returns the bytes of an input, `[3, height, width]`, and its size.
fn planes_of(input: &Image<[u8; 3]>) -> (Vec<u8>, [usize; 2]) {
    let planes = (0..3).flat_map(|channel| input.pixels().iter().map(move |pixel| pixel[channel])).collect();
    (planes, [input.height(), input.width()])
}

/// Compares every `step`th anchor with `expected` `[37, anchors]`.
fn check_anchors(output: &RawOutput, expected: &[f32], step: usize) {
    let candidates = output.candidates(-1.0);
    let count = expected.len() / 37;
    assert_eq!(candidates.len().div_ceil(step), count);
    let mut differences = [0f32; 3];
    let mut magnitudes = [0f32; 3];
    for place in 0..count {
        let index = place * step;
        assert_eq!(candidates.anchor(index), index);
        let found = candidates.box_cxcywh(index).into_iter().chain([candidates.score(index)]);
        for (row, value) in found.chain(candidates.coefficients(index).iter().copied()).enumerate() {
            let group = usize::from(row >= 4) + usize::from(row >= 5);
            let reference = expected[row * count + place];
            differences[group] = differences[group].max((value - reference).abs());
            magnitudes[group] = magnitudes[group].max(reference.abs());
        }
    }
    for group in 0..3 {
        assert!(differences[group] <= TOLERANCES[group], "{differences:?} {magnitudes:?}");
        assert!(differences[group] <= RELATIVE * magnitudes[group], "{differences:?} {magnitudes:?}");
    }
}

fn check_whole(name: &str, test: &str) {
    let Some(forward) = Golden::open(name, test) else { return };
    let Some(output) = run(whole_input(&forward), test) else { return };
    check_anchors(&output, &forward.floats("preds"), 1);
    let (found, expected) = (output.prototypes(), forward.floats("protos"));
    assert_eq!([1, found.count, found.height, found.width].as_slice(), forward.shape("protos"));
    let largest = expected.iter().fold(0f32, |largest, value| largest.max(value.abs()));
    for (value, reference) in found.values.iter().zip(&expected) {
        assert!((value - reference).abs() <= TOLERANCES[3].min(RELATIVE * largest), "{value} {reference}");
    }
}

#[test]
fn raw_output_agrees_310x230_at_640() {
    check_whole("forward_310x230_640.safetensors", "raw_output_agrees_310x230_at_640");
}

#[test]
fn raw_output_agrees_640x480_at_640() {
    check_whole("forward_640x480_640.safetensors", "raw_output_agrees_640x480_at_640");
}

#[test]
fn raw_output_agrees_where_it_is_sampled() {
    let test = "raw_output_agrees_where_it_is_sampled";
    let Some(path) = shared("golden/fastsam/image_310x230.png", test) else { return };
    let forward = Golden::open("forward.safetensors", test).unwrap();
    let output = run(planes_of(&letterbox(&image(&path), 640)), test).unwrap();
    check_sampled(&output, &forward);
}

#[test]
fn raw_output_agrees_310x230_at_1024() {
    let test = "raw_output_agrees_310x230_at_1024";
    let Some(forward) = Golden::open("forward_310x230_1024.safetensors", test) else { return };
    let Some(output) = run(whole_input(&forward), test) else { return };
    check_sampled(&output, &forward);
}

#[test]
fn raw_output_agrees_640x480_at_1024() {
    let test = "raw_output_agrees_640x480_at_1024";
    let Some(forward) = Golden::open("forward_640x480_1024.safetensors", test) else { return };
    let Some(path) = shared("golden/fastsam/image_640x480.png", test) else { return };
    // The file contains only every fourth row of the input (compared in `preprocessing`).
    let input = letterbox(&image(&path), 1024);
    let Some(output) = run(planes_of(&input), test) else { return };
    check_sampled(&output, &forward);
}

/// Compares with a file that contains every fourth anchor, and every fourth row and column of prototypes.
fn check_sampled(output: &RawOutput, forward: &Golden) {
    check_anchors(output, &forward.floats("preds_stride4"), 4);
    let found = output.prototypes();
    let (expected, shape) = (forward.floats("protos_stride4"), forward.shape("protos_stride4"));
    let (means, deviations) = (forward.floats("protos_mean"), forward.floats("protos_std"));
    let area = found.height * found.width;
    for map in 0..found.count {
        let values = &found.values[map * area..][..area];
        for row in 0..shape[2] {
            for column in 0..shape[3] {
                let reference = expected[(map * shape[2] + row) * shape[3] + column];
                let value = values[4 * row * found.width + 4 * column];
                assert!((value - reference).abs() <= TOLERANCES[3], "{value} {reference}");
            }
        }
        let mean = values.iter().map(|value| f64::from(*value)).sum::<f64>() / area as f64;
        let variance = values.iter().map(|value| (f64::from(*value) - mean).powi(2)).sum::<f64>() / area as f64;
        assert!((mean as f32 - means[map]).abs() <= 1e-4 && (variance.sqrt() as f32 - deviations[map]).abs() <= 1e-4);
    }
}
