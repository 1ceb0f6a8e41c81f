//! What the baseline without memory scores on the oracle's masks: the calibration of the preset `fastsam-like`
//! (`docs/ORACLE.md`).
//!
//! `cargo run --release -p splatseg-tracking --example calibrate_oracle -- SCENE... [--seeds N] [--settings JSON]`
//!
//! Scenes are read with the paper's 5-pixel border cropped. JSON are oracle settings, e.g.
//! `'{"preset": "fastsam-like", "miss_rate": 0.1}'`; without it the preset is used as it is.

use splatseg_dataset::{DatasetSettings, FrameStream, GroundTruth, StreamedFrame, open_scene};
use splatseg_geometry::{Mask, RgbdFrame};
use splatseg_metrics::{DatasetScore, FramePrediction, Protocol, ScoreSettings, Scores, VideoScorer};
use splatseg_segmenter::{OraclePreset, OracleSegmenter, OracleSettings};
use splatseg_tracking::{FastSam, FastSamSettings, Method};
use std::collections::HashMap;
use std::error::Error;
use std::sync::Arc;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

struct Options {
    scenes: Vec<String>,
    seeds: u64,
    settings: OracleSettings,
}

/// A scene in memory, for going through it once for each seed.
struct Video {
    name: String,
    frames: Arc<Vec<StreamedFrame>>,
}

fn main() -> Result<()> {
    let options = options()?;
    let videos = options.scenes.iter().map(|path| read(path)).collect::<Result<Vec<Video>>>()?;
    println!("{}", serde_json::to_string(&options.settings.resolved()?)?);
    describe(&videos);
    println!("{:<8} {:<7} {:>6} {:>6} {:>6} {:>6}  {HEADINGS}", "protocol", "seed", "k=1", "5", "10", "15");
    for protocol in [Protocol::Paper, Protocol::Strict] {
        let mut rows = Vec::new();
        for seed in 0..options.seeds {
            let (row, masks_per_frame) = scored(&videos, &options.settings, seed, protocol)?;
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
/// The paper's FastSAM on ScanNet-MV, in the columns of the table.
const PAPERS_FASTSAM: [f64; 8] = [46.98, 39.19, 34.28, 31.21, 37.92, 28.17, 19.74, 40.19];

fn options() -> Result<Options> {
    let settings = OracleSettings { preset: OraclePreset::FastsamLike, ..OracleSettings::default() };
    let mut options = Options { scenes: Vec::new(), seeds: 5, settings };
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        let mut value = || arguments.next().ok_or(format!("{argument} needs a value"));
        match argument.as_str() {
            "--seeds" => options.seeds = value()?.parse()?,
            "--settings" => options.settings = serde_json::from_str(&value()?)?,
            _ => options.scenes.push(argument),
        }
    }
    if options.scenes.is_empty() || options.seeds == 0 {
        return Err("expected SCENE... [--seeds N] [--settings JSON]".into());
    }
    Ok(options)
}

fn read(path: &str) -> Result<Video> {
    let dataset = DatasetSettings { crop_border: 5, ..DatasetSettings::default() };
    let scene = open_scene(path, &dataset)?;
    let name = scene.name().to_owned();
    let frames = FrameStream::open(scene, &dataset, GroundTruth::Read)?.collect::<std::result::Result<Vec<_>, _>>()?;
    if frames.iter().any(|frame| frame.ground_truth.is_none()) {
        return Err(format!("{path}: not every frame is labelled").into());
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

/// The scores over all videos, as the table's columns, and the mean number of masks in a frame.
fn scored(videos: &[Video], settings: &OracleSettings, seed: u64, protocol: Protocol) -> Result<(Vec<f64>, f64)> {
    let score_settings = ScoreSettings { protocol, ..ScoreSettings::default() };
    let mut total = DatasetScore::new(score_settings);
    let (mut mask_count, mut frame_count) = (0, 0);
    for video in videos {
        let mut method = FastSam::new(Box::new(oracle(video, settings, seed)?), FastSamSettings::default())?;
        let mut scorer = VideoScorer::new(score_settings);
        for StreamedFrame { frame, ground_truth, .. } in video.frames.iter() {
            let masks: Vec<Mask> = method.process(frame)?.masks.into_iter().map(|(_, mask)| mask).collect();
            let truth = ground_truth.as_ref().ok_or("a frame without labels")?;
            scorer.push(truth, &FramePrediction::Unlinked(&masks))?;
            mask_count += masks.len();
            frame_count += 1;
        }
        total.add(&scorer.finish())?;
    }
    Ok((columns(&total.total()), mask_count as f64 / frame_count as f64))
}

/// An oracle that knows the labels in memory.
fn oracle(video: &Video, settings: &OracleSettings, seed: u64) -> Result<OracleSegmenter> {
    let frames = Arc::clone(&video.frames);
    let places: HashMap<String, usize> =
        frames.iter().enumerate().map(|(place, frame)| (frame.frame.name().to_owned(), place)).collect();
    let scene = video.name.clone();
    let truth = move |frame: &RgbdFrame| {
        let labels = places.get(frame.name()).and_then(|place| frames[*place].ground_truth.clone());
        labels.ok_or_else(|| splatseg_segmenter::SegmenterError::UnlabelledFrame {
            scene: scene.clone(),
            frame: frame.name().to_owned(),
        })
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
