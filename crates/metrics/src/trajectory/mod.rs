//! Errors of an estimated camera trajectory: absolute trajectory error (ATE) and relative pose error (RPE), as Sturm et
//! al. define them (IROS 2012) and as `evo` 1.38 computes them.
//!
//! `association.rs` pairs poses by time, `alignment.rs` aligns the estimate with the truth.

mod alignment;
mod association;
mod statistics;

pub use alignment::RigidAlignment;
pub use statistics::ErrorStatistics;

use crate::MetricsError;
use association::pairs_by_time;
use glam::DVec3;
use splatseg_geometry::{Pose, StampedPose};

/// Options of [`score_trajectory`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectorySettings {
    /// Maximum time between a true and an estimated pose of the same moment, seconds (`evo`: `--t_max_diff`).
    pub max_seconds_apart: f64,
    /// Number of pose pairs from the start to the end of a relative motion (`evo`: `--delta`, with unit `f`).
    pub rpe_frames: usize,
    /// Also scales the estimate, for cameras without a measured scale (`evo`: `-s`).
    pub corrects_scale: bool,
}

impl Default for TrajectorySettings {
    /// `evo`'s maximum time, and one second at 30 frames per second.
    fn default() -> Self {
        Self { max_seconds_apart: 0.01, rpe_frames: 30, corrects_scale: false }
    }
}

/// Errors of an estimated trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectoryScore {
    /// Number of pairs of a true and an estimated pose.
    pub pairs: usize,
    /// Length of the true path through the pairs, metres.
    pub path_length_m: f64,
    /// Absolute trajectory error. `None` where `evo` refuses to align the trajectories, because the positions lie on one
    /// line: with fewer than three pairs, if the camera does not move, or along a straight path.
    pub ate: Option<AbsoluteError>,
    /// The factor by which the estimate was scaled; 1 unless [`TrajectorySettings::corrects_scale`].
    pub scale: f64,
    /// Relative pose error. `None` if there are not enough pairs for one relative motion.
    pub rpe: Option<RelativeError>,
}

/// The difference between estimated and true positions. As `evo_ape -a`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AbsoluteError {
    /// The alignment of the estimate with the truth that minimises the squared distances of the positions.
    pub alignment: RigidAlignment,
    /// Distance of the estimated from the true position after the alignment, metres.
    pub distance_m: ErrorStatistics,
}

/// The difference between estimated and true relative motions. As `evo_rpe -u f --all_pairs`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeError {
    /// Number of pose pairs from the start to the end of a relative motion.
    pub frames: usize,
    /// Number of relative motions.
    pub motions: usize,
    /// Length of the translation of the difference, metres.
    pub translation_m: ErrorStatistics,
    /// Angle of the rotation of the difference, degrees. As `evo_rpe -r angle_deg`.
    pub rotation_deg: ErrorStatistics,
}

/// Compares an estimated trajectory with the true one.
///
/// Each pose of the trajectory with fewer poses (the estimate, if they have equally many) is paired with the pose
/// nearest in time of the other, as `evo` does. So a pose of the longer trajectory is in two pairs if it is nearest to
/// two of the shorter. The relative motions are those from pair `i` to pair `i + rpe_frames`, for every `i`: a gap in the
/// estimate makes some of them longer.
///
/// ```
/// use glam::{DQuat, DVec3};
/// use splatseg_geometry::{Pose, StampedPose};
/// use splatseg_metrics::{TrajectorySettings, score_trajectory};
///
/// let pose = |seconds: f64| {
///     let position = DVec3::new(seconds, seconds * seconds, 0.0);
///     Pose::from_quaternion(position, DQuat::IDENTITY).map(|pose| StampedPose { seconds, world_from_camera: pose })
/// };
/// let truth = (0..40).map(|frame| pose(f64::from(frame) / 30.0)).collect::<Result<Vec<_>, _>>()?;
/// let score = score_trajectory(&truth, &truth, &TrajectorySettings::default())?;
/// assert_eq!(score.pairs, 40);
/// assert!(score.ate.is_some_and(|ate| ate.distance_m.rmse < 1e-12));
/// assert_eq!(score.rpe.map(|rpe| rpe.motions), Some(10));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`MetricsError::NoPosePairs`].
pub fn score_trajectory(
    truth: &[StampedPose],
    estimate: &[StampedPose],
    settings: &TrajectorySettings,
) -> Result<TrajectoryScore, MetricsError> {
    let mut pairs: Vec<PosePair> = pairs_by_time(truth, estimate, settings.max_seconds_apart)
        .into_iter()
        .filter_map(|(truth_index, index)| {
            let (truth, estimate) = (truth.get(truth_index)?, estimate.get(index)?);
            Some(PosePair { truth: truth.world_from_camera, estimate: estimate.world_from_camera })
        })
        .collect();
    if pairs.is_empty() {
        let (true_poses, estimated) = (truth.len(), estimate.len());
        return Err(MetricsError::NoPosePairs {
            true_poses,
            estimated,
            true_seconds: time_range(truth),
            estimated_seconds: time_range(estimate),
            max_seconds_apart: settings.max_seconds_apart,
        });
    }
    let scale = if settings.corrects_scale { best_scale(&pairs) } else { 1.0 };
    if scale != 1.0 {
        pairs.iter_mut().for_each(|pair| pair.estimate = pair.estimate.scaled(scale));
    }
    let steps = pairs.array_windows().map(|[one, next]| one.truth.translation().distance(next.truth.translation()));
    Ok(TrajectoryScore {
        pairs: pairs.len(),
        path_length_m: steps.sum(),
        ate: absolute_error(&pairs),
        scale,
        rpe: relative_error(&pairs, settings.rpe_frames),
    })
}

/// The first and last time of poses, seconds.
fn time_range(poses: &[StampedPose]) -> Option<(f64, f64)> {
    let times = || poses.iter().map(|pose| pose.seconds);
    Some((times().reduce(f64::min)?, times().reduce(f64::max)?))
}

/// A true and an estimated pose of the same moment.
#[derive(Clone, Copy, Debug)]
struct PosePair {
    truth: Pose,
    estimate: Pose,
}

/// The factor of the estimate with which its alignment is best (Umeyama, PAMI 1991); 1 if there is none.
fn best_scale(pairs: &[PosePair]) -> f64 {
    let Some(alignment) = RigidAlignment::between(pairs) else { return 1.0 };
    let count = pairs.len() as f64;
    let truth_mean = pairs.iter().map(|pair| pair.truth.translation()).sum::<DVec3>() / count;
    let estimate_mean = pairs.iter().map(|pair| pair.estimate.translation()).sum::<DVec3>() / count;
    let (mut product, mut square) = (0.0, 0.0);
    for pair in pairs {
        let estimate = pair.estimate.translation() - estimate_mean;
        product += (pair.truth.translation() - truth_mean).dot(alignment.rotation * estimate);
        square += estimate.length_squared();
    }
    let scale = product / square;
    if scale.is_finite() && scale > 0.0 { scale } else { 1.0 }
}

fn absolute_error(pairs: &[PosePair]) -> Option<AbsoluteError> {
    let alignment = RigidAlignment::between(pairs)?;
    let distance = |pair: &PosePair| alignment.to_truth(pair.estimate.translation()).distance(pair.truth.translation());
    Some(AbsoluteError { alignment, distance_m: ErrorStatistics::of(pairs.iter().map(distance).collect()) })
}

fn relative_error(pairs: &[PosePair], frames: usize) -> Option<RelativeError> {
    let ends = pairs.get(frames..).filter(|ends| !ends.is_empty())?;
    let differences = pairs.iter().zip(ends).map(|(start, end)| {
        let true_motion = start.truth.inverse() * end.truth;
        let estimated_motion = start.estimate.inverse() * end.estimate;
        true_motion.inverse() * estimated_motion
    });
    let (translations, angles): (Vec<f64>, Vec<f64>) =
        differences.map(|difference| (difference.translation().length(), angle_deg(&difference))).unzip();
    Some(RelativeError {
        frames,
        motions: ends.len(),
        translation_m: ErrorStatistics::of(translations),
        rotation_deg: ErrorStatistics::of(angles),
    })
}

/// The angle of a pose's rotation, degrees, from 0 to 180.
fn angle_deg(pose: &Pose) -> f64 {
    let turn = glam::DQuat::from_mat3(&pose.rotation());
    // Unlike the arc cosine, the arc tangent is accurate for small angles.
    (2.0 * turn.xyz().length().atan2(turn.w.abs())).to_degrees()
}
