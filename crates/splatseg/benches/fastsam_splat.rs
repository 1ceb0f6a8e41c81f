//! Frames per second of FastSAM-Splat without its segmenter, stage by stage, with both kinds of memory, on redkitchen
//! at 310×230 (320×240 less a 5-pixel border); features have D = 28 and 20 steps. Without `../shared` it measures the
//! synthetic room instead.
//!
//! `cargo bench -p splatseg --bench fastsam_splat`

use criterion::{Criterion, criterion_group, criterion_main};
use splatseg::dataset::{DatasetSettings, FrameStream, GroundTruth, ImageSize, Scene, open_scene};
use splatseg::memory::MemoryKind;
use splatseg::pipeline::StageTimes;
use splatseg::segmenter::{GraphSegmenter, GraphSettings, SegmenterError};
use splatseg::tracking::{FastSamSplat, FastSamSplatSettings};
use splatseg::{CameraFrame, Pipeline, RgbdFrame, Segmenter};
use splatseg_geometry::Segmentation;
use splatseg_test_scenes::shared;
use std::sync::Arc;
use std::time::Duration;

fn scene(settings: &DatasetSettings) -> Arc<dyn Scene> {
    if let Some(redkitchen) = shared("data/redkitchen", "fastsam_splat, on redkitchen") {
        return open_scene(redkitchen, settings).expect("redkitchen can be read");
    }
    println!("measuring the synthetic room");
    open_scene("synthetic:frames=100,noise=kinect", settings).expect("the synthetic room needs no file")
}

/// Segments every frame of the scene.
fn segmented_frames() -> Vec<(RgbdFrame<'static>, Segmentation)> {
    let resize = Some(ImageSize { width: 320, height: 240 });
    let settings = DatasetSettings::default().with(|settings| {
        settings.resize = resize;
        settings.crop_border = 5;
    });
    let mut segmenter = GraphSegmenter::new(GraphSettings::default()).expect("defaults are in range");
    FrameStream::open(scene(&settings), &settings, GroundTruth::Skip)
        .expect("the scene has frames")
        .map(|frame| {
            let frame = frame.expect("every frame is good").posed().expect("every frame has a pose");
            let masks = segmenter.segment(&frame).expect("every frame can be segmented");
            (frame, masks)
        })
        .collect()
}

/// A segmenter that returns precomputed masks.
struct Prepared(std::vec::IntoIter<Segmentation>);

impl Segmenter for Prepared {
    fn name(&self) -> &str {
        "prepared"
    }

    fn segment(&mut self, _: &CameraFrame) -> Result<Segmentation, SegmenterError> {
        Ok(self.0.next().unwrap_or_default())
    }
}

/// Tracks the whole video. Returns the summed stage times and the time of the slowest frame.
fn track(frames: &[(RgbdFrame<'static>, Segmentation)], kind: MemoryKind) -> (StageTimes, Duration) {
    let settings = FastSamSplatSettings::default().with(|settings| settings.memory.kind = kind);
    let method = FastSamSplat::new(settings, 0, &mut |_| {}).expect("defaults are in range");
    let masks: Vec<Segmentation> = frames.iter().map(|(_, masks)| masks.clone()).collect();
    let mut pipeline = Pipeline::new(Box::new(Prepared(masks.into_iter())), Box::new(method));
    let (mut times, mut slowest) = (StageTimes::default(), Duration::ZERO);
    for (frame, _) in frames {
        let result = pipeline.step(frame).expect("masks have the frame's size");
        times += &result.times;
        slowest = slowest.max(result.times.without_segmenter());
    }
    (times, slowest)
}

fn print_stages(frames: &[(RgbdFrame<'static>, Segmentation)], kind: MemoryKind) {
    let (times, slowest) = track(frames, kind);
    let count = frames.len() as f64;
    for (stage, time) in &times.stages()[1..] {
        println!("{stage:16} {:7.2} ms per frame", time.as_secs_f64() * 1e3 / count);
    }
    println!(
        "{}: {:.2} frames per second without the segmenter, slowest frame {:.0} ms",
        kind.name(),
        count / times.without_segmenter().as_secs_f64(),
        slowest.as_secs_f64() * 1e3
    );
}

fn whole_video(criterion: &mut Criterion) {
    let frames = segmented_frames();
    let kinds = [MemoryKind::Evidence, MemoryKind::Features];
    kinds.into_iter().for_each(|kind| print_stages(&frames, kind));
    let mut group = criterion.benchmark_group("fastsam_splat");
    group.sample_size(10);
    for kind in kinds {
        group.bench_function(format!("whole_video/{}", kind.name()), |bencher| {
            bencher.iter_custom(|rounds| (0..rounds).map(|_| track(&frames, kind).0.without_segmenter()).sum());
        });
    }
    group.finish();
}

criterion_group!(benches, whole_video);
criterion_main!(benches);
