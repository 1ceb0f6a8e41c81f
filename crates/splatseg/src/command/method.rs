//! Methods and segmenters as settings ask for them.

use super::Failure;
use indicatif::ProgressBar;
use splatseg::settings::{MethodName, SegmenterName, Settings};
use splatseg_dataset::Scene;
use splatseg_memory::SplatMemory;
use splatseg_models::fastsam::FastSamPredictor;
use splatseg_segmenter::{
    FastSamSegmenter, FrameTransform, GraphSegmenter, MaskFolder, OracleSegmenter, SceneGroundTruth, Segmenter,
};
use splatseg_tracking::{FastSam, FastSamSplat, FastSpam, Method};
use std::path::Path;
use std::sync::Arc;

/// Where a method's memory comes from.
pub enum Memory<'a> {
    /// A new one; the bar shows how far its codebook is.
    New(&'a ProgressBar),
    /// One that an earlier run saved.
    Saved(&'a Path),
}

/// Makes the method of the settings, over a segmenter.
pub fn make_method(
    settings: &Settings,
    segmenter: Box<dyn Segmenter>,
    memory: &Memory,
) -> Result<Box<dyn Method>, Failure> {
    match settings.method {
        MethodName::FastsamSplat => {
            let memory = match memory {
                Memory::Saved(path) => SplatMemory::load(path, settings.memory.clone()).map_err(Failure::input)?,
                Memory::New(bar) => new_memory(settings, bar)?,
            };
            let method = FastSamSplat::with_memory(segmenter, settings.fastsam_splat(), memory);
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

fn new_memory(settings: &Settings, bar: &ProgressBar) -> Result<SplatMemory, Failure> {
    let mut progress = |fraction: f32| bar.set_position((fraction * 100.0) as u64);
    let memory = SplatMemory::new(settings.memory.clone(), settings.seed, &mut progress).map_err(Failure::input);
    bar.finish_and_clear();
    memory
}

/// Makes the segmenter of the settings for a scene.
pub fn make_segmenter(settings: &Settings, scene: &Arc<dyn Scene>) -> Result<Box<dyn Segmenter>, Failure> {
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
            let transform = FrameTransform {
                resize: settings.dataset.resize.map(|size| (size.width, size.height)),
                crop_border: settings.dataset.crop_border,
            };
            Ok(Box::new(MaskFolder::open(folder, transform).map_err(Failure::input)?))
        }
        SegmenterName::Oracle => {
            let truth = SceneGroundTruth::new(Arc::clone(scene), settings.dataset.framing()).map_err(Failure::input)?;
            let segmenter = OracleSegmenter::new(truth, &settings.oracle, settings.seed);
            Ok(Box::new(segmenter.map_err(Failure::input)?))
        }
    }
}
