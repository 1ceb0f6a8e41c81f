//! Predicted depth: where it is used, and what makes it fit.
//!
//! The prediction depends on nothing but the frame, so it is made ahead, before the frame is segmented. In the holes of a
//! sensor it is fitted to what was measured around them. In place of a sensor it is fitted to the map, once it is known
//! where the camera is, about: otherwise the scale of every frame would be another one, and surfaces would be doubled.

use super::working_resolution::WorkingFrame;
use splatseg_depth::{DepthFit, DepthPredictor, DepthPredictorError, FitPrior, PredictedDepth, filled};
use splatseg_geometry::{CameraFrame, CowImage, Image, Pose, RgbdFrame};
use splatseg_memory::SplatMemory;
use splatseg_odometry::{CameraPose, PoseMode, PoseState};
use splatseg_settings::choices;

choices! {
    /// Where predicted depth is used.
    pub enum PredictedDepthUse, default Holes {
        /// Where the sensor has measured nothing, if the prediction agrees with the measurements around there.
        Holes = "holes",
        /// Everywhere, in place of measured depth.
        All = "all",
    }
}

choices! {
    /// Where the scale of a map of predicted depth is from: the first frames fix it, and the map holds it.
    pub enum MapScale, default Metres {
        /// The depth predictor returns metres.
        Metres = "predicted",
        /// The depth predictor's unit is not known: the size of the world is a guess.
        Guess = "guessed",
    }
}

/// The map is compared at this width, pixels.
const COMPARED_WIDTH: usize = 96;

/// A fit that could compare less than this share of a frame says nothing about the scale of later frames.
const MIN_COMPARED: f32 = 0.2;

/// A depth predictor, and what is known of its scale.
pub(super) struct DepthStage {
    predictor: Box<dyn DepthPredictor>,
    used: PredictedDepthUse,
    /// True if poses that come with frames are where the camera is, and not only about there or ignored.
    trusts_given: bool,
    /// The last fit that could compare enough.
    last: DepthFit,
    /// The depth of a frame whose pose is not known yet, as it was predicted.
    unfitted: Option<UnfittedDepth>,
}

impl DepthStage {
    pub(super) fn new(predictor: Box<dyn DepthPredictor>, used: PredictedDepthUse, poses: PoseMode) -> Self {
        let trusts_given = matches!(poses, PoseMode::Auto | PoseMode::Given);
        Self { predictor, used, trusts_given, last: DepthFit::of_prior(FitPrior::default()), unfitted: None }
    }

    /// True if no measured depth is used.
    pub(super) fn predicts_all(&self) -> bool {
        self.used == PredictedDepthUse::All
    }

    /// Where the map's scale is from; `None` if depth is measured.
    pub(super) fn scale(&self) -> Option<MapScale> {
        let scale = if self.predictor.knows_scale() { MapScale::Metres } else { MapScale::Guess };
        self.predicts_all().then_some(scale)
    }

    /// The frame with predicted depth.
    ///
    /// # Errors
    /// If the predictor fails.
    pub(super) fn predicted<'a>(&mut self, frame: CameraFrame<'a>) -> Result<CameraFrame<'a>, DepthPredictorError> {
        let prediction = self.predictor.predict(&frame)?.checked(self.predictor.name(), &frame)?;
        let (depth, predicted) = match self.used {
            PredictedDepthUse::Holes => match filled(frame.depth(), &prediction) {
                Some(filled) => (filled.depth, filled.predicted),
                None => return Ok(frame),
            },
            PredictedDepthUse::All => {
                let PredictedDepth { depth, .. } = prediction;
                let predicted = Image::filled(depth.width(), depth.height(), true);
                (depth, predicted)
            }
        };
        Ok(with_depth(frame, depth, predicted))
    }

    /// Makes the depth of a frame fit before its pose is known, unless one is `given`: as that of the frame before did, since
    /// a predictor's errors change slowly. A fit to the map at an expected pose would bend the depth until tracking finds that
    /// pose.
    pub(super) fn before_pose(
        &mut self,
        frame: &mut WorkingFrame<'_>,
        memory: Option<&SplatMemory>,
        given: Option<&Pose>,
    ) {
        if !self.predicts_all() {
            return;
        }
        match given.filter(|_| self.trusts_given) {
            Some(pose) => self.fit(frame, memory, pose),
            None => {
                self.unfitted = Some(UnfittedDepth::of(frame));
                frame.change_depth(|depth| self.last.apply(depth));
            }
        }
    }

    /// Fits the depth of a tracked frame to the map, where the camera is now known to be.
    pub(super) fn after_pose(&mut self, frame: &mut WorkingFrame<'_>, memory: Option<&SplatMemory>, pose: &CameraPose) {
        if let Some(unfitted) = self.unfitted.take().filter(|_| pose.state == PoseState::Tracked) {
            unfitted.restore(frame);
            self.fit(frame, memory, &pose.world_from_camera);
        }
    }

    /// Fits the depth of a frame to the map as it is seen from a pose.
    fn fit(&mut self, frame: &mut WorkingFrame<'_>, memory: Option<&SplatMemory>, pose: &Pose) {
        let prior = self.last.prior();
        let fit = match memory {
            Some(memory) => {
                let working = frame.working();
                let width = COMPARED_WIDTH.min(working.width());
                let height = (working.height() * width / working.width()).max(1);
                let known = memory.expected_depth(&working.intrinsics().resized(width, height), pose);
                DepthFit::new(working.depth(), &known, prior)
            }
            None => DepthFit::of_prior(prior),
        };
        tracing::debug!(
            compared = fit.compared,
            error = fit.error,
            scale = fit.prior().scale,
            shift = fit.prior().shift
        );
        frame.change_depth(|depth| fit.apply(depth));
        if fit.compared >= MIN_COMPARED {
            self.last = fit;
        }
    }
}

/// Depth of frames that are read again: see [`Pipeline::take_depth_again`](super::Pipeline::take_depth_again).
pub struct DepthAgain(pub(super) DepthStage);

impl DepthAgain {
    /// The frame with its holes filled.
    ///
    /// # Errors
    /// If the predictor fails.
    pub fn frame(&mut self, frame: RgbdFrame<'static>) -> Result<RgbdFrame<'static>, DepthPredictorError> {
        let pose = *frame.world_from_camera();
        Ok(self.0.predicted(frame.into_camera_frame())?.at(pose))
    }
}

/// The depth of a frame as it was predicted.
struct UnfittedDepth {
    whole: Image<f32>,
    reduced: Option<Image<f32>>,
}

impl UnfittedDepth {
    fn of(frame: &WorkingFrame<'_>) -> Self {
        let depth = |frame: &CameraFrame<'_>| frame.depth().clone().into_owned();
        Self { whole: depth(&frame.whole), reduced: frame.reduced.as_ref().map(depth) }
    }

    fn restore(self, frame: &mut WorkingFrame<'_>) {
        let restored = |frame: &CameraFrame<'_>, depth: Image<f32>| {
            let predicted = frame.predicted()?.clone().into_owned();
            frame.clone().into_owned().with_predicted_depth(depth, predicted).ok()
        };
        if let Some(whole) = restored(&frame.whole, self.whole) {
            frame.whole = whole;
        }
        if let Some((reduced, depth)) = frame.reduced.as_mut().zip(self.reduced)
            && let Some(restored) = restored(reduced, depth)
        {
            *reduced = restored;
        }
    }
}

/// A frame with other depth, whose size is that of the frame.
fn with_depth<'a>(
    frame: CameraFrame<'a>,
    depth: impl Into<CowImage<'a, f32>>,
    predicted: impl Into<CowImage<'a, bool>>,
) -> CameraFrame<'a> {
    frame.clone().with_predicted_depth(depth.into(), predicted.into()).unwrap_or(frame)
}

impl WorkingFrame<'_> {
    /// Changes the predicted depth of the frame.
    fn change_depth(&mut self, change: impl Fn(&CowImage<'_, f32>) -> Image<f32>) {
        let changed = |frame: &CameraFrame<'_>| {
            let predicted = frame.predicted()?.clone().into_owned();
            frame.clone().into_owned().with_predicted_depth(change(frame.depth()), predicted).ok()
        };
        if let Some(whole) = changed(&self.whole) {
            (self.whole, self.is_changed) = (whole, true);
        }
        if let Some(reduced) = self.reduced.as_ref().and_then(changed) {
            self.reduced = Some(reduced);
        }
    }
}
