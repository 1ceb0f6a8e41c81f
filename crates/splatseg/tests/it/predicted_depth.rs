//! Depth that is predicted from colour: fitted to the map, or in the holes of measured depth.

use splatseg::dataset::{FrameStream, GroundTruth, Scene};
use splatseg::depth::{DepthPredictor, DepthPredictorError, PredictedDepth};
use splatseg::geometry::{CameraFrame, Image, RgbdFrame};
use splatseg::pipeline::PredictedDepthUse;
use splatseg::{FrameResult, Pipeline, Settings};
use splatseg_test_scenes::room;
use std::sync::Arc;

const FRAMES: usize = 12;

fn scene() -> Arc<dyn Scene> {
    Arc::new(room(&format!("synthetic:frames={FRAMES},width=160,height=120")))
}

fn frames() -> Vec<RgbdFrame<'static>> {
    let scene = scene();
    (0..FRAMES).map(|index| scene.read_frame(index).unwrap()).collect()
}

/// Measured depth of another scale in every frame, bent.
struct Bent {
    frame: usize,
}

impl Bent {
    fn factor(frame: usize, column: usize, row: usize) -> f32 {
        let bend = 0.05 * (column as f32 / 40.0 + frame as f32 * 0.2).sin() + 0.04 * (row as f32 / 30.0).cos();
        // The first frame has the right scale.
        (bend + 0.3 * (frame as f32 * 0.7).sin()).exp()
    }
}

impl DepthPredictor for Bent {
    fn name(&self) -> &str {
        "bent"
    }

    fn predict(&mut self, frame: &CameraFrame<'_>) -> Result<PredictedDepth, DepthPredictorError> {
        let depth = Image::from_fn(frame.width(), frame.height(), |column, row| {
            frame.depth()[(column, row)] * Self::factor(self.frame, column, row)
        });
        self.frame += 1;
        Ok(PredictedDepth { depth, confidence: None })
    }
}

fn settings(text: &str) -> Settings {
    toml::from_str(text).unwrap()
}

fn results(mut pipeline: Pipeline) -> (Vec<FrameResult>, usize) {
    let results = frames().iter().map(|frame| pipeline.step(frame).unwrap()).collect();
    let gaussians = pipeline.map().unwrap().gaussian_count();
    (results, gaussians)
}

#[test]
fn predictions_of_wandering_scale_are_fitted_to_the_map() {
    let (_, measured) = results(Pipeline::builder(&settings("")).build().unwrap());
    let bent = Box::new(Bent { frame: 0 });
    let fitted = Pipeline::builder(&settings("")).depth_predictor(bent, PredictedDepthUse::All).build().unwrap();
    let (_, fitted) = results(fitted);
    // Surfaces that do not fit are added again: without the fit there are more than twice as many.
    assert!(fitted < measured * 13 / 10, "{fitted} Gaussians instead of {measured}");
}

#[test]
fn results_do_not_depend_on_what_is_done_ahead() {
    let run = |ahead: bool| {
        let settings =
            settings(&format!("predicted_depth = \"all\"\ndepth_predictor = \"sim\"\nsegment_ahead = {ahead}"));
        let mut pipeline = Pipeline::builder(&settings).build().unwrap();
        let stream = FrameStream::open(scene(), &settings.dataset, GroundTruth::Skip);
        let frames = pipeline.run(stream.unwrap()).map(|processed| processed.unwrap());
        frames.map(|processed| (processed.frame, processed.result.unwrap().output.segments)).collect::<Vec<_>>()
    };
    let (ahead, after) = (run(true), run(false));
    assert_eq!(ahead.len(), FRAMES);
    assert!(ahead == after);
    assert!(ahead.iter().all(|(frame, _)| frame.predicted().is_some_and(|mask| mask.pixels().iter().all(|one| *one))));
}

/// The depth of a hole, and nothing else right.
struct Filler(Image<f32>);

impl DepthPredictor for Filler {
    fn name(&self) -> &str {
        "filler"
    }

    fn predict(&mut self, _: &CameraFrame<'_>) -> Result<PredictedDepth, DepthPredictorError> {
        Ok(PredictedDepth { depth: self.0.clone(), confidence: None })
    }
}

#[test]
fn holes_are_filled_and_the_rest_stays_as_measured() {
    let whole = frames().swap_remove(0);
    let is_hole = |column: usize, row: usize| (60..90).contains(&column) && (40..80).contains(&row);
    let depth =
        Image::from_fn(160, 120, |column, row| if is_hole(column, row) { 0.0 } else { whole.depth()[(column, row)] });
    let (color, pose) = (whole.color().clone(), *whole.world_from_camera());
    let frame = RgbdFrame::new("0", color, depth, *whole.intrinsics(), pose).unwrap();
    let gaussians_with = |predictor: Option<Image<f32>>| {
        let settings = Settings::default();
        let mut builder = Pipeline::builder(&settings);
        if let Some(depth) = predictor {
            builder = builder.depth_predictor(Box::new(Filler(depth)), PredictedDepthUse::Holes);
        }
        let mut pipeline = builder.build().unwrap();
        pipeline.step(&frame).unwrap();
        pipeline.map().unwrap().gaussian_count()
    };
    let without = gaussians_with(None);
    let scaled = whole.depth().map(|depth| 1.3 * depth);
    assert!(gaussians_with(Some(scaled)) > without);
    // A prediction that contradicts the sensor is not used.
    let wrong = Image::from_fn(160, 120, |column, row| 1.0 + ((column * 7 + row * 13) % 17) as f32 * 0.2);
    assert_eq!(gaussians_with(Some(wrong)), without);
}

#[test]
fn a_prediction_of_another_size_is_an_error_that_names_the_predictor() {
    let settings = Settings::default();
    let filler = Box::new(Filler(Image::filled(8, 6, 1.0)));
    let mut pipeline = Pipeline::builder(&settings).depth_predictor(filler, PredictedDepthUse::All).build().unwrap();
    let error = pipeline.step(&frames()[0]).unwrap_err().to_string();
    assert!(error.contains("filler") && error.contains("8x6") && error.contains("160x120"), "{error}");
}
