//! The last frames, without the map: they decide which of the two is wrong when a frame contradicts the map.
//!
//! - **Jump** ([`RecentFrames::jump`]): the frame looks as if the camera had hardly moved, but its pose says otherwise. Its
//!   poses have moved to other coordinates, as after a correction by SLAM. The map moves along, and nothing is lost.
//! - **Contradiction** ([`RecentFrames::trust`]): the frame sees through more than half of the Gaussians that it can
//!   judge. One such frame has a wrong pose or depth. Several that agree with each other are right, and the map is wrong.
//! - **Expected** ([`RecentFrames::expect`]): where the map cannot say, the ids of the previous frame, moved by the
//!   relative pose or not at all, whichever fits better.
//!
//! None of this is in the paper. Positions are in the coordinates of the map.

mod saved;
mod sketch;

pub(crate) use saved::SavedRecentFrames;

use crate::recall::Recall;
use crate::{ABSTAIN, FrameTrust, MemorySettings};
use glam::{DVec3, Quat};
use sketch::Sketch;
use splatseg_geometry::{LocalPose, Pose, RgbdFrame, SegmentId, SegmentMap};
use std::collections::{BTreeSet, VecDeque};

/// Frames agree if this share of the pixels that both show has the same depth.
const MIN_AGREEMENT: f32 = 0.6;

/// Poses have jumped if the frame fits another motion of the camera, by this share of pixels or more...
const MIN_AGREEMENT_AFTER_JUMP: f32 = 0.7;

/// ...and better than the motion that its pose gives by at least this share...
const MIN_GAIN_OF_JUMP: f32 = 0.16;

/// ...or by this one, if they return to where they were before the last jump.
const MIN_GAIN_OF_RETURN: f32 = 0.08;

/// A smaller step of the camera, metres, is no jump...
const MIN_JUMP: f32 = 0.1;

/// ...unless it turns by at least this, radians.
const MIN_TURN_OF_JUMP: f32 = 0.05;

/// No camera moves so far, metres, from one frame to the next while its image stays the same.
const MAX_STEP: f32 = 100.0;

/// Contradicting frames that are kept for comparison.
const MAX_CONTRADICTING: usize = 3;

/// Support of a frame that agrees with the contradicting frames before it, and of one that shows another place...
const AGREEING_SUPPORT: u8 = 2;
const INCOMPARABLE_SUPPORT: u8 = 1;

/// ...and the sum from which such frames are trusted: the third frame in a row, or the fifth.
const TRUSTED_SUPPORT: u8 = 4;

/// How sure an id of the previous frame is: less than a fresh observation (1).
const CONFIDENCE: f32 = 0.7;

/// The map can say nothing of a frame if at least this share of the pixels that it covers has another depth.
const MAX_DISAGREEMENT: f32 = 0.5;

/// The last frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RecentFrames {
    previous: Option<PreviousFrame>,
    /// The last frames in a row that contradict the map and not each other, the newest last.
    contradicting: VecDeque<Sketch>,
    /// Summed support of those frames.
    support: u8,
    /// The last jump, which may be undone: the transform from the world before it.
    last_jump: Option<Pose>,
    /// Frames in a row that were taken far from the map.
    far_frames: u8,
}

/// The previous frame.
#[derive(Clone, Debug, PartialEq)]
struct PreviousFrame {
    sketch: Sketch,
    /// Its predictions, `[height, width]`.
    ids: SegmentMap,
    /// The camera's motion before it: previous camera from camera.
    motion: LocalPose,
    /// Whether masks of the next frame may take its ids although no Gaussian has them yet.
    is_linked: bool,
}

impl RecentFrames {
    /// Whether a frame, taken at `pose`, is to be trusted if it contradicts the map.
    pub fn trust(&self, frame: &RgbdFrame<'_>, pose: &LocalPose, settings: &MemorySettings) -> FrameTrust {
        match self.support_with(frame, pose, settings) {
            Some(support) if support >= TRUSTED_SUPPORT => FrameTrust::Confirmed,
            _ => FrameTrust::Alone,
        }
    }

    /// The support of the contradicting frames together with this one; `None` if it does not agree with them.
    fn support_with(&self, frame: &RgbdFrame<'_>, pose: &LocalPose, settings: &MemorySettings) -> Option<u8> {
        let agreements = self.contradicting.iter().map(|sketch| sketch.depth_agreement(frame, pose, settings));
        let best = agreements.flatten().reduce(f32::max);
        match best {
            None if self.contradicting.is_empty() => Some(0),
            None => Some(self.support.saturating_add(INCOMPARABLE_SUPPORT)),
            Some(best) if best >= MIN_AGREEMENT => Some(self.support.saturating_add(AGREEING_SUPPORT)),
            Some(_) => None,
        }
    }

    /// The transform to the world of the frame's pose from that of earlier poses, if they differ. The map's coordinates have
    /// this `origin`.
    pub fn jump(&self, frame: &RgbdFrame<'_>, origin: DVec3, settings: &MemorySettings) -> Option<Pose> {
        let previous = self.previous.as_ref()?;
        let agreement = |pose: &LocalPose| previous.sketch.agreement(frame, pose, settings);
        // Of a frame that should show another place nothing can be said: places look alike.
        let reported_pose = frame.world_from_camera().relative_to(origin);
        let still = previous.sketch.map_from_camera;
        let is_elsewhere = reported_pose.translation().distance(still.translation()) >= MAX_STEP;
        let reported = agreement(&reported_pose).or(is_elsewhere.then_some(0.0))?;
        let gain = |pose: &LocalPose| {
            let found = agreement(pose).unwrap_or(0.0);
            if found >= MIN_AGREEMENT_AFTER_JUMP { found - reported } else { 0.0 }
        };
        if let Some(last) = &self.last_jump
            && gain(&(*last * *frame.world_from_camera()).relative_to(origin)) >= MIN_GAIN_OF_RETURN
        {
            return Some(last.inverse());
        }
        let assumed = [still, still * previous.motion];
        let [of_still, of_moving] = [gain(&assumed[0]), gain(&assumed[1])];
        let (best, pose) = if of_moving > of_still { (of_moving, assumed[1]) } else { (of_still, assumed[0]) };
        let has_jumped = best >= MIN_GAIN_OF_JUMP && is_jump(&pose, &reported_pose);
        has_jumped.then(|| *frame.world_from_camera() * pose.at(origin).inverse())
    }

    /// Adds the ids of the previous frame to what the map expects, if the frame contradicts the map: where that expects
    /// nothing.
    pub fn expect(&self, recall: &mut Recall<'_>, settings: &MemorySettings) {
        let Some(previous) = &self.previous else { return };
        recall.links_previous = recall.contradicts_map || is_other_surface(recall, settings);
        if !recall.links_previous {
            return;
        }
        let ids = previous.seen_from(recall.frame, &recall.map_from_camera, settings);
        let belief = recall.belief.segments.pixels_mut().iter_mut().zip(recall.belief.confidence.pixels_mut());
        for ((segment, confidence), id) in belief.zip(ids.pixels()) {
            if *segment == 0 && *id != 0 {
                (*segment, *confidence) = (*id, CONFIDENCE);
            }
        }
    }

    /// Records a frame with its predictions.
    pub fn record(&mut self, recall: &Recall<'_>, predicted: &SegmentMap, settings: &MemorySettings) {
        let frame = recall.frame;
        let sketch = Sketch::new(frame, &recall.map_from_camera);
        if recall.contradicts_map {
            match self.support_with(frame, &recall.map_from_camera, settings) {
                Some(support) => self.support = support,
                None => {
                    self.contradicting.clear();
                    self.support = 0;
                }
            }
            self.contradicting.push_back(sketch.clone());
            if self.contradicting.len() > MAX_CONTRADICTING {
                self.contradicting.pop_front();
            }
        } else {
            self.contradicting.clear();
            self.support = 0;
        }
        let before = self.previous.as_ref().map(|previous| previous.sketch.map_from_camera);
        let motion = before.map_or(LocalPose::IDENTITY, |before| before.inverse() * sketch.map_from_camera);
        let ids = predicted.map(|id| if *id == ABSTAIN { 0 } else { *id });
        self.previous = Some(PreviousFrame { sketch, ids, motion, is_linked: recall.links_previous });
    }

    /// Ids that must not be forgotten, though nothing else in the memory may have them, in increasing order.
    pub fn held_ids(&self) -> BTreeSet<SegmentId> {
        let held = self.previous.as_ref().filter(|previous| previous.is_linked);
        held.map_or_else(BTreeSet::new, |previous| previous.ids.areas().into_keys().collect())
    }

    /// Moves everything along with the map, to other coordinates.
    pub fn transform(&mut self, new_from_old: &LocalPose) {
        let previous = self.previous.iter_mut().map(|previous| &mut previous.sketch);
        for sketch in previous.chain(&mut self.contradicting) {
            sketch.map_from_camera = *new_from_old * sketch.map_from_camera;
        }
    }

    /// Counts the frames in a row that were taken far from the map.
    pub fn count_far_frame(&mut self, is_far: bool) -> u8 {
        self.far_frames = if is_far { self.far_frames.saturating_add(1) } else { 0 };
        self.far_frames
    }

    /// Records a jump, which may be undone.
    pub fn note_jump(&mut self, jump: &Pose) {
        self.last_jump = Some(*jump);
    }
}

impl PreviousFrame {
    /// The ids as the camera of `frame` sees them, `[height, width]`: of pixels where both frames show the same surface,
    /// with the camera moved by the relative pose or not at all, whichever fits more pixels.
    fn seen_from(&self, frame: &RgbdFrame<'_>, moved: &LocalPose, settings: &MemorySettings) -> SegmentMap {
        let still = self.sketch.map_from_camera;
        let agreement = |pose: &LocalPose| self.sketch.agreement(frame, pose, settings).unwrap_or(0.0);
        let pose = if agreement(moved) >= agreement(&still) { *moved } else { still };
        let previous_from_current = still.inverse() * pose;
        SegmentMap::from_fn(frame.width(), frame.height(), |column, row| {
            let pixel = self.sketch.same_surface(frame, (column, row), &previous_from_current, settings);
            pixel.map_or(0, |pixel| self.ids[pixel])
        })
    }
}

/// Whether two poses are too far apart for successive frames.
fn is_jump(one: &LocalPose, other: &LocalPose) -> bool {
    let step = one.inverse() * *other;
    let turn = Quat::from_mat3(&step.rotation()).to_axis_angle().1;
    step.translation().length() >= MIN_JUMP || turn >= MIN_TURN_OF_JUMP
}

/// Whether most of what the map shows has another depth than the frame.
fn is_other_surface(recall: &Recall<'_>, settings: &MemorySettings) -> bool {
    let (mut covered, mut differs) = (0usize, 0usize);
    let rendered = recall.depth.pixels().iter().zip(recall.silhouette.pixels());
    for ((rendered, silhouette), observed) in rendered.zip(recall.frame.depth().pixels()) {
        if *silhouette >= settings.growth_silhouette && *observed > 0.0 {
            covered += 1;
            differs += usize::from((observed - rendered).abs() > settings.same_surface_margin(*rendered));
        }
    }
    differs as f32 > MAX_DISAGREEMENT * covered as f32
}
