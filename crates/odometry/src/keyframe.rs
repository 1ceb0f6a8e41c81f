//! Keyframes: earlier frames that later ones are aligned with.

use crate::alignment::{Alignment, Fit, Scales};
use crate::prior::MotionPrior;
use crate::pyramid::{GreyFrame, Pyramid};
use crate::reference::{DepthNoise, ReferencePoint, select_points};
use crate::segment_runs::SegmentRuns;
use crate::sums::{Counts, Sums};
use splatseg_geometry::{KeyframeId, Pose, RemappedId, SegmentId};
use std::collections::BTreeMap;

/// Maximum number of Gauss-Newton steps by level from the finest, the last one for all coarser levels.
const ITERATIONS: [usize; 3] = [5, 6, 10];

/// Scales for comparing poses, of a sensor like a Kinect.
const SCORING: Scales = Scales { distance: 1.5, grey: 8.0, gain: 1.0, offset: 0.0 };

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
    /// Noise of the keyframe's depth.
    pub(crate) noise: DepthNoise,
}

/// A frame aligned with a keyframe.
pub(crate) struct Aligned {
    pub(crate) world_from_camera: Pose,
    pub(crate) fit: Option<Fit>,
    pub(crate) scales: Scales,
    /// Counts at the finest level, with scales that depend on nothing but the keyframe's sensor.
    pub(crate) counts: Counts,
}

impl Reference {
    pub(crate) fn new(pyramid: &Pyramid, world_from_key: Pose) -> Self {
        let width = pyramid.levels[0].depth.width();
        let noise = DepthNoise::of(pyramid);
        let levels = pyramid.levels.iter().enumerate();
        let points = levels.map(|(number, level)| select_points(level, number, width, noise)).collect();
        Self { world_from_key, points, noise }
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
        self.aligned(frame, prior, (pose, last), scales)
    }

    /// How well a pose fits at the coarsest level, 0 to 1.
    pub(crate) fn score(&self, frame: &Pyramid, world_from_camera: &Pose, prior: &MotionPrior) -> f32 {
        let number = self.points.len().min(frame.levels.len()) - 1;
        let pose = self.world_from_key.inverse() * *world_from_camera;
        self.alignment(frame, number, prior).fit(&pose, &self.scoring()).counts.agreement(self.points[number].len())
    }

    /// Scales for comparing poses: those of the keyframe's sensor.
    fn scoring(&self) -> Scales {
        Scales { distance: SCORING.distance * self.noise.allowance(), ..SCORING }
    }

    /// True if the points belong to more than one segment.
    pub(crate) fn has_segments(&self) -> bool {
        self.points.first().is_some_and(|points| points.iter().any(|point| point.segment != points[0].segment))
    }

    /// Sums of each segment and part of the frame at an aligned frame's pose, as if nothing moved by itself. The parts
    /// are `columns` × `rows` rectangles of the keyframe.
    pub(crate) fn segment_sums(
        &self,
        frame: &Pyramid,
        aligned: &Aligned,
        (columns, rows): (usize, usize),
    ) -> BTreeMap<(SegmentId, usize), Sums> {
        let pose = self.world_from_key.inverse() * aligned.world_from_camera;
        let prior = MotionPrior { predicted: pose, deviation: 1.0 };
        let (width, height) = frame.levels[0].depth.size();
        let part = |pixel: usize| columns * (rows * (pixel / width) / height) + columns * (pixel % width) / width;
        let alignment = self.alignment(frame, 0, &prior);
        alignment.keyed_sums(&pose, &aligned.scales, |point| (point.segment, part(point.pixel as usize)))
    }

    /// Evidence of an aligned frame about the focal length; see [`Alignment::focal_fit`].
    pub(crate) fn focal_fit(&self, frame: &Pyramid, aligned: &Aligned) -> Option<(f64, f64)> {
        let pose = self.world_from_key.inverse() * aligned.world_from_camera;
        let prior = MotionPrior { predicted: pose, deviation: 1.0 };
        self.alignment(frame, 0, &prior).focal_fit(&pose, &aligned.scales)
    }

    /// Aligns a frame again at the finest level, after weights have changed.
    pub(crate) fn align_again(&self, frame: &Pyramid, aligned: &Aligned, prior: &MotionPrior) -> Aligned {
        let key_from_world = self.world_from_key.inverse();
        let prior = &prior.in_coordinates(&key_from_world);
        let mut scales = aligned.scales;
        let start = key_from_world * aligned.world_from_camera;
        let found = self.alignment(frame, 0, prior).align(start, &mut scales, ITERATIONS[0]);
        self.aligned(frame, prior, found, scales)
    }

    fn aligned(
        &self,
        frame: &Pyramid,
        prior: &MotionPrior,
        (pose, fit): (Pose, Option<Fit>),
        scales: Scales,
    ) -> Aligned {
        let scoring = Scales { gain: scales.gain, offset: scales.offset, ..self.scoring() };
        let counts = self.alignment(frame, 0, prior).fit(&pose, &scoring).counts;
        Aligned { world_from_camera: self.world_from_key * pose, fit, scales, counts }
    }

    fn alignment<'a>(&'a self, frame: &'a Pyramid, number: usize, prior: &'a MotionPrior) -> Alignment<'a> {
        let (points, level) = (&self.points[number], &frame.levels[number]);
        Alignment { points, frame: level, number, uses_image: frame.has_contrast, prior }
    }
}
