//! The network's input, bit for bit.

use super::golden::{Golden, image, shared};
use splatseg_models::fastsam::letterbox;

/// Compares with planes `[3, rows, width]`, every `step`th row of the input.
fn check(image_name: &str, image_size: usize, tensor: &str, step: usize, test: &str) {
    check_file(&format!("forward_{image_name}_{image_size}.safetensors"), image_name, image_size, (tensor, step), test);
}

fn check_file(file: &str, image_name: &str, image_size: usize, (tensor, step): (&str, usize), test: &str) {
    let Some(path) = shared(&format!("golden/fastsam/image_{image_name}.png"), test) else { return };
    let Some(forward) = Golden::open(file, test) else { return };
    let input = letterbox(&image(&path), image_size);
    let (expected, shape) = (forward.bytes(tensor), forward.shape(tensor));
    assert_eq!((input.height().div_ceil(step), input.width()), (shape[2], shape[3]));
    let rows = (0..3).flat_map(|channel| (0..input.height()).step_by(step).map(move |row| (channel, row)));
    let found: Vec<u8> =
        rows.flat_map(|(channel, row)| input.row(row).iter().map(move |pixel| pixel[channel])).collect();
    assert!(found == expected, "{} bytes differ", found.iter().zip(&expected).filter(|(a, b)| a != b).count());
}

#[test]
fn every_fourth_row_of_the_input_is_exact() {
    let rows = ("input_u8_rows_stride4", 4);
    check_file("forward.safetensors", "310x230", 640, rows, "every_fourth_row_of_the_input_is_exact");
}

#[test]
fn input_is_exact_310x230() {
    for size in [640, 1024] {
        check("310x230", size, "input_u8", 1, "input_is_exact_310x230");
    }
}

#[test]
fn input_is_exact_640x480() {
    check("640x480", 640, "input_u8", 1, "input_is_exact_640x480");
    check("640x480", 1024, "input_u8_rows_stride4", 4, "input_is_exact_640x480");
}
