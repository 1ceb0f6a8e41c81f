//! Encoding a picture of 640x480 pixels, beside the encoder of the crate `image`.

use criterion::{Criterion, criterion_group, criterion_main};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use splatseg_jpeg::encode;
use std::hint::black_box;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
/// The quality of overlays.
const QUALITY: u8 = 90;

/// Tinted areas with edges and a little noise, like an overlay.
fn picture() -> Vec<[u8; 3]> {
    let pixel = |index: usize| {
        let (column, row) = (index % WIDTH, index / WIDTH);
        let area = (column / 80 + 3 * (row / 60)) * 53 % 256;
        let noise = index.wrapping_mul(2_654_435_761) >> 7 & 15;
        [area + noise, 255 - area + noise, (row / 2) + noise].map(|value| value.min(255) as u8)
    };
    (0..WIDTH * HEIGHT).map(pixel).collect()
}

fn benchmark(criterion: &mut Criterion) {
    let pixels = picture();
    criterion.bench_function("encode", |bencher| {
        bencher.iter(|| encode(black_box(&pixels), WIDTH, HEIGHT, QUALITY).unwrap());
    });
    criterion.bench_function("encode with the crate image", |bencher| {
        bencher.iter(|| {
            let mut bytes = Vec::new();
            let mut encoder = JpegEncoder::new_with_quality(&mut bytes, QUALITY);
            encoder
                .encode(black_box(&pixels).as_flattened(), WIDTH as u32, HEIGHT as u32, ExtendedColorType::Rgb8)
                .unwrap();
            bytes
        });
    });
}

criterion_group!(benches, benchmark);
criterion_main!(benches);
