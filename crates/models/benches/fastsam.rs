//! FastSAM without its network: letterbox, suppression and masks of a busy 320×240 frame.

use criterion::{Criterion, criterion_group, criterion_main};
use splatseg_geometry::Image;
use splatseg_models::fastsam::{
    Candidates, FastSamPredictorSettings, Placement, Prototypes, detections, input_values, letterbox,
};
use std::hint::black_box;

/// Pseudo-random numbers in [-1, 1).
fn noise(seed: usize) -> f32 {
    (seed.wrapping_mul(2_654_435_761) >> 8 & 0xffff) as f32 / 32_768.0 - 1.0
}

/// 100 objects of all sizes in a 320×240 image, at an input of 320×256.
fn busy_frame() -> (Candidates, Prototypes) {
    let mut candidates = Candidates::new(32);
    for index in 0..100 {
        let (column, row) = (index % 10, index / 10);
        let centre = [16.0 + 32.0 * column as f32, 12.0 + 24.0 * row as f32];
        let size = 20.0 + 120.0 * (index % 7) as f32 / 6.0;
        let coefficients = (0..32).map(|k| noise(32 * index + k));
        candidates.push(index, [centre[0], centre[1], size, size * 0.8], 0.9 - 0.004 * index as f32, coefficients);
    }
    let (width, height) = (80, 64);
    let values = (0..32 * width * height).map(|place| noise(7 * place)).collect();
    (candidates, Prototypes { count: 32, height, width, values })
}

fn fastsam(criterion: &mut Criterion) {
    let (candidates, prototypes) = busy_frame();
    let placement = Placement { image: (320, 240), input: (320, 256) };
    let settings = FastSamPredictorSettings::default().with(|settings| settings.image_size = 320);
    let found = detections(&candidates, &prototypes, placement, &settings).len();
    criterion.bench_function(&format!("masks of {found} detections, 320x240"), |bencher| {
        bencher.iter(|| detections(black_box(&candidates), &prototypes, placement, &settings));
    });
    let image = Image::from_fn(640, 480, |column, row| [column as u8, row as u8, (column ^ row) as u8]);
    criterion.bench_function("input of 1024x768 from 640x480", |bencher| {
        bencher.iter(|| input_values(&letterbox(black_box(&image), 1024)));
    });
}

criterion_group!(benches, fastsam);
criterion_main!(benches);
