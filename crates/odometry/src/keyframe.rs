//! Keyframes: earlier frames that later ones are aligned with.

use crate::alignment::{Alignment, Counts, Fit, Scales};
use crate::prior::MotionPrior;
use crate::pyramid::{GreyFrame, Pyramid};
use crate::reference::{ReferencePoint, select_points};
use crate::segment_runs::SegmentRuns;
use glam::{DVec3, Vec2, Vec3};
use splatseg_geometry::{KeyframeId, Pose, RemappedId, SegmentId};

/// Maximum number of Gauss-Newton steps by level from the finest, the last one for all coarser levels.
const ITERATIONS: [usize; 3] = [5, 6, 10];

/// Fixed scales, for comparing poses.
const SCORING: Scales = Scales { distance: 1.5, grey: 8.0, gain: 1.0, offset: 0.0 };

/// Residuals count for at most this many deviations when segments are judged.
const MAX_RELATIVE: f32 = 6.0;

/// A frame with its pose. Everything else follows from it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Keyframe {
    pub(crate) id: KeyframeId,
    pub(crate) world_from_key: Pose,
    pub(crate) frame: GreyFrame,
    /// The segments that the method found in it, once known.
    pub(crate) segments: Option<SegmentRuns>,
}

/// A keyframe in use, with the points that frames are aligned with.
#[derive(Clone, Debug)]
pub(crate) struct Reference {
    pub(crate) world_from_key: Pose,
    /// Points by level, the finest first.
    points: Vec<Vec<ReferencePoint>>,
}

/// A frame aligned with a keyframe.
pub(crate) struct Aligned {
    pub(crate) world_from_camera: Pose,
    pub(crate) fit: Option<Fit>,
    pub(crate) scales: Scales,
    /// Counts at the finest level, with fixed scales.
    pub(crate) counts: Counts,
}

impl Reference {
    pub(crate) fn new(pyramid: &Pyramid, world_from_key: Pose) -> Self {
        let width = pyramid.levels[0].depth.width();
        let levels = pyramid.levels.iter().enumerate();
        Self { world_from_key, points: levels.map(|(number, level)| select_points(level, number, width)).collect() }
    }

    /// Number of points at the finest level.
    pub(crate) fn size(&self) -> usize {
        self.points.first().map_or(0, Vec::len)
    }

    /// Records the segments of all points.
    pub(crate) fn set_segments(&mut self, segments: &SegmentRuns) {
        let ids = segments.to_ids();
        for point in self.points.iter_mut().flatten() {
            point.segment = ids.get(point.pixel as usize).copied().unwrap_or(0);
        }
    }

    /// Replaces ids that turned out to be the same object.
    pub(crate) fn remap(&mut self, remapped: &[RemappedId]) {
        for RemappedId { from, into } in remapped {
            self.points
                .iter_mut()
                .flatten()
                .filter(|point| point.segment == *from)
                .for_each(|point| point.segment = *into);
        }
    }

    /// Weighs points by the segments that they belong to.
    pub(crate) fn weigh(&mut self, weight: impl Fn(SegmentId) -> f32) {
        for point in self.points.iter_mut().flatten() {
            point.weight = weight(point.segment);
        }
    }

    /// Aligns a frame, from the coarsest level to the finest, starting at a pose.
    pub(crate) fn align(&self, frame: &Pyramid, start: &Pose, prior: &MotionPrior) -> Aligned {
        let key_from_world = self.world_from_key.inverse();
        let (mut pose, prior) = (key_from_world * *start, &prior.in_coordinates(&key_from_world));
        let (mut scales, mut last) = (Scales::default(), None);
        for number in (0..self.points.len().min(frame.levels.len())).rev() {
            let iterations = ITERATIONS[number.min(ITERATIONS.len() - 1)];
            (pose, last) = self.alignment(frame, number, prior).align(pose, &mut scales, iterations);
        }
        let scoring = Scales { gain: scales.gain, offset: scales.offset, ..SCORING };
        let counts = self.alignment(frame, 0, prior).fit(&pose, &scoring).counts;
        Aligned { world_from_camera: self.world_from_key * pose, fit: last, scales, counts }
    }

    /// How well a pose fits at the coarsest level, 0 to 1.
    pub(crate) fn score(&self, frame: &Pyramid, world_from_camera: &Pose, prior: &MotionPrior) -> f32 {
        let number = self.points.len().min(frame.levels.len()) - 1;
        let pose = self.world_from_key.inverse() * *world_from_camera;
        self.alignment(frame, number, prior).fit(&pose, &SCORING).counts.agreement(self.points[number].len())
    }

    /// Calls `record` with the segment of each point and the squares of its residuals in an aligned frame, distance and
    /// luminance, in units of their deviations. Points that something nearer covers are left out.
    pub(crate) fn squared_residuals(&self, frame: &Pyramid, aligned: &Aligned, mut record: impl FnMut(SegmentId, f32)) {
        let camera_from_key = (aligned.world_from_camera.inverse() * self.world_from_key).relative_to(DVec3::ZERO);
        let (level, scales) = (&frame.levels[0], &aligned.scales);
        let (last_column, last_row) = (level.depth.width() as f32 - 1.0, level.depth.height() as f32 - 1.0);
        for point in &self.points[0] {
            let expected = camera_from_key.to_world(point.position);
            let Some(pixel) = level.intrinsics.project(expected) else { continue };
            if !(pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < last_column && pixel.y < last_row) {
                continue;
            }
            let nearest = ((pixel.x + 0.5) as usize, (pixel.y + 0.5) as usize);
            let depth = level.depth[nearest];
            if depth > 0.0 {
                let measured = level.intrinsics.unproject(Vec2::new(nearest.0 as f32, nearest.1 as f32), depth);
                let distance = (camera_from_key.rotation() * point.normal).dot(measured - expected);
                let relative = distance * point.certainty / scales.distance.max(1.0);
                // Towards the camera something else may be in the way.
                if relative >= MAX_RELATIVE {
                    continue;
                }
                record(point.segment, relative.max(-MAX_RELATIVE).powi(2));
            }
            if frame.has_contrast && point.gradient != Vec3::ZERO {
                let difference = level.grey_at(pixel) - (scales.gain * point.grey + scales.offset);
                record(point.segment, (difference / scales.grey).clamp(-MAX_RELATIVE, MAX_RELATIVE).powi(2));
            }
        }
    }

    fn alignment<'a>(&'a self, frame: &'a Pyramid, number: usize, prior: &'a MotionPrior) -> Alignment<'a> {
        let (points, level) = (&self.points[number], &frame.levels[number]);
        Alignment { points, frame: level, number, uses_image: frame.has_contrast, prior }
    }
}
