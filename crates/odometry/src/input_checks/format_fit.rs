//! How well given poses, read in different ways, explain the motion that images show.

use super::seen_motion::{SeenMotion, image_motion};
use crate::se3;
use splatseg_geometry::{CameraAxes, Pose, PoseFormat};

/// An error counts as at most this many times the motion: an absurd reading counts as much as a wrong one.
const MAX_ERROR: f64 = 2.0;

/// A reading is preferred to one with more deviations from the usual if their errors differ by less than this per
/// deviation.
const SIMPLER: f64 = 0.02;

/// The ratio of lengths is measured by translations that move surfaces in the image by at least this, radians...
const MIN_TRANSLATION: f64 = 0.01;
/// ...if seen and given translation point about the same way: cosine of the angle between them.
const MIN_COSINE: f64 = 0.7;
/// It needs this many pairs...
const MIN_RATIOS: usize = 3;
/// ...and three quarters of the ratios must be within this factor of their median.
const RATIO_SPREAD: f64 = 1.35;

/// Two frames with given poses whose motion has been seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pair {
    /// The given poses as they were stated, the earlier one first.
    pub(super) stated: [Pose; 2],
    pub(super) seen: SeenMotion,
}

/// How well one way of reading the poses explains the motion of several pairs.
#[derive(Clone, Debug)]
pub(super) struct FormatFit {
    pub(super) format: PoseFormat,
    /// Unexplained share of the motion: 0 for a perfect fit, about 1 for poses that stand still.
    pub(super) error: f64,
    /// The same for rotations alone.
    pub(super) rotation_error: f64,
    /// Length of the seen translations per length of the given ones, if it is about the same in most pairs.
    pub(super) ratio: Option<f64>,
    /// Unexplained motion of each pair, radians.
    pub(super) pair_errors: Vec<f64>,
}

/// Motion between the poses of a pair, read in one way.
pub(super) fn motion(stated: &[Pose; 2], format: &PoseFormat) -> Pose {
    let [earlier, later] = stated.map(|stated| format.pose(&stated));
    earlier.inverse() * later
}

/// All ways of reading poses, in the same unit of length.
pub(super) fn formats(scale: f64) -> impl Iterator<Item = PoseFormat> {
    let orders = [(false, false), (false, true), (true, false), (true, true)];
    CameraAxes::ALL
        .into_iter()
        .flat_map(move |axes| orders.map(move |(w_first, is_inverse)| PoseFormat { w_first, scale, is_inverse, axes }))
}

impl FormatFit {
    pub(super) fn new(pairs: &[Pair], format: PoseFormat) -> Self {
        let motions: Vec<Pose> = pairs.iter().map(|pair| motion(&pair.stated, &format)).collect();
        let total: f64 = pairs.iter().map(|pair| pair.seen.size()).sum();
        let pair_errors: Vec<f64> = pairs.iter().zip(&motions).map(|(pair, motion)| pair.error(motion)).collect();
        let rotations = pairs.iter().zip(&motions).map(|(pair, motion)| pair.turned_from(motion));
        let turned: f64 = pairs.iter().map(|pair| se3::size(&pair.seen.motion).1).sum();
        Self {
            format,
            error: pair_errors.iter().sum::<f64>() / total,
            rotation_error: rotations.sum::<f64>() / turned.max(0.2 * total),
            ratio: ratio(pairs, &motions),
            pair_errors,
        }
    }

    /// The same reading with positions in the unit that fits best.
    pub(super) fn with_fitted_unit(&self, pairs: &[Pair]) -> Option<Self> {
        let scale = self.format.scale * self.ratio?;
        Some(Self::new(pairs, PoseFormat { scale, ..self.format }))
    }

    /// The error, a little higher for each deviation from the usual.
    pub(super) fn rank(&self) -> f64 {
        let PoseFormat { w_first, scale, is_inverse, axes } = self.format;
        let unusual_axes = match axes {
            CameraAxes::Optical => 0,
            CameraAxes::OpenGl | CameraAxes::Forward => 1,
            CameraAxes::ForwardDown => 2,
        };
        let deviations = u8::from(w_first) + u8::from(is_inverse) + 2 * u8::from(scale != 1.0) + unusual_axes;
        self.error + SIMPLER * f64::from(deviations)
    }
}

impl SeenMotion {
    /// How far surfaces move in the image, radians.
    pub(super) fn size(&self) -> f64 {
        image_motion(&self.motion, self.depth)
    }
}

impl Pair {
    /// How far the given motion is from the seen one in the image, radians.
    fn error(&self, given: &Pose) -> f64 {
        let apart = given.translation().distance(self.seen.motion.translation()) / self.seen.depth;
        (self.turned_from(given) + apart).min(MAX_ERROR * self.seen.size())
    }

    /// Angle between the given rotation and the seen one, at most twice the motion.
    fn turned_from(&self, given: &Pose) -> f64 {
        se3::size(&(given.inverse() * self.seen.motion)).1.min(MAX_ERROR * self.seen.size())
    }
}

/// Length of seen translations per length of given ones.
fn ratio(pairs: &[Pair], motions: &[Pose]) -> Option<f64> {
    let of_pair = |(pair, given): (&Pair, &Pose)| {
        let (seen, given) = (pair.seen.motion.translation(), given.translation());
        let product = seen.length() * given.length();
        let agrees = seen.length() >= MIN_TRANSLATION * pair.seen.depth && seen.dot(given) >= MIN_COSINE * product;
        (agrees && product > 0.0).then(|| seen.length() / given.length())
    };
    let mut ratios: Vec<f64> = pairs.iter().zip(motions).filter_map(of_pair).collect();
    let far_enough = |pair: &&Pair| pair.seen.motion.translation().length() >= MIN_TRANSLATION * pair.seen.depth;
    let translated = pairs.iter().filter(far_enough).count();
    ratios.sort_by(f64::total_cmp);
    let median = *ratios.get(ratios.len() / 2)?;
    let near = |ratio: &&f64| **ratio < median * RATIO_SPREAD && **ratio * RATIO_SPREAD > median;
    let agreeing = ratios.iter().filter(near).count();
    (agreeing >= MIN_RATIOS && 4 * agreeing >= 3 * translated && median.is_normal()).then_some(median)
}
