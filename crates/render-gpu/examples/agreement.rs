//! Runs FastSAM-Splat twice over a scene, with its memory on the CPU and on the device, and prints how well they agree.
//!
//! ```sh
//! cargo run --release -p splatseg-render-gpu --example agreement -- SCENE FRAMES [KIND [SIDE]]
//! ```
//!
//! KIND is `evidence`, if it is not given, or `features`. Both see the same masks: those of the oracle segmenter
//! (`fastsam-like`) where the scene has true segments, otherwise those of the graph segmenter. Frames are 320 × 240 pixels
//! with a crop of 5.
//!
//! SIDE is where the second run has its memory: `device`, if it is not given, or `cpu`. There its `learning_rate` is the
//! next larger float: this shows how far features drift apart from the smallest difference that there is.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, ImageSize, open_scene};
use splatseg_geometry::{RgbdFrame, ScoredMask, SegmentMap};
use splatseg_memory::{MemoryKind, MemorySettings, SplatMemory};
use splatseg_metrics::{FramePrediction, ScoreSettings, Scores, VideoScorer};
use splatseg_render_gpu::{GpuDevice, Transfers};
use splatseg_segmenter::{GraphSegmenter, GraphSettings, Segmenter};
use splatseg_simulators::{OraclePreset, OracleSegmenter, OracleSettings};
use splatseg_tracking::{FastSamSplat, FastSamSplatSettings, FrameOutput, Method};
use std::error::Error;
use std::time::{Duration, Instant};

/// One of the two runs.
struct Run {
    method: FastSamSplat,
    scorer: VideoScorer,
    time: Duration,
}

impl Run {
    fn new(memory: SplatMemory) -> Result<Self, Box<dyn Error>> {
        let settings = FastSamSplatSettings::default().with(|settings| settings.memory = memory.settings().clone());
        let method = FastSamSplat::with_memory(settings, memory)?;
        Ok(Self { method, scorer: VideoScorer::new(ScoreSettings::default()), time: Duration::ZERO })
    }

    fn process(&mut self, frame: &RgbdFrame<'_>, masks: &[ScoredMask]) -> Result<FrameOutput, Box<dyn Error>> {
        let start = Instant::now();
        let output = self.method.process(frame, masks)?;
        self.time += start.elapsed();
        Ok(output)
    }

    fn finish(self) -> (Scores, usize, Duration) {
        let gaussians = self.method.memory().map_or(0, SplatMemory::gaussian_count);
        (self.scorer.finish().scores(), gaussians, self.time)
    }
}

/// The fraction of pixels that have the same segment.
fn agreement(one: &SegmentMap, other: &SegmentMap) -> f64 {
    let same = one.pixels().iter().zip(other.pixels()).filter(|(one, other)| one == other).count();
    same as f64 / one.pixels().len() as f64
}

/// Masks of the frame: the oracle's if it has true segments.
fn masks_of(
    frame: &RgbdFrame<'_>,
    truth: Option<&SegmentMap>,
    graph: &mut GraphSegmenter,
) -> Result<Vec<ScoredMask>, Box<dyn Error>> {
    let Some(truth) = truth.cloned() else { return Ok(graph.segment(frame)?) };
    let settings = OracleSettings::default().with(|settings| settings.preset = OraclePreset::FastsamLike);
    let mut oracle = OracleSegmenter::new(move |_: &RgbdFrame| Ok(truth.clone()), &settings, 0)?;
    Ok(oracle.segment(frame)?)
}

fn describe(name: &str, (scores, gaussians, time): &(Scores, usize, Duration), frames: usize) {
    let percent = |score: Option<f64>| score.map_or("none".to_owned(), |score| format!("{score:.3}"));
    let per_frame = time.as_secs_f64() * 1e3 / frames.max(1) as f64;
    println!(
        "{name}: VSQ {}, STQ {}, {gaussians} Gaussians, {per_frame:.0} ms a frame",
        percent(scores.vsq),
        percent(scores.stq)
    );
}

/// The kind of memory that is asked for.
fn kind_named(name: Option<&str>) -> Result<MemoryKind, String> {
    match name {
        None | Some("evidence") => Ok(MemoryKind::Evidence),
        Some("features") => Ok(MemoryKind::Features),
        Some(other) => Err(format!("expected evidence or features, not {other}")),
    }
}

/// The memories of the two runs, and the device if one is there.
fn memories(
    kind: MemoryKind,
    side: Option<&str>,
) -> Result<(SplatMemory, SplatMemory, Option<GpuDevice>), Box<dyn Error>> {
    let settings = FastSamSplatSettings::default().memory.with(|memory| memory.kind = kind);
    let memory = |settings: &MemorySettings| SplatMemory::new(settings.clone(), 0, &mut |_| {});
    match side {
        None | Some("device") => {
            let device = GpuDevice::open()?;
            Ok((memory(&settings)?, memory(&settings)?.on_device(&device)?, Some(device)))
        }
        Some("cpu") => {
            let changed = settings.clone().with(|settings| settings.learning_rate = settings.learning_rate.next_up());
            Ok((memory(&settings)?, memory(&changed)?, None))
        }
        Some(other) => Err(format!("expected device or cpu, not {other}").into()),
    }
}

/// What went to the device and back since `before`.
fn describe_transfers(device: &GpuDevice, before: Transfers) -> String {
    let Transfers { uploads, uploaded_bytes, downloads, downloaded_bytes } = device.transfers();
    format!(
        "; {} uploads of {} KB, {} downloads of {} KB",
        uploads - before.uploads,
        (uploaded_bytes - before.uploaded_bytes) / 1024,
        downloads - before.downloads,
        (downloaded_bytes - before.downloaded_bytes) / 1024,
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(path), Some(frames)) = (arguments.next(), arguments.next()) else {
        return Err("expected the path of a scene and a number of frames".into());
    };
    let settings = DatasetSettings::default().with(|settings| {
        settings.max_frames = frames.parse().ok();
        settings.resize = Some(ImageSize { width: 320, height: 240 });
        settings.crop_border = 5;
    });
    let (kind, side) = (kind_named(arguments.next().as_deref())?, arguments.next());
    let (first, second, device) = memories(kind, side.as_deref())?;
    let (mut first, mut second) = (Run::new(first)?, Run::new(second)?);
    let mut graph = GraphSegmenter::new(GraphSettings::default())?;
    let (mut sum, mut worst, mut count) = (0.0, 1.0f64, 0);
    for frame in FrameStream::open(open_scene(&path, &settings)?, &settings, GroundTruth::Read)? {
        let frame = frame?;
        let masks = masks_of(&frame.frame, frame.ground_truth.as_ref(), &mut graph)?;
        let before = device.as_ref().map(GpuDevice::transfers).unwrap_or_default();
        let (one, other) = (first.process(&frame.frame, &masks)?, second.process(&frame.frame, &masks)?);
        let same = agreement(&one.segments, &other.segments);
        (sum, worst, count) = (sum + same, worst.min(same), count + 1);
        if let Some(truth) = &frame.ground_truth {
            first.scorer.push(truth, &FramePrediction::Ids(&one.segments))?;
            second.scorer.push(truth, &FramePrediction::Ids(&other.segments))?;
        }
        println!(
            "frame {count}: {:.4} % equal; grown {} and {}, removed {} and {}{}",
            100.0 * same,
            one.update.grown,
            other.update.grown,
            one.update.removed,
            other.update.removed,
            device.as_ref().map_or(String::new(), |device| describe_transfers(device, before)),
        );
    }
    println!(
        "{path}: {:.4} % of pixels equal over {count} frames, {:.4} % in the worst",
        100.0 * sum / f64::from(count),
        100.0 * worst
    );
    describe("first", &first.finish(), count as usize);
    describe("second", &second.finish(), count as usize);
    Ok(())
}
