//! The camera's pose from frame to frame.

use crate::graph::Edge;
use crate::keyframe::{Aligned, Keyframe, Reference};
use crate::linear::Eigen;
use crate::movers::Movers;
use crate::plausibility::FocalEstimate;
use crate::prior::{LastFrame, MAX_ERROR, MotionPrior};
use crate::pyramid::{GreyFrame, Pyramid};
use crate::se3;
use crate::segment_runs::SegmentRuns;
use crate::tracked_frame::TrackedFrame;
use crate::{CameraPose, InputDoubt, PoseQuality, PoseState};
use splatseg_geometry::{CameraFrame, KeyframeId, MapCorrection, Pose, RemappedId, SegmentMap};
use std::collections::VecDeque;
use std::time::Duration;

/// Maximum number of keyframes.
pub(crate) const MAX_KEYFRAMES: usize = 6;

/// A keyframe is replaced when the camera has moved this far, metres...
const MAX_DISTANCE: f64 = 0.1;
/// ...or turned this far, radians...
const MAX_ANGLE: f64 = 0.15;
/// ...or when less than this share of its points is in view.
const MIN_OVERLAP: f32 = 0.85;

/// A frame with fewer points cannot become a keyframe.
const MIN_POINTS: usize = 300;

/// An alignment is accepted if at least this share of the measurements agrees...
const MIN_INLIERS: f32 = 0.5;
/// ...and this share of the keyframe's points is in view.
const MIN_VISIBLE: f32 = 0.15;

/// An earlier keyframe or a searched start is accepted only from this share on, since a wrong pose is worse than none.
const MIN_INLIERS_OF_RETURN: f32 = 0.7;
/// The same for the share in view.
const MIN_VISIBLE_OF_RETURN: f32 = 0.35;

/// An earlier keyframe is used again if the camera is this close to it; 1 is where a keyframe is replaced.
const NEAR: f64 = 0.6;

/// Tracks a camera against keyframes.
#[derive(Clone, Debug, Default)]
pub struct Odometry {
    /// Newest last.
    pub(crate) keyframes: VecDeque<Keyframe>,
    /// Index of the keyframe in use.
    pub(crate) active: usize,
    /// The keyframe in use.
    pub(crate) reference: Option<Reference>,
    pub(crate) last: Option<LastFrame>,
    pub(crate) movers: Movers,
    pub(crate) focal: FocalEstimate,
    /// True if the latest frame became a keyframe that waits for its segments.
    pub(crate) awaits_segments: bool,
    /// Number of the next keyframe.
    pub(crate) next_keyframe: KeyframeId,
    /// The keyframe that the latest frame has become.
    pub(crate) made: Option<MadeKeyframe>,
}

/// A frame that has become a keyframe.
#[derive(Clone, Debug)]
pub(crate) struct MadeKeyframe {
    pub(crate) id: KeyframeId,
    pub(crate) world_from_key: Pose,
    /// Its pose relative to the keyframe that it was aligned with. `None` if it was not aligned.
    pub(crate) link: Option<Edge>,
}

impl Odometry {
    /// Creates odometry that has seen no frame.
    pub fn new() -> Self {
        Self::default()
    }

    /// Tracks the next frame. `initial` is the pose of the first frame. Size and intrinsics may differ from those of the
    /// frames before.
    ///
    /// `motion` is a measured motion since the previous frame, e.g. by a robot's wheels: the previous camera from this
    /// one. Without it, the camera is expected to move on as before.
    pub fn track(&mut self, frame: &CameraFrame<'_>, initial: &Pose, motion: Option<&Pose>) -> CameraPose {
        self.track_frame(&TrackedFrame::new(frame), initial, motion)
    }

    /// As [`Self::track`].
    pub(crate) fn track_frame(
        &mut self,
        frame: &TrackedFrame<'_>,
        initial: &Pose,
        motion: Option<&Pose>,
    ) -> CameraPose {
        let TrackedFrame { grey, pyramid, timestamp, .. } = frame;
        (self.made, self.awaits_segments) = (None, false);
        // Keyframes may be of another camera: autofocus changes the focal length with every frame.
        let Some(last) = self.last.filter(|_| !self.keyframes.is_empty()) else {
            return self.start(grey, pyramid, initial, *timestamp);
        };
        let prior = last.prior(*timestamp, motion);
        let Some((index, mut reference, aligned)) = self.find(pyramid, &last, &prior) else {
            self.last = Some(last.lost());
            return CameraPose { world_from_camera: last.world_from_camera, state: PoseState::Lost, quality: None };
        };
        let aligned = self.movers.judge(&mut reference, pyramid, aligned, &prior);
        let quality = quality(&aligned, &reference);
        self.last = Some(last.after(&aligned.world_from_camera, &prior, *timestamp));
        if self.focal.wants_frame()
            && let Some(fit) = reference.focal_fit(pyramid, &aligned)
        {
            self.focal.add(fit);
        }
        (self.active, self.reference) = (index, Some(reference));
        self.choose_keyframe(grey, pyramid, &aligned, quality.overlap);
        CameraPose { world_from_camera: aligned.world_from_camera, state: PoseState::Tracked, quality: Some(quality) }
    }

    /// Starts again from a frame whose pose is known.
    pub fn set(&mut self, frame: &CameraFrame<'_>, world_from_camera: &Pose) {
        self.set_frame(&TrackedFrame::new(frame), world_from_camera);
    }

    /// As [`Self::set`].
    pub(crate) fn set_frame(&mut self, frame: &TrackedFrame<'_>, world_from_camera: &Pose) {
        let (movers, focal, next_keyframe) = (std::mem::take(&mut self.movers), self.focal, self.next_keyframe);
        *self = Self { movers, focal, next_keyframe, ..Self::default() };
        self.start(&frame.grey, &frame.pyramid, world_from_camera, frame.timestamp);
    }

    /// Moves the camera and the keyframes with a correction of the map.
    pub(crate) fn correct(&mut self, correction: &MapCorrection) {
        let moved =
            |id: KeyframeId, pose: &Pose| correction.new_from_old.get(&id).map_or(*pose, |motion| *motion * *pose);
        let active = self.keyframes.get(self.active).map(|keyframe| keyframe.id);
        if let (Some(active), Some(last)) = (active, &mut self.last) {
            last.world_from_camera = moved(active, &last.world_from_camera);
        }
        if let (Some(active), Some(reference)) = (active, &mut self.reference) {
            reference.world_from_key = moved(active, &reference.world_from_key);
        }
        for keyframe in &mut self.keyframes {
            keyframe.world_from_key = moved(keyframe.id, &keyframe.world_from_key);
        }
    }

    /// Replaces ids that turned out to be the same object.
    pub(crate) fn remap(&mut self, remapped: &[RemappedId]) {
        self.movers.remap(remapped);
        for segments in self.keyframes.iter_mut().filter_map(|keyframe| keyframe.segments.as_mut()) {
            segments.remap(remapped);
        }
        if let Some(reference) = &mut self.reference {
            reference.remap(remapped);
        }
    }

    /// Number of the keyframe in use.
    pub(crate) fn active_keyframe(&self) -> Option<KeyframeId> {
        Some(self.keyframes.get(self.active)?.id)
    }

    /// Records the segments that the method found in the latest frame. Segments that move by themselves lose their
    /// influence on the camera's pose.
    pub fn set_segments(&mut self, segments: &SegmentMap) {
        if !std::mem::take(&mut self.awaits_segments) {
            return;
        }
        let (Some(keyframe), Some(reference)) = (self.keyframes.back_mut(), &mut self.reference) else { return };
        if segments.size() == keyframe.frame.grey.size() {
            let segments = keyframe.segments.insert(SegmentRuns::new(segments));
            reference.set_segments(segments);
        }
    }

    /// A doubt about the focal length, if the tracked frames say that it is wrong.
    pub(crate) fn focal_doubt(&self) -> Option<InputDoubt> {
        self.focal.doubt(&self.keyframes.back()?.frame.intrinsics)
    }

    /// The latest pose.
    pub(crate) fn last_pose(&self) -> Option<Pose> {
        Some(self.last?.world_from_camera)
    }

    /// Makes the frame the first keyframe, if it shows enough.
    fn start(
        &mut self,
        grey: &GreyFrame,
        pyramid: &Pyramid,
        initial: &Pose,
        timestamp: Option<Duration>,
    ) -> CameraPose {
        let world_from_camera = self.last.map_or(*initial, |last| last.world_from_camera);
        self.last = Some(LastFrame::first(world_from_camera, timestamp));
        self.keyframes.clear();
        self.reference = None;
        let is_keyframe = self.add_keyframe(grey, pyramid, world_from_camera, None);
        let state = if is_keyframe { PoseState::Tracked } else { PoseState::Lost };
        CameraPose { world_from_camera, state, quality: None }
    }

    /// Adds a keyframe and uses it. Returns false if the frame shows too little.
    fn add_keyframe(
        &mut self,
        frame: &GreyFrame,
        pyramid: &Pyramid,
        world_from_key: Pose,
        aligned: Option<&Aligned>,
    ) -> bool {
        let reference = Reference::new(pyramid, world_from_key);
        if reference.size() < MIN_POINTS {
            return false;
        }
        let link = aligned.and_then(|aligned| {
            let from = self.keyframes.get(self.active)?;
            let hessian = aligned.fit.as_ref().map(|fit| &fit.hessian);
            Some(Edge::tracked(from.id, self.next_keyframe, from.world_from_key.inverse() * world_from_key, hessian))
        });
        if self.keyframes.len() >= MAX_KEYFRAMES {
            self.keyframes.pop_front();
        }
        let id = self.next_keyframe;
        self.next_keyframe = id.saturating_add(1);
        self.made = Some(MadeKeyframe { id, world_from_key, link });
        self.keyframes.push_back(Keyframe { id, world_from_key, frame: frame.clone(), segments: None });
        (self.active, self.reference, self.awaits_segments) = (self.keyframes.len() - 1, Some(reference), true);
        true
    }

    /// The points of a keyframe.
    pub(crate) fn reference_of(&self, index: usize) -> Option<Reference> {
        let keyframe = self.keyframes.get(index)?;
        let mut reference = Reference::new(&Pyramid::new(&keyframe.frame), keyframe.world_from_key);
        if let Some(segments) = &keyframe.segments {
            reference.set_segments(segments);
        }
        Some(reference)
    }

    /// Aligns the frame with the keyframe in use or, if that fails or tracking was lost, with any. Returns the
    /// keyframe's index too.
    fn find(
        &mut self,
        pyramid: &Pyramid,
        last: &LastFrame,
        prior: &MotionPrior,
    ) -> Option<(usize, Reference, Aligned)> {
        let mut reference = self.reference.take().or_else(|| self.reference_of(self.active))?;
        self.movers.weigh(&mut reference);
        if last.lost_frames == 0 {
            let starts = [prior.predicted, last.world_from_camera];
            let [predicted, still] = starts.map(|start| reference.score(pyramid, &start, prior));
            let aligned = reference.align(pyramid, &starts[usize::from(still > predicted)], prior);
            if is_tracked(&aligned, &reference) {
                return Some((self.active, reference, aligned));
            }
        }
        let wide = MotionPrior { deviation: MAX_ERROR, ..*prior };
        let is_found = |reference: &Reference| {
            let start = reference.search(pyramid, &last.world_from_camera, prior);
            let aligned = reference.align(pyramid, &start, &wide);
            is_found_again(&aligned, reference).then_some(aligned)
        };
        if let Some(aligned) = is_found(&reference) {
            return Some((self.active, reference, aligned));
        }
        self.reference = Some(reference);
        let others = (0..self.keyframes.len()).rev().filter(|index| *index != self.active);
        others.into_iter().find_map(|index| {
            let other = self.reference_of(index)?;
            let aligned = is_found(&other)?;
            Some((index, other, aligned))
        })
    }

    /// Replaces the keyframe in use if the camera has moved away from it: by an earlier one nearby, otherwise by this
    /// frame.
    fn choose_keyframe(&mut self, grey: &GreyFrame, pyramid: &Pyramid, aligned: &Aligned, overlap: f32) {
        let pose = &aligned.world_from_camera;
        let distances: Vec<f64> = self.keyframes.iter().map(|keyframe| distance_from(keyframe, pose)).collect();
        if distances[self.active] <= 1.0 && overlap >= MIN_OVERLAP {
            return;
        }
        let others = distances.iter().enumerate().filter(|(index, _)| *index != self.active);
        let nearest = others.min_by(|one, other| one.1.total_cmp(other.1));
        if let Some((index, _)) = nearest.filter(|(_, distance)| **distance < NEAR) {
            (self.active, self.reference) = (index, None);
        } else {
            self.add_keyframe(grey, pyramid, *pose, Some(aligned));
        }
    }
}

/// Distance of a pose from a keyframe; 1 where the keyframe is replaced.
fn distance_from(keyframe: &Keyframe, world_from_camera: &Pose) -> f64 {
    let (translation, rotation) = se3::size(&(keyframe.world_from_key.inverse() * *world_from_camera));
    (translation / MAX_DISTANCE).max(rotation / MAX_ANGLE)
}

/// True if a frame continues the camera's path.
fn is_tracked(aligned: &Aligned, reference: &Reference) -> bool {
    overlap(aligned, reference) >= MIN_VISIBLE && aligned.counts.mean_inliers() >= MIN_INLIERS
}

/// True if a frame shows the place of a keyframe although nothing is known about the camera's motion. Depth and image
/// must both agree: a wrong pose is worse than none.
pub(crate) fn is_found_again(aligned: &Aligned, reference: &Reference) -> bool {
    let agrees = |inliers: Option<f32>| inliers.is_none_or(|share| share >= MIN_INLIERS_OF_RETURN);
    let inliers = aligned.counts.inliers();
    overlap(aligned, reference) >= MIN_VISIBLE_OF_RETURN && inliers[0].is_some() && inliers.into_iter().all(agrees)
}

fn overlap(aligned: &Aligned, reference: &Reference) -> f32 {
    aligned.counts.visible / reference.size().max(1) as f32
}

/// Standard deviations of an aligned frame's position relative to its keyframe, metres, and rotation, radians. Infinite if
/// they are not known.
pub(crate) fn deviations(aligned: &Aligned) -> (f64, f64) {
    let variances = aligned.fit.as_ref().map(|fit| Eigen::new(&fit.hessian).variances());
    let deviation =
        |from: usize| variances.map_or(f64::INFINITY, |variances| variances[from..from + 3].iter().sum::<f64>().sqrt());
    (deviation(0), deviation(3))
}

fn quality(aligned: &Aligned, reference: &Reference) -> PoseQuality {
    let (position, rotation) = deviations(aligned);
    PoseQuality {
        overlap: overlap(aligned, reference),
        inliers: aligned.counts.mean_inliers(),
        uses_image: aligned.counts.inliers()[1].is_some(),
        residual: aligned.scales.distance / reference.noise.relative(),
        position_deviation: position as f32,
        rotation_deviation: rotation as f32,
    }
}
