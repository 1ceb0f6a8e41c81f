//! Alignment of a frame with a keyframe at one resolution: geometry and image in one 6×6 system.
//!
//! The unknown is the pose of the camera in the keyframe's coordinates, `key_from_camera`. It is updated from the left,
//! `exp(ξ) · key_from_camera`. For a reference point q with normal n, projected to pixel u of the frame, whose
//! measurement there is p (in keyframe coordinates):
//!
//! - geometry: r = n · (p − q), with the derivative [n, p × n];
//! - image: r = I(u) − (gain · I_q + offset), with the derivative −[g, q × g], where g is the keyframe's image gradient
//!   with respect to q (inverse compositional: it is computed once per keyframe).
//!
//! Both have weights from a t-distribution with [`FREEDOM`] degrees of freedom, as in DVO (Kerl, Sturm and Cremers, IROS
//! 2013). The prior is a Gaussian around the pose that the motion model predicts.

use crate::linear::{Eigen, Matrix6};
use crate::prior::{MotionPrior, scaled, unscaled};
use crate::pyramid::Level;
use crate::reference::ReferencePoint;
use crate::se3::{self, Twist};
use crate::sums::{BLOCK, Counts, Sums};
use glam::{DVec3, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use splatseg_geometry::{Cholesky, LocalPose, Pose};
use std::collections::BTreeMap;

/// Degrees of freedom of the t-distribution.
const FREEDOM: f32 = 5.0;

/// Neighbouring residuals have the same errors, so a thousand of them say less than a thousand independent ones: each
/// counts as this fraction of one. The first is of geometry, whose errors (the sensor's distortion) are correlated over
/// larger parts of the image than the image's.
const INDEPENDENT: [f32; 2] = [0.016, 0.05];

/// Directions of motion in which the measurements have less information than this, 1/m², keep the prediction: along a
/// wall or a corridor, what little there is comes from errors. It corresponds to a deviation of 4.5 cm.
const WEAK_INFORMATION: f64 = 500.0;

/// Depth that is better than a Kinect's counts for more, up to this share of the Kinect's deviation.
const MIN_DISTANCE_SCALE: f32 = 0.25;

/// Smallest standard deviation of the luminance that is believed, on the scale of 0 to 255.
const MIN_GREY_DEVIATION: f32 = 2.0;

/// A measurement farther from the reference plane than this many standard deviations, or than [`GATE_METRES`] if that is
/// more, is of another surface.
const GATE: f32 = 6.0;

/// See [`GATE`]; by level from the finest, the last one for all coarser levels.
const GATE_METRES: [f32; 4] = [0.02, 0.04, 0.08, 0.15];

/// Standard deviation of a normal distribution per median of its absolute values.
const TO_DEVIATION: f32 = 1.4826;

/// Bins of the histograms per unit of the sensor's deviation, and per unit of luminance.
const DISTANCE_BINS: f32 = 16.0;
const GREY_BINS: f32 = 4.0;

/// Limits of the gain between two images' luminance.
const GAIN: (f32, f32) = (0.6, 1.6);

/// An alignment at one resolution: fixed inputs.
pub(crate) struct Alignment<'a> {
    /// Points of the keyframe.
    pub(crate) points: &'a [ReferencePoint],
    /// The frame.
    pub(crate) frame: &'a Level,
    /// Number of the level, 0 for the finest.
    pub(crate) number: usize,
    /// False if the frame's image shows nothing.
    pub(crate) uses_image: bool,
    /// The predicted pose.
    pub(crate) prior: &'a MotionPrior,
}

/// Deviations of the residuals, and the change of exposure. Each iteration uses the values of the one before.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scales {
    /// Deviation of the distances to the planes, in units of the expected deviation, that of a Kinect.
    pub(crate) distance: f32,
    /// Deviation of the luminance.
    pub(crate) grey: f32,
    pub(crate) gain: f32,
    pub(crate) offset: f32,
}

/// The fit of a pose, with the sums over all points.
pub(crate) struct Fit {
    pub(crate) hessian: Matrix6,
    gradient: Twist,
    pub(crate) counts: Counts,
    scales: Scales,
}

impl Default for Scales {
    fn default() -> Self {
        Self { distance: 2.0, grey: 12.0, gain: 1.0, offset: 0.0 }
    }
}

impl Alignment<'_> {
    /// Improves a pose by up to `iterations` Gauss-Newton steps. Returns the pose and the fit before the last step.
    pub(crate) fn align(
        &self,
        mut key_from_camera: Pose,
        scales: &mut Scales,
        iterations: usize,
    ) -> (Pose, Option<Fit>) {
        let mut last = None;
        for _ in 0..iterations {
            let fit = self.fit(&key_from_camera, scales);
            *scales = fit.scales;
            let step = self.step(&key_from_camera, &fit);
            last = Some(fit);
            let Some(step) = step else { break };
            key_from_camera = se3::exponential(&step) * key_from_camera;
            if self.is_small(&step) {
                break;
            }
        }
        (key_from_camera, last)
    }

    /// Steps below a fiftieth of a pixel at this level change nothing.
    fn is_small(&self, step: &Twist) -> bool {
        let pixel = 0.02 / f64::from(self.frame.intrinsics.fx);
        DVec3::from_slice(&step[..3]).length() < pixel && DVec3::from_slice(&step[3..]).length() < pixel
    }

    /// The Gauss-Newton step, with the prior: in each eigenvector's direction the mean of what the measurements and the
    /// prior say, weighted by their information.
    fn step(&self, key_from_camera: &Pose, fit: &Fit) -> Option<Twist> {
        let system = Eigen::new(&scaled_matrix(&fit.hessian));
        let gradient = system.along(&unscaled(&fit.gradient));
        let error = system.along(&scaled(&self.prior.error(key_from_camera)));
        // With a better sensor, the errors of the alignment itself matter more.
        let weak = WEAK_INFORMATION / f64::from(fit.scales.distance.min(1.0));
        let along: [f64; 6] = std::array::from_fn(|k| {
            let information = system.values[k].max(0.0);
            let unknown = weak * weak / (information * information + weak * weak);
            let (measured, prior) = (1.0 - unknown, self.prior.information(unknown));
            -(gradient[k] * measured + error[k] * prior) / (information * measured + prior)
        });
        let step = unscaled(&system.combined(&along));
        let size = step.iter().map(|part| part.abs()).fold(0.0, f64::max);
        // Beyond this the linearisation means nothing.
        let limit = 0.2;
        let limited = if size > limit { step.map(|part| part * limit / size) } else { step };
        limited.iter().all(|part| part.is_finite()).then_some(limited)
    }

    /// Evaluates a pose.
    pub(crate) fn fit(&self, key_from_camera: &Pose, scales: &Scales) -> Fit {
        let camera = Camera::new(key_from_camera);
        let blocks = self.points.par_chunks(BLOCK).map(|points| self.add_up(points, &camera, scales));
        let blocks: Vec<Sums> = blocks.collect();
        let mut total = Sums::default();
        for block in &blocks {
            total.add(block);
        }
        let distances =
            total.distances.median().map_or(scales.distance, |median| median * TO_DEVIATION / DISTANCE_BINS);
        let greys = total.greys.median().map_or(scales.grey, |median| median * TO_DEVIATION / GREY_BINS);
        let (gain, offset) = total.exposure.regression(GAIN).unwrap_or((scales.gain, scales.offset));
        Fit {
            hessian: total.hessian(),
            gradient: total.gradient(),
            counts: total.counts,
            scales: Scales {
                distance: distances.max(MIN_DISTANCE_SCALE),
                grey: greys.max(MIN_GREY_DEVIATION),
                gain,
                offset,
            },
        }
    }

    fn add_up(&self, points: &[ReferencePoint], camera: &Camera, scales: &Scales) -> Sums {
        let mut sums = Sums::default();
        for point in points {
            self.add_point(point, camera, scales, &mut sums);
        }
        sums
    }

    fn add_point(&self, point: &ReferencePoint, camera: &Camera, scales: &Scales, sums: &mut Sums) {
        let in_camera = camera.rotation * point.position + camera.translation;
        if in_camera.z < 0.05 {
            return;
        }
        let intrinsics = &self.frame.intrinsics;
        let inverse = 1.0 / in_camera.z;
        let column = intrinsics.fx * in_camera.x * inverse + intrinsics.cx;
        let row = intrinsics.fy * in_camera.y * inverse + intrinsics.cy;
        let (width, height) = self.frame.grey.size();
        if !(column >= 1.0 && row >= 1.0 && column < width as f32 - 2.0 && row < height as f32 - 2.0) {
            return;
        }
        sums.counts.visible += 1.0;
        let covered = self.add_geometry(point, camera, (column, row), scales, sums);
        if self.uses_image && !covered && point.gradient != Vec3::ZERO {
            self.add_image(point, (column, row), scales, sums);
        }
    }

    /// Sums at a pose over the points with the same key, all with the same weight.
    pub(crate) fn keyed_sums<K: Ord>(
        &self,
        key_from_camera: &Pose,
        scales: &Scales,
        key: impl Fn(&ReferencePoint) -> K,
    ) -> BTreeMap<K, Sums> {
        let camera = Camera::new(key_from_camera);
        let mut sums: BTreeMap<K, Sums> = BTreeMap::new();
        // Neighbours mostly have the same key.
        for run in self.points.chunk_by(|one, other| key(one) == key(other)) {
            let sums = sums.entry(key(&run[0])).or_default();
            for point in run {
                self.add_point(&ReferencePoint { weight: 1.0, ..*point }, &camera, scales, sums);
            }
        }
        sums
    }

    /// Evidence of a pose's residuals about the focal length, once the pose is free to follow: the information about its
    /// logarithm, and the derivative of the cost.
    pub(crate) fn focal_fit(&self, key_from_camera: &Pose, scales: &Scales) -> Option<(f64, f64)> {
        let camera = Camera::new(key_from_camera);
        let mut sums = Sums::default();
        for point in self.points {
            // A longer focal length moves points towards the axis, those of the keyframe and those of the frame.
            let inwards = |point: Vec3| Vec3::new(-point.x, -point.y, 0.0);
            let in_camera = camera.rotation * point.position + camera.translation;
            sums.stretch = camera.inverse * inwards(in_camera) - inwards(point.position);
            self.add_point(point, &camera, scales, &mut sums);
        }
        let (mixed, twice, once) = sums.focal();
        let mut total = Sums::default();
        total.add(&sums);
        let factor = Cholesky::new(&scaled_matrix(&total.hessian()), WEAK_INFORMATION)?;
        let mixed = unscaled(&mixed);
        let solved = factor.solve(&mixed);
        let product = |other: &Twist| solved.iter().zip(other).map(|(one, other)| one * other).sum::<f64>();
        Some((twice - product(&mixed), once - product(&unscaled(&total.gradient()))))
    }

    /// Adds a point's distance. Returns true if the frame sees another surface there.
    fn add_geometry(
        &self,
        point: &ReferencePoint,
        camera: &Camera,
        (column, row): (f32, f32),
        scales: &Scales,
        sums: &mut Sums,
    ) -> bool {
        let (column, row) = ((column + 0.5) as usize, (row + 0.5) as usize);
        let depth = self.frame.depth[(column, row)];
        if depth <= 0.0 {
            return false;
        }
        sums.counts.with_depth += 1.0;
        let intrinsics = &self.frame.intrinsics;
        let measured = Vec3::new(
            (column as f32 - intrinsics.cx) / intrinsics.fx * depth,
            (row as f32 - intrinsics.cy) / intrinsics.fy * depth,
            depth,
        );
        let measured = camera.inverse * (measured - camera.translation);
        let distance = point.normal.dot(measured - point.position);
        let relative = distance * point.certainty;
        let gate = GATE_METRES[self.number.min(GATE_METRES.len() - 1)].max(GATE * scales.distance / point.certainty);
        if distance.abs() > gate {
            sums.distances.add_largest();
            return true;
        }
        sums.distances.add(relative.abs() * DISTANCE_BINS);
        if relative.abs() < 3.0 * scales.distance {
            sums.counts.near_plane += 1.0;
        }
        let scaled = relative / scales.distance;
        let weight = point.weight * (FREEDOM + 1.0) / (FREEDOM + scaled * scaled) * INDEPENDENT[0];
        let information = weight * point.certainty * point.certainty / (scales.distance * scales.distance);
        sums.add_row(point.normal, measured.cross(point.normal), distance, information);
        false
    }

    /// Adds a point's luminance.
    fn add_image(&self, point: &ReferencePoint, (column, row): (f32, f32), scales: &Scales, sums: &mut Sums) {
        let grey = self.frame.grey_at(Vec2::new(column, row));
        let difference = grey - (scales.gain * point.grey + scales.offset);
        sums.counts.with_texture += 1.0;
        sums.greys.add(difference.abs() * GREY_BINS);
        if difference.abs() < 3.0 * scales.grey {
            sums.counts.same_grey += 1.0;
        }
        let scaled = difference / scales.grey;
        let robust = (FREEDOM + 1.0) / (FREEDOM + scaled * scaled);
        sums.exposure.add(point.grey, grey, robust);
        let information = point.weight * robust * INDEPENDENT[1] / (scales.grey * scales.grey);
        sums.add_row(-point.gradient, -point.position.cross(point.gradient), difference, information);
    }
}

/// A system in the coordinates of [`scaled`].
fn scaled_matrix(matrix: &Matrix6) -> Matrix6 {
    let factors = unscaled(&[1.0; 6]);
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[row][column] * factors[row] * factors[column]))
}

/// A pose in single precision, for the loop over points.
struct Camera {
    /// Camera from keyframe.
    rotation: Mat3,
    translation: Vec3,
    /// Rotation of keyframe from camera.
    inverse: Mat3,
}

impl Camera {
    fn new(key_from_camera: &Pose) -> Self {
        let camera_from_key: LocalPose = key_from_camera.inverse().relative_to(DVec3::ZERO);
        let rotation = camera_from_key.rotation();
        Self { rotation, translation: camera_from_key.translation(), inverse: rotation.transpose() }
    }
}
