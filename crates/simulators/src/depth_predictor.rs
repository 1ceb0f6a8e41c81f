//! A simulated depth predictor: measured depth with the errors that networks make.
//!
//! Published networks for metric indoor depth have mean relative errors of 5 to 10 % (NYU Depth v2; Depth Anything V2:
//! Yang et al., NeurIPS 2024). Within an image the error is smooth; from frame to frame the scale wanders; edges are
//! blurred. Where nothing was measured within a few pixels, nothing is predicted, as the truth is not known there: unless
//! another scene of the same frames has it. All errors are drawn from the seed and depend on the time of the frame alone.

use crate::{Chance, SimulatorError, normal};
use rayon::prelude::*;
use splatseg_dataset::{Framing, Scene};
use splatseg_depth::{DepthPredictor, DepthPredictorError, PredictedDepth};
use splatseg_geometry::{CameraFrame, CowImage, Image};
use splatseg_settings::{Allowed, settings};
use std::collections::HashMap;
use std::sync::Arc;

settings! {
    /// The error model of [`SimDepthPredictor`]. Lengths are pixels of an image 320 pixels wide.
    #[derive(Copy)]
    pub struct SimDepthSettings in "sim_depth" {
        /// Mean relative error within an image, smooth.
        error: f64 = 0.07, Allowed::between(0.0, 0.5);
        /// Typical change of the scale in a second, relative.
        drift: f64 = 0.05, Allowed::between(0.0, 0.5);
        /// Width to which an edge of depth is blurred, pixels.
        blur_px: f64 = 3.0, Allowed::between(0.0, 50.0);
        /// Constant factor of the scale.
        scale: f64 = 1.0, Allowed::between(0.01, 100.0);
    }
}

/// Frames without a time are this far apart, by the numbers in their names.
const FRAMES_PER_SECOND: f64 = 30.0;

/// Columns and rows of the grid of errors within an image.
const COLUMNS: usize = 5;
const ROWS: usize = 4;

/// Holes of up to 2 to the power of this many pixels are filled.
const FILLED_HALVINGS: usize = 3;

/// Mean of the absolute value of a normal distribution, per deviation.
const MEAN_OF_NORMAL: f64 = 0.798;

/// Kinds of random numbers.
#[derive(Clone, Copy)]
enum Drawn {
    Error,
    Drift,
}

impl From<Drawn> for u64 {
    fn from(drawn: Drawn) -> Self {
        // Beyond the numbers of the oracle's and the tracker's decisions.
        700 + drawn as Self
    }
}

/// A predictor that returns a frame's own depth with the errors of a network, or that of another scene. Small holes are
/// filled from what is around them.
#[derive(Clone, Debug)]
pub struct SimDepthPredictor {
    settings: SimDepthSettings,
    chance: Chance,
    truth: Option<TrueDepth>,
}

/// The depth of a scene, looked up by frame name.
#[derive(Clone, Debug)]
struct TrueDepth {
    scene: Arc<dyn Scene>,
    framing: Framing,
    index_of_name: HashMap<String, usize>,
}

impl TrueDepth {
    /// The depth of a frame, metres.
    fn of(&self, frame: &CameraFrame<'_>) -> Result<CowImage<'static, f32>, SimulatorError> {
        let name = frame.name().to_owned();
        let index = self.index_of_name.get(frame.name());
        let index = *index
            .ok_or_else(|| SimulatorError::NoTrueDepth { scene: self.scene.name().to_owned(), frame: name.clone() })?;
        let read = self.scene.read_recorded(index).and_then(|read| self.framing.apply(read.frame));
        let read = read.map_err(|source| SimulatorError::GroundTruth { frame: name, source: Box::new(source) })?;
        let (found, expected) = ((read.width(), read.height()), (frame.width(), frame.height()));
        if found != expected {
            return Err(SimulatorError::TrueDepthSize { frame: frame.name().to_owned(), found, expected });
        }
        Ok(read.depth().clone())
    }
}

impl SimDepthPredictor {
    /// Creates a predictor whose errors are drawn from `seed`.
    pub fn new(settings: SimDepthSettings, seed: u64) -> Self {
        Self { settings, chance: Chance { seed }, truth: None }
    }

    /// Takes the depth of `scene` instead of the frames' own: of the frames with the same names, which are resized and
    /// cropped by `framing`. So it is known what the depth is where a sensor has holes.
    #[must_use]
    pub fn with_truth(mut self, scene: Arc<dyn Scene>, framing: Framing) -> Self {
        let index_of_name = (0..scene.frame_count()).map(|index| (scene.frame_name(index), index)).collect();
        self.truth = Some(TrueDepth { scene, framing, index_of_name });
        self
    }

    /// Checks that the scene of [`Self::with_truth`] has the true depth of the frames of `scene`, by their indices: all their
    /// names, and the size of the first. Reads one frame of each scene. Without such a scene, `scene` itself must have depth.
    ///
    /// # Errors
    /// [`SimulatorError`] names the first frame that does not fit.
    pub fn check_truth(&self, scene: &dyn Scene, frames: &[usize]) -> Result<(), SimulatorError> {
        let name_of = |scene: &dyn Scene| scene.name().to_owned();
        let Some(truth) = &self.truth else {
            return if scene.has_depth() {
                Ok(())
            } else {
                Err(SimulatorError::NothingToDistort { scene: name_of(scene) })
            };
        };
        if !truth.scene.has_depth() {
            return Err(SimulatorError::NoDepthInScene { scene: name_of(truth.scene.as_ref()) });
        }
        let mut names = frames.iter().map(|index| scene.frame_name(*index));
        if let Some(frame) = names.find(|name| !truth.index_of_name.contains_key(name)) {
            return Err(SimulatorError::NoTrueDepth { scene: name_of(truth.scene.as_ref()), frame });
        }
        // A frame that cannot be read is left out of a run.
        let first = frames.iter().find_map(|index| scene.read_recorded(*index).ok());
        match first.and_then(|first| truth.framing.apply(first.frame).ok()) {
            Some(frame) => truth.of(&frame).map(drop),
            None => Ok(()),
        }
    }

    /// A number with a standard normal distribution that changes smoothly, within about a second.
    fn wandering(&self, drawn: Drawn, number: usize, seconds: f64) -> f64 {
        let second = seconds.floor();
        let share = seconds - second;
        let at = |second: f64| {
            let key = (second.rem_euclid(f64::from(1 << 20)) as u32) << 6 | number as u32;
            f64::from(normal(&mut self.chance.of_object(drawn, key)))
        };
        let (before, after) = (at(second), at(second + 1.0));
        let mixed = before * (1.0 - share) + after * share;
        mixed / ((1.0 - share) * (1.0 - share) + share * share).sqrt()
    }

    /// The factor of the depth at each value of the grid.
    fn factors(&self, seconds: f64) -> [f64; COLUMNS * ROWS] {
        let SimDepthSettings { error, drift, scale, .. } = self.settings;
        let deviation = error / MEAN_OF_NORMAL;
        // The difference of two independent numbers has a mean of 1.13 deviations.
        let common = self.wandering(Drawn::Drift, 0, seconds) * drift / 1.13;
        std::array::from_fn(|number| scale * (common + deviation * self.wandering(Drawn::Error, number, seconds)).exp())
    }
}

impl DepthPredictor for SimDepthPredictor {
    fn name(&self) -> &str {
        "sim"
    }

    fn predict(&mut self, frame: &CameraFrame<'_>) -> Result<PredictedDepth, DepthPredictorError> {
        let (width, height) = (frame.width(), frame.height());
        let factors = self.factors(seconds(frame));
        let radius = self.settings.blur_px * width as f64 / 640.0;
        let failed = |error| DepthPredictorError::Other { name: "sim".to_owned(), source: Box::new(error) };
        let truth = self.truth.as_ref().map(|truth| truth.of(frame)).transpose().map_err(failed)?;
        let depth = truth.as_ref().unwrap_or(frame.depth());
        let inverse = without_holes(&depth.map(|depth| if *depth > 0.0 { 1.0 / depth } else { 0.0 }), FILLED_HALVINGS);
        let inverse = blurred(&inverse, radius.round() as usize);
        let depth = Image::from_fn(width, height, |column, row| {
            let inverse = inverse[(column, row)];
            let factor = interpolated(&factors, column as f64 / width as f64, row as f64 / height as f64);
            if inverse > 0.0 { factor as f32 / inverse } else { 0.0 }
        });
        Ok(PredictedDepth { depth, confidence: None })
    }
}

/// The time of a frame: its timestamp, or the last number in its name.
fn seconds(frame: &CameraFrame<'_>) -> f64 {
    if let Some(time) = frame.timestamp() {
        return time.as_secs_f64();
    }
    let digits = frame.name().rsplit(|letter: char| !letter.is_ascii_digit()).find(|digits| !digits.is_empty());
    digits.and_then(|digits| digits.parse::<f64>().ok()).unwrap_or(0.0) / FRAMES_PER_SECOND
}

/// The grid's value at a place; shares of the width and the height, 0 to 1.
fn interpolated(values: &[f64; COLUMNS * ROWS], across: f64, down: f64) -> f64 {
    let along = |share: f64, count: usize| {
        let place = share * (count - 1) as f64;
        let index = (place as usize).min(count - 2);
        let share = place - index as f64;
        // Smooth at the grid's lines.
        (index, share * share * (3.0 - 2.0 * share))
    };
    let ((column, x), (row, y)) = (along(across, COLUMNS), along(down, ROWS));
    let at = |column: usize, row: usize| values[row * COLUMNS + column];
    let upper = at(column, row) * (1.0 - x) + at(column + 1, row) * x;
    let lower = at(column, row + 1) * (1.0 - x) + at(column + 1, row + 1) * x;
    upper * (1.0 - y) + lower * y
}

/// Fills zeros with the mean of what is around them: from half the resolution, where holes are smaller, `halvings` times.
fn without_holes(values: &Image<f32>, halvings: usize) -> Image<f32> {
    let (width, height) = values.size();
    if halvings == 0 || values.pixels().iter().all(|value| *value > 0.0) || width * height == 1 {
        return values.clone();
    }
    let half = Image::from_fn(width.div_ceil(2), height.div_ceil(2), |column, row| {
        let block = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| (2 * column + x, 2 * row + y));
        let inside = block.into_iter().filter(|(column, row)| *column < width && *row < height);
        let (sum, count) = inside
            .map(|at| values[at])
            .filter(|value| *value > 0.0)
            .fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
        if count > 0.0 { sum / count } else { 0.0 }
    });
    let half = without_holes(&half, halvings - 1);
    Image::from_fn(width, height, |column, row| match values[(column, row)] {
        value if value > 0.0 => value,
        _ => half[(column / 2, row / 2)],
    })
}

/// Means over a square of what is not zero, along rows and then along columns. Zeros stay.
fn blurred(values: &Image<f32>, radius: usize) -> Image<f32> {
    if radius == 0 {
        return values.clone();
    }
    let across = mean_along_rows(values, radius);
    let (width, height) = values.size();
    let turned = Image::from_fn(height, width, |column, row| across[(row, column)]);
    let down = mean_along_rows(&turned, radius);
    Image::from_fn(width, height, |column, row| down[(row, column)])
}

fn mean_along_rows(values: &CowImage<'_, f32>, radius: usize) -> Image<f32> {
    let (width, height) = values.size();
    let mut result = Image::filled(width, height, 0.0f32);
    result.pixels_mut().par_chunks_mut(width).enumerate().for_each(|(row, result)| {
        let values = values.row(row);
        for (column, mean) in result.iter_mut().enumerate() {
            if values[column] > 0.0 {
                let window = &values[column.saturating_sub(radius)..(column + radius + 1).min(width)];
                let known = window.iter().filter(|value| **value > 0.0);
                let (sum, count) = known.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
                *mean = sum / count;
            }
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use splatseg_geometry::Intrinsics;
    use std::time::Duration;

    const SIZE: (usize, usize) = (160, 120);

    fn frame(milliseconds: u64) -> CameraFrame<'static> {
        let (width, height) = SIZE;
        let intrinsics = Intrinsics { fx: 150.0, fy: 150.0, cx: 79.5, cy: 59.5, width, height };
        let depth = Image::from_fn(width, height, |column, row| match () {
            () if (10..14).contains(&column) => 0.0,
            () if (60..100).contains(&column) && row > 50 => 1.0,
            () => 2.5,
        });
        let frame = CameraFrame::new("7", Image::filled(width, height, [90; 3]), depth, intrinsics).unwrap();
        frame.with_timestamp(Duration::from_millis(milliseconds))
    }

    /// Ratios of predicted and true depth, away from the edges of depth.
    fn ratios(settings: SimDepthSettings, milliseconds: u64) -> Vec<f64> {
        let frame = frame(milliseconds);
        let found = SimDepthPredictor::new(settings, 3).predict(&frame).unwrap().depth;
        let flat = (0..40).flat_map(|row| (16..160).map(move |column| (column, row)));
        flat.map(|at| f64::from(found[at] / frame.depth()[at])).collect()
    }

    #[test]
    fn errors_have_the_size_of_the_settings() {
        let mean = |settings: SimDepthSettings| {
            let errors: Vec<f64> = (0..60).flat_map(|second| ratios(settings, 1000 * second)).collect();
            errors.iter().map(|ratio| (ratio - 1.0).abs()).sum::<f64>() / errors.len() as f64
        };
        let error = mean(SimDepthSettings { drift: 0.0, ..SimDepthSettings::default() });
        assert!((0.05..0.085).contains(&error), "{error}");
        let none = SimDepthSettings { error: 0.0, drift: 0.0, blur_px: 0.0, ..SimDepthSettings::default() };
        assert!(mean(none) < 1e-6);
    }

    #[test]
    fn the_scale_wanders_slowly() {
        let settings = SimDepthSettings { error: 0.0, ..SimDepthSettings::default() };
        let scales: Vec<f64> = (0..60 * 30).map(|frame| ratios(settings, frame * 1000 / 30)[0]).collect();
        let mean_change = |step: usize| {
            let pairs = scales.iter().zip(&scales[step..]);
            pairs.map(|(before, after)| (after / before).ln().abs()).sum::<f64>() / (scales.len() - step) as f64
        };
        assert!((0.03..0.07).contains(&mean_change(30)), "{}", mean_change(30));
        assert!(mean_change(1) < 0.006, "{}", mean_change(1));
    }

    #[test]
    fn the_depth_of_another_scene_is_distorted_instead() {
        let scene: Arc<dyn Scene> = Arc::new(splatseg_test_scenes::room("synthetic:frames=2,width=64,height=48"));
        let exact = SimDepthSettings { error: 0.0, drift: 0.0, blur_px: 0.0, ..SimDepthSettings::default() };
        let mut predictor = SimDepthPredictor::new(exact, 3).with_truth(Arc::clone(&scene), Framing::default());
        for index in 0..2 {
            let whole = scene.read_recorded(index).unwrap().frame;
            let blind = Image::filled(64, 48, 0.0);
            let blind = CameraFrame::new(whole.name(), whole.color().clone(), blind, *whole.intrinsics()).unwrap();
            let found = predictor.predict(&blind).unwrap().depth;
            let pairs = found.pixels().iter().zip(whole.depth().pixels());
            assert!(pairs.filter(|(_, truth)| **truth > 0.0).all(|(found, truth)| (found / truth - 1.0).abs() < 1e-6));
        }
        let error = predictor.predict(&frame(0)).unwrap_err().to_string();
        assert!(error.contains("has no frame 7"), "{error}");
    }

    #[test]
    fn a_scene_whose_true_depth_does_not_fit_is_refused_before_the_first_frame() {
        let scene = |text: &str| -> Arc<dyn Scene> { Arc::new(splatseg_test_scenes::room(text)) };
        let (frames, truth) = (scene("synthetic:frames=4,width=64,height=48"), Framing::default());
        let check = |text: &str, used: &[usize]| {
            let predictor = SimDepthPredictor::new(SimDepthSettings::default(), 3).with_truth(scene(text), truth);
            predictor.check_truth(frames.as_ref(), used).map_err(|error| error.to_string())
        };
        let shorter = "synthetic:frames=2,width=64,height=48";
        assert_eq!(check(shorter, &[0, 1]), Ok(()));
        let error = check(shorter, &[1, 3]).unwrap_err();
        assert!(error.contains(&format!("has no frame {}", frames.frame_name(3))), "{error}");
        let error = check("synthetic:frames=4,width=32,height=24", &[0]).unwrap_err();
        assert!(error.contains("32x24") && error.contains("64x48"), "{error}");
    }

    #[test]
    fn holes_are_filled_and_edges_blurred() {
        let found = SimDepthPredictor::new(SimDepthSettings::default(), 3).predict(&frame(0)).unwrap().depth;
        assert!(found.pixels().iter().all(|depth| *depth > 0.0));
        let sharp = SimDepthSettings { blur_px: 0.0, error: 0.0, drift: 0.0, ..SimDepthSettings::default() };
        let blurred = SimDepthSettings { blur_px: 8.0, ..sharp };
        let at_edge = |settings| SimDepthPredictor::new(settings, 3).predict(&frame(0)).unwrap().depth[(59, 90)];
        assert_eq!(at_edge(sharp), 2.5);
        assert!((1.2..2.2).contains(&at_edge(blurred)), "{}", at_edge(blurred));
    }
}
