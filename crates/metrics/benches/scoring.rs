//! Scoring a video of 100 frames, 640x480, with 60 objects.

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use splatseg_geometry::{Mask, SegmentMap};
use splatseg_metrics::{FramePrediction, Protocol, ScoreSettings, VideoScorer};
use std::hint::black_box;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const OBJECTS: usize = 60;
const FRAMES: usize = 100;
/// Number of different frames. The video plays them forwards and backwards.
const DIFFERENT_FRAMES: usize = 20;

struct Frame {
    truth: SegmentMap,
    prediction: SegmentMap,
    masks: Vec<Mask>,
}

/// Voronoi cells of drifting points, every eighth unlabelled. The prediction is displaced and has noisy outlines.
fn frame(time: usize) -> Frame {
    let centre = |object: usize| {
        let column = (object * 97 + 3 * time * (1 + object % 3)) % WIDTH;
        let row = (object * 61 + 2 * time * (1 + object % 5)) % HEIGHT;
        (column as i64, row as i64)
    };
    let nearest = |column: i64, row: i64| {
        let distance = |object: &usize| {
            let (x, y) = centre(*object);
            (x - column).pow(2) + (y - row).pow(2)
        };
        (0..OBJECTS).min_by_key(distance).map_or(0, |object| object as u32 + 1)
    };
    let truth = SegmentMap::from_fn(WIDTH, HEIGHT, |column, row| {
        let id = nearest(column as i64, row as i64);
        if id % 8 == 0 { 0 } else { id }
    });
    let prediction = SegmentMap::from_fn(WIDTH, HEIGHT, |column, row| {
        let jitter = ((column * 31 + row * 17 + time * 7) % 5) as i64;
        100 + nearest(column as i64 + jitter, row as i64 + 2)
    });
    let masks = Mask::of_segments(&prediction).into_iter().map(|(_, mask)| mask).collect();
    Frame { truth, prediction, masks }
}

fn scoring(criterion: &mut Criterion) {
    let frames: Vec<Frame> = (0..DIFFERENT_FRAMES).map(frame).collect();
    let video = || {
        let forth_and_back = (0..DIFFERENT_FRAMES).chain((0..DIFFERENT_FRAMES).rev()).cycle();
        forth_and_back.take(FRAMES).map(|index| &frames[index])
    };
    let mut group = criterion.benchmark_group("100 frames 640x480, 60 objects");
    group.sample_size(10);
    for protocol in [Protocol::Paper, Protocol::Strict] {
        let settings = ScoreSettings { protocol, ..ScoreSettings::default() };
        for linked in [true, false] {
            let name = format!("{protocol:?}, {}", if linked { "id map" } else { "masks without ids" });
            group.bench_function(name, |bencher| {
                bencher.iter_batched(
                    || VideoScorer::new(settings),
                    |mut scorer| {
                        for frame in video() {
                            let prediction = if linked {
                                FramePrediction::Ids(&frame.prediction)
                            } else {
                                FramePrediction::Unlinked(&frame.masks)
                            };
                            scorer.push(&frame.truth, &prediction).expect("all frames have one size");
                        }
                        black_box(scorer.finish().scores())
                    },
                    BatchSize::PerIteration,
                );
            });
        }
    }
    group.finish();
}

criterion_group!(benches, scoring);
criterion_main!(benches);
