//! Scores of the baseline without memory on the oracle's masks, for calibrating the preset `fastsam-like`
//! (`docs/dev/ORACLE.md`).

use anyhow::{Context, Result, bail};
use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, StreamedFrame, open_scene};
use splatseg_geometry::{CameraFrame, Mask};
use splatseg_metrics::{DatasetScore, FramePrediction, Protocol, ScoreSettings, Scores, VideoScorer};
use splatseg_segmenter::Segmenter;
use splatseg_simulators::{OraclePreset, OracleSegmenter, OracleSettings, SimulatorError};
use splatseg_tracking::{FastSamBaseline, FastSamBaselineSettings, Method};
use std::collections::HashMap;
use std::sync::Arc;

/// Score the oracle's masks without a memory, for its calibration
///
/// Scenes are read with the paper's 5-pixel border cropped.
#[derive(clap::Args)]
pub struct Arguments {
    /// Labelled scenes
    #[arg(required = true)]
    scenes: Vec<String>,
    /// Number of seeds
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..))]
    seeds: u16,
    /// Settings of the oracle instead of the preset, e.g. '{"preset": "fastsam-like", "miss_rate": 0.1}'
    #[arg(long, value_name = "JSON")]
    settings: Option<String>,
}

/// A scene in memory, iterated once for each seed.
struct Video {
    name: String,
    frames: Arc<Vec<StreamedFrame>>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let settings = match &arguments.settings {
        Some(text) => serde_json::from_str(text).context("--settings")?,
        None => OracleSettings::default().with(|settings| settings.preset = OraclePreset::FastsamLike),
    };
    let videos = arguments.scenes.iter().map(|path| read(path)).collect::<Result<Vec<Video>>>()?;
    println!("{}", serde_json::to_string(&settings.resolved()?)?);
    describe(&videos);
    println!("{:<8} {:<7} {:>6} {:>6} {:>6} {:>6}  {HEADINGS}", "protocol", "seed", "k=1", "5", "10", "15");
    for protocol in [Protocol::Paper, Protocol::Strict] {
        let mut rows = Vec::new();
        for seed in 0..u64::from(arguments.seeds) {
            let (row, masks_per_frame) = scored(&videos, &settings, seed, protocol)?;
            println!("{:<8} {seed:<7} {}  masks/frame {masks_per_frame:.1}", format!("{protocol:?}"), text(&row));
            rows.push(row);
        }
        let mean: Vec<f64> =
            (0..8).map(|column| rows.iter().map(|row| row[column]).sum::<f64>() / rows.len() as f64).collect();
        println!("{:<8} {:<7} {}", format!("{protocol:?}"), "mean", text(&mean));
    }
    println!("{:<8} {:<7} {}", "Paper", "FastSAM", text(&PAPERS_FASTSAM));
    Ok(())
}

const HEADINGS: &str = "   VSQ    STQ     AQ     SQ";
/// The paper's scores of FastSAM on ScanNet-MV, in the columns of the table.
const PAPERS_FASTSAM: [f64; 8] = [46.98, 39.19, 34.28, 31.21, 37.92, 28.17, 19.74, 40.19];

fn read(path: &str) -> Result<Video> {
    let dataset = DatasetSettings::default().with(|settings| settings.crop_border = 5);
    let scene = open_scene(path, &dataset)?;
    let name = scene.name().to_owned();
    let frames = FrameStream::open(scene, &dataset, GroundTruth::Read)?.collect::<std::result::Result<Vec<_>, _>>()?;
    if frames.iter().any(|frame| frame.ground_truth.is_none()) {
        bail!("{path}: not every frame is labelled");
    }
    Ok(Video { name, frames: Arc::new(frames) })
}

fn describe(videos: &[Video]) {
    for video in videos {
        let objects: usize =
            video.frames.iter().filter_map(|frame| frame.ground_truth.as_ref()).map(|truth| truth.areas().len()).sum();
        let frames = video.frames.len();
        println!("{}: {frames} frames, {:.1} objects/frame", video.name, objects as f64 / frames as f64);
    }
}

/// The scores over all videos, as the table's columns, and the mean number of masks per frame.
fn scored(videos: &[Video], settings: &OracleSettings, seed: u64, protocol: Protocol) -> Result<(Vec<f64>, f64)> {
    let score_settings = ScoreSettings { protocol, ..ScoreSettings::default() };
    let mut total = DatasetScore::new(score_settings);
    let (mut mask_count, mut frame_count) = (0, 0);
    for video in videos {
        let mut oracle = oracle(video, settings, seed)?;
        // Small masks count, as in the paper's evaluation.
        let mut method = FastSamBaseline::new(FastSamBaselineSettings::default().with(|it| it.min_area = 0))?;
        let mut scorer = VideoScorer::new(score_settings);
        for streamed in video.frames.iter() {
            let ground_truth = &streamed.ground_truth;
            let frame = streamed.clone().posed().context("a frame without a pose")?;
            let masks: Vec<Mask> = method
                .process_masks(&frame, &oracle.segment(&frame)?.masks)?
                .masks
                .into_iter()
                .map(|(_, mask)| mask)
                .collect();
            let truth = ground_truth.as_ref().context("a frame without labels")?;
            scorer.push(truth, &FramePrediction::Unlinked(&masks))?;
            mask_count += masks.len();
            frame_count += 1;
        }
        total.add(&scorer.finish())?;
    }
    Ok((columns(&total.total()), mask_count as f64 / f64::from(frame_count)))
}

/// An oracle with the labels in memory.
fn oracle(video: &Video, settings: &OracleSettings, seed: u64) -> Result<OracleSegmenter> {
    let frames = Arc::clone(&video.frames);
    let places: HashMap<String, usize> =
        frames.iter().enumerate().map(|(place, frame)| (frame.frame.name().to_owned(), place)).collect();
    let scene = video.name.clone();
    let truth = move |frame: &CameraFrame| {
        let labels = places.get(frame.name()).and_then(|place| frames[*place].ground_truth.clone());
        labels.ok_or_else(|| SimulatorError::UnlabelledFrame { scene: scene.clone(), frame: frame.name().to_owned() })
    };
    Ok(OracleSegmenter::new(truth, settings, seed)?)
}

fn columns(scores: &Scores) -> Vec<f64> {
    let others = [scores.vsq, scores.stq, scores.aq, scores.sq];
    scores.vsq_k.values().chain(&others).map(|score| score.unwrap_or(f64::NAN)).collect()
}

fn text(row: &[f64]) -> String {
    let cells: Vec<String> = row.iter().map(|value| format!("{value:>6.2}")).collect();
    format!("{}  {}", cells[..4].join(" "), cells[4..].join(" "))
}
