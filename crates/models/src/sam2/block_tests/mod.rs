//! Compares every block with the official code's results, module by module.

mod encoder;
mod heads;
mod memory;
mod prompt;
mod resize;

use super::Sam2Network;
use super::prompt::{InputPoint, PointLabel};
use burn::tensor::{Tensor, TensorData};
use splatseg_geometry::Image;
use std::path::Path;

#[path = "../../../tests/it/sam2_golden/mod.rs"]
mod golden;

use golden::test_device::device;
use golden::{Golden, Within, assert_close, folder};

const CLOSE: Within = Within::OfMax(1e-5);
const SIDE: usize = 256;

fn mini(folder: &Path) -> Sam2Network {
    Sam2Network::load(&golden::mini_weights(folder), None, &device()).unwrap()
}

/// The elements of a tensor, row-major.
fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec().unwrap()
}

fn tensor<const D: usize>(golden: &Golden, name: &str) -> Tensor<D> {
    let shape: [usize; D] = golden.shape(name).try_into().unwrap();
    Tensor::from_data(TensorData::new(golden.floats(name), shape), &device())
}

/// `[objects, channels, height, width]` to channels-last.
fn channels_last(golden: &Golden, name: &str) -> Tensor<4> {
    tensor::<4>(golden, name).permute([0, 2, 3, 1])
}

/// Compares a channels-last map with a channels-first reference.
#[track_caller]
fn assert_planes(golden: &Golden, name: &str, found: Tensor<4>, within: Within) {
    assert_close(name, &values(found.permute([0, 3, 1, 2])), &golden.floats(name), within);
}

fn frame(folder: &Path, index: usize) -> Image<[u8; 3]> {
    let picture = image::open(folder.join(format!("mini_video/{index:05}.png"))).unwrap().to_rgb8();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Image::from_pixels(width, height, picture.pixels().map(|pixel| pixel.0).collect()).unwrap()
}

/// Prompts of a case: the points, and true if there is a mask.
fn prompt(golden: &Golden, case: &str) -> (Vec<InputPoint>, bool) {
    let label = |label: f32| match label as i32 {
        0 => Some(PointLabel::Negative),
        1 => Some(PointLabel::Positive),
        2 => Some(PointLabel::BoxStart),
        3 => Some(PointLabel::BoxEnd),
        _ => None,
    };
    let coords = golden.floats(&format!("{case}.coords"));
    let labels = golden.floats(&format!("{case}.labels"));
    let points = coords.chunks_exact(2).zip(labels);
    let points = points.map(|(point, value)| InputPoint { x: point[0], y: point[1], label: label(value) });
    (points.filter(|point| point.label.is_some()).collect(), case.contains("mask"))
}

const CASES: [&str; 7] = ["point1", "points3", "box", "box_points", "mask", "points_mask", "none"];
