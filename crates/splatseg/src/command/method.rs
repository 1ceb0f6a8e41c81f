//! Methods and segmenters as settings ask for them.

use super::Failure;
use indicatif::ProgressBar;
use splatseg::settings::{MethodName, SegmenterName, Settings, TrackerName};
use splatseg_dataset::Scene;
use splatseg_memory::SplatMemory;
use splatseg_models::checkpoint::Checkpoint;
use splatseg_models::fastsam::FastSamPredictor;
use splatseg_models::sam2::Sam2Network;
use splatseg_segmenter::{
    FastSamSegmenter, FirstAppearances, GraphSegmenter, MaskFolder, OracleSegmenter, SceneGroundTruth, Segmenter,
};
use splatseg_tracking::{
    FastSam, FastSamSplat, FastSpam, Method, PromptSource, Sam2Baseline, Sam2Splat, Sam2Tracker, SimTracker, Tracker,
};
use std::path::Path;
use std::sync::Arc;

/// Where a method's memory comes from.
pub enum Memory<'a> {
    /// A new one; the bar shows how far its codebook is.
    New(&'a ProgressBar),
    /// One that an earlier run saved.
    Saved(&'a Path),
}

/// Makes the method of the settings for a scene, over a segmenter.
pub fn make_method(
    settings: &Settings,
    scene: &Arc<dyn Scene>,
    segmenter: Box<dyn Segmenter>,
    memory: &Memory,
) -> Result<Box<dyn Method>, Failure> {
    match settings.method {
        MethodName::FastsamSplat => {
            let memory = make_memory(settings, memory)?;
            let method = FastSamSplat::with_memory(segmenter, settings.fastsam_splat(), memory);
            Ok(Box::new(method.map_err(Failure::input)?))
        }
        MethodName::Sam2 => {
            no_memory(settings.method, memory)?;
            let tracker = make_tracker(settings, scene)?;
            let method = Sam2Baseline::new(segmenter, tracker, settings.new_objects());
            Ok(Box::new(method.map_err(Failure::input)?))
        }
        MethodName::Sam2Splat => {
            let tracker = make_tracker(settings, scene)?;
            let memory = make_memory(settings, memory)?;
            let method = Sam2Splat::with_memory(segmenter, tracker, settings.sam2_splat(), memory);
            Ok(Box::new(method.map_err(Failure::input)?))
        }
        MethodName::Fastsam => {
            no_memory(settings.method, memory)?;
            Ok(Box::new(FastSam::new(segmenter, settings.fastsam()).map_err(Failure::input)?))
        }
        MethodName::Fastspam => {
            no_memory(settings.method, memory)?;
            Ok(Box::new(FastSpam::new(segmenter, settings.fastspam()).map_err(Failure::input)?))
        }
    }
}

fn no_memory(method: MethodName, memory: &Memory) -> Result<(), Failure> {
    match memory {
        Memory::New(_) => Ok(()),
        Memory::Saved(path) => {
            Err(Failure::input(format!("{}: the method {} has no splat memory to load", path.display(), method.name())))
        }
    }
}

fn make_memory(settings: &Settings, memory: &Memory) -> Result<SplatMemory, Failure> {
    match memory {
        Memory::Saved(path) => SplatMemory::load(path, settings.memory.clone()).map_err(Failure::input),
        Memory::New(bar) => new_memory(settings, bar),
    }
}

fn new_memory(settings: &Settings, bar: &ProgressBar) -> Result<SplatMemory, Failure> {
    let mut progress = |fraction: f32| bar.set_position((fraction * 100.0) as u64);
    let memory = SplatMemory::new(settings.memory.clone(), settings.seed, &mut progress).map_err(Failure::input);
    bar.finish_and_clear();
    memory
}

/// Makes the tracker of the settings for a scene.
fn make_tracker(settings: &Settings, scene: &Arc<dyn Scene>) -> Result<Box<dyn Tracker>, Failure> {
    match settings.tracker {
        TrackerName::Sam2 => {
            let path = tracker_weights(settings)?;
            let of_file = |error: &dyn std::fmt::Display| Failure::input(format!("{}: {error}", path.display()));
            let device = settings.device.open().map_err(Failure::input)?;
            let weights = Checkpoint::open(path).map_err(Failure::input)?;
            let network =
                Sam2Network::load(&weights, settings.sam2.image_size, &device).map_err(|error| of_file(&error))?;
            Ok(Box::new(Sam2Tracker::new(network, settings.sam2).map_err(Failure::input)?))
        }
        TrackerName::Sim => {
            let tracker = SimTracker::new(ground_truth(settings, scene)?, settings.sim_tracker, settings.seed);
            Ok(Box::new(tracker.map_err(Failure::input)?))
        }
    }
}

/// The checkpoint that `--tracker sam2` cannot do without.
pub fn tracker_weights(settings: &Settings) -> Result<&Path, Failure> {
    settings.tracker_weights.as_deref().ok_or_else(|| {
        Failure::input(
            "--tracker sam2 needs --tracker-weights FILE, a checkpoint of SAM 2.1, e.g. sam2.1_hiera_base_plus.pt",
        )
    })
}

fn ground_truth(settings: &Settings, scene: &Arc<dyn Scene>) -> Result<SceneGroundTruth, Failure> {
    SceneGroundTruth::new(Arc::clone(scene), settings.dataset.framing()).map_err(Failure::input)
}

/// Makes the segmenter of the settings for a scene: what prompts the tracker, where the method has one.
pub fn make_segmenter(settings: &Settings, scene: &Arc<dyn Scene>) -> Result<Box<dyn Segmenter>, Failure> {
    if settings.method.has_tracker() && settings.prompts == PromptSource::GroundTruth {
        let truth = ground_truth(settings, scene)?;
        return Ok(Box::new(FirstAppearances::new(truth, settings.min_segment_area)));
    }
    match settings.segmenter {
        SegmenterName::Graph => Ok(Box::new(GraphSegmenter::new(settings.graph.clone()).map_err(Failure::input)?)),
        SegmenterName::Fastsam => {
            let weights = settings.weights.as_ref().ok_or_else(|| {
                Failure::input("--segmenter fastsam needs --weights FILE, a checkpoint of FastSAM, e.g. FastSAM-x.pt")
            })?;
            let device = settings.device.open().map_err(Failure::input)?;
            let predictor = FastSamPredictor::open(weights, settings.fastsam.clone(), &device);
            Ok(Box::new(FastSamSegmenter::new(predictor.map_err(Failure::input)?)))
        }
        SegmenterName::Masks => {
            let folder = settings.masks.as_ref().ok_or_else(|| {
                Failure::input("--segmenter masks needs --masks DIR, a folder with one .png or .json file per frame")
            })?;
            Ok(Box::new(MaskFolder::open(folder, settings.dataset.framing()).map_err(Failure::input)?))
        }
        SegmenterName::Oracle => {
            let segmenter = OracleSegmenter::new(ground_truth(settings, scene)?, &settings.oracle, settings.seed);
            Ok(Box::new(segmenter.map_err(Failure::input)?))
        }
    }
}
