//! Encoded images are read by two decoders, and are close to what was encoded.

use proptest::prelude::*;
use splatseg_jpeg::{EncodeError, Jpeg, encode};

/// A picture with slow changes and a sharp edge.
fn picture(width: usize, height: usize) -> Vec<[u8; 3]> {
    let pixel = |index: usize| {
        let (column, row) = (index % width, index / width);
        let wave = |period: f32, phase: f32| (127.5 + 100.0 * ((column + 2 * row) as f32 / period + phase).sin()) as u8;
        if column > width / 2 { [wave(40.0, 0.0), wave(61.0, 1.0), wave(83.0, 2.0)] } else { [200, 60, 30] }
    };
    (0..width * height).map(pixel).collect()
}

/// Root mean square difference over all samples, levels.
fn difference(a: &[[u8; 3]], b: &[[u8; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares = a.as_flattened().iter().zip(b.as_flattened()).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2));
    (squares.sum::<f64>() / (3 * a.len()) as f64).sqrt()
}

fn decoded(bytes: &[u8], size: (usize, usize)) -> Vec<[u8; 3]> {
    let jpeg = Jpeg::read_header(bytes).unwrap();
    assert_eq!(jpeg.size(), (size.0 as u32, size.1 as u32));
    jpeg.decode().unwrap()
}

#[test]
fn a_picture_stays_close_and_gets_closer_with_quality() {
    let (width, height) = (123, 77);
    let pixels = picture(width, height);
    let [low, middle, high] = [30, 75, 95].map(|quality| encode(&pixels, width, height, quality).unwrap());
    let errors = [&low, &middle, &high].map(|bytes| difference(&decoded(bytes, (width, height)), &pixels));
    assert!(errors[0] > errors[1] && errors[1] > errors[2], "{errors:?}");
    // What remains is chroma at half the resolution beside the edge.
    assert!(errors[2] < 6.0, "{errors:?}");
    assert!(low.len() < middle.len() && middle.len() < high.len());
}

#[test]
fn luma_is_nearly_exact_at_the_highest_quality() {
    let pixels: Vec<[u8; 3]> = (0..64 * 48).map(|index: usize| [(index * 37 % 251) as u8; 3]).collect();
    let found = decoded(&encode(&pixels, 64, 48, 100).unwrap(), (64, 48));
    assert!(difference(&found, &pixels) < 1.0, "{}", difference(&found, &pixels));
}

#[test]
fn the_largest_coefficients_have_codes() {
    // Signs of the basis functions with the largest sums, in one direction and in both.
    let sign = |at: usize| matches!(at % 8, 0 | 3 | 4 | 7);
    for both in [false, true] {
        let white = |column: usize, row: usize| sign(column) == (sign(row) || !both);
        let pixels: Vec<[u8; 3]> =
            (0..32 * 32).map(|index| if white(index % 32, index / 32) { [255; 3] } else { [0; 3] }).collect();
        let found = decoded(&encode(&pixels, 32, 32, 100).unwrap(), (32, 32));
        assert!(difference(&found, &pixels) < 2.0, "{}", difference(&found, &pixels));
    }
}

#[test]
fn other_encoders_do_not_come_closer_for_grey_pictures() {
    let (width, height) = (160, 120);
    let pixels: Vec<[u8; 3]> = picture(width, height).iter().map(|pixel| [pixel[1]; 3]).collect();
    let mut other = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut other, 85)
        .encode(pixels.as_flattened(), width as u32, height as u32, image::ExtendedColorType::Rgb8)
        .unwrap();
    let ours = encode(&pixels, width, height, 85).unwrap();
    let error = |bytes: &[u8]| difference(&decoded(bytes, (width, height)), &pixels);
    assert!(error(&ours) < 1.05 * error(&other), "{} and {}", error(&ours), error(&other));
    assert!(ours.len() < other.len() + other.len() / 20, "{} and {} bytes", ours.len(), other.len());
}

#[test]
fn impossible_sizes_are_errors() {
    assert_eq!(encode(&[], 0, 4, 80), Err(EncodeError::Size(0, 4)));
    assert_eq!(encode(&[], 4, 0, 80), Err(EncodeError::Size(4, 0)));
    assert_eq!(encode(&[], 70_000, 1, 80), Err(EncodeError::Size(70_000, 1)));
    let expected = EncodeError::PixelCount { pixels: 5, width: 2, height: 3 };
    assert_eq!(encode(&[[0; 3]; 5], 2, 3, 80), Err(expected));
}

proptest! {
    #[test]
    fn any_image_is_decoded_alike_by_two_decoders(
        width in 1usize..50,
        height in 1usize..50,
        quality in 0u8..=110,
        noise in prop::collection::vec(any::<[u8; 3]>(), 2500),
    ) {
        let pixels = &noise[..width * height];
        let bytes = encode(pixels, width, height, quality).unwrap();
        prop_assert_eq!(&bytes, &encode(pixels, width, height, quality).unwrap());
        decoded(&bytes, (width, height));
        // Decoders differ in how they enlarge chroma, so both are compared without any.
        let grey: Vec<[u8; 3]> = pixels.iter().map(|pixel| [pixel[0]; 3]).collect();
        let bytes = encode(&grey, width, height, quality).unwrap();
        let ours = decoded(&bytes, (width, height));
        let other = image::load_from_memory(&bytes).unwrap().into_rgb8();
        prop_assert_eq!((other.width() as usize, other.height() as usize), (width, height));
        let largest = ours.iter().zip(other.pixels()).map(|(a, b)| a[0].abs_diff(b.0[0])).max();
        prop_assert!(largest <= Some(2), "{:?}", largest);
    }
}
