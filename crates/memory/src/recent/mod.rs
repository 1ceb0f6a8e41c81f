//! The last frames, independent of the map. When a frame contradicts the map, they decide which of the two is wrong.
//!
//! - **Jump** ([`RecentFrames::jump`]): the frame looks as if the camera had hardly moved, but its pose says otherwise.
//!   The poses have moved to other coordinates, as after a correction by SLAM. The map moves with them; nothing is
//!   lost.
//! - **Contradiction** ([`RecentFrames::trust`]): the frame sees through more than half of the Gaussians that it sees
//!   or sees through. A single such frame has a wrong pose or depth. If several agree, the map is wrong.
//! - **Expected** ([`RecentFrames::expected_ids`]): where the map shows no id, the ids of the previous frame are expected,
//!   moved by the relative pose or not at all, whichever fits better.
//!
//! None of this is in the paper. Positions are in the coordinates of the map.

mod saved;
mod sketch;

pub(crate) use saved::{SavedIdRuns, SavedPreviousFrame, SavedRecentFrames, SavedSketch};

use crate::MemorySettings;
use crate::recall::Recall;
use crate::removal::{CONTRADICTION, FrameTrust};
use crate::settings::COVERED;
use glam::{DVec3, Quat};
use sketch::Sketch;
use splatseg_geometry::{LocalPose, Pose, RgbdFrame, SegmentId, SegmentMap};
use std::collections::{BTreeMap, BTreeSet, VecDeque};

/// Two frames agree if this share of the samples that both show has the same depth (and, for a jump, the same colour).
const MIN_AGREEMENT: f32 = 0.6;

/// Minimum gain in agreement for a jump: the poses have jumped if another motion of the camera agrees with the previous
/// frame in this share of samples more than the motion given by the pose, and the two differ by [`MIN_JUMP`].
const MIN_GAIN_OF_JUMP: f32 = 0.16;

/// Minimum difference of the two motions for a jump: metres plus radians of rotation.
const MIN_JUMP: f32 = 0.1;

/// Motion from one frame to the next, metres, that is impossible while the image stays the same.
const MAX_STEP: f32 = 100.0;

/// Number of frames in a row that are trusted if they contradict the map but not each other.
const CONFIRMING_FRAMES: usize = 3;

/// The last frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RecentFrames {
    previous: Option<PreviousFrame>,
    /// The last frames in a row that contradict the map but not each other, newest last.
    contradicting: VecDeque<Sketch>,
    /// Number of frames in a row that were taken far from the map.
    far_frames: u8,
    /// The ids of the latest frame, `[height, width]`, if its pose was unknown.
    without_pose: Option<SegmentMap>,
    /// True if the next frame was taken at another time than the latest one: from [`Self::start_session`] to that frame. Not
    /// saved.
    starts_session: bool,
}

/// The previous frame.
#[derive(Clone, Debug, PartialEq)]
struct PreviousFrame {
    sketch: Sketch,
    /// Its predictions, `[height, width]`.
    ids: SegmentMap,
    /// The camera's motion before this frame: previous camera from camera.
    motion: LocalPose,
    /// True if masks of the next frame may get its ids although no Gaussian has them yet.
    is_linked: bool,
}

impl RecentFrames {
    /// Trust in a frame taken at `pose` if it contradicts the map.
    pub fn trust(&self, frame: &RgbdFrame<'_>, pose: &LocalPose, settings: &MemorySettings) -> FrameTrust {
        let is_confirmed = self.contradicting.len() + 1 >= CONFIRMING_FRAMES && self.agrees(frame, pose, settings);
        if is_confirmed { FrameTrust::Confirmed } else { FrameTrust::Alone }
    }

    /// True if a frame agrees with one of the contradicting frames, or shares too little with all of them to compare.
    fn agrees(&self, frame: &RgbdFrame<'_>, pose: &LocalPose, settings: &MemorySettings) -> bool {
        let agreements = self.contradicting.iter().map(|sketch| sketch.depth_agreement(frame, pose, settings));
        agreements.flatten().reduce(f32::max).is_none_or(|best| best >= MIN_AGREEMENT)
    }

    /// Returns the transform from the world of earlier poses to the world of the frame's pose, if they differ. `origin`
    /// is the origin of the map's coordinates.
    pub fn jump(&self, frame: &RgbdFrame<'_>, origin: DVec3, settings: &MemorySettings) -> Option<Pose> {
        let previous = self.previous.as_ref()?;
        let agreement = |pose: &LocalPose| previous.sketch.agreement(frame, pose, settings);
        // A frame whose pose shows another place cannot be judged, since places look alike, unless the step is
        // impossible.
        let reported_pose = frame.world_from_camera().relative_to(origin);
        let still = previous.sketch.map_from_camera;
        let is_elsewhere = reported_pose.translation().distance(still.translation()) >= MAX_STEP;
        let reported = agreement(&reported_pose).or(is_elsewhere.then_some(0.0))?;
        let gain = |pose: &LocalPose| {
            let found = agreement(pose).unwrap_or(0.0);
            if found >= MIN_AGREEMENT { found - reported } else { 0.0 }
        };
        let assumed = [still, still * previous.motion];
        let [of_still, of_moving] = [gain(&assumed[0]), gain(&assumed[1])];
        let (best, pose) = if of_moving > of_still { (of_moving, assumed[1]) } else { (of_still, assumed[0]) };
        let has_jumped = best >= MIN_GAIN_OF_JUMP && is_jump(&pose, &reported_pose);
        has_jumped.then(|| *frame.world_from_camera() * pose.at(origin).inverse())
    }

    /// Returns the ids of the previous frame as the camera of the frame sees them, `[height, width]`, 0 for none, if the
    /// frame contradicts the map. They are to be expected where the map shows no id.
    pub fn expected_ids(&self, recall: &Recall<'_>, settings: &MemorySettings) -> Option<SegmentMap> {
        let previous = self.previous.as_ref()?;
        let contradicts = recall.contradicts_map || is_other_surface(recall, settings);
        contradicts.then(|| previous.seen_from(recall.frame, &recall.map_from_camera, settings))
    }

    /// Records a frame with its predictions.
    pub fn record(&mut self, recall: &Recall<'_>, predicted: &SegmentMap, settings: &MemorySettings) {
        let frame = recall.frame;
        let sketch = Sketch::new(frame, &recall.map_from_camera);
        if recall.contradicts_map {
            if !self.agrees(frame, &recall.map_from_camera, settings) {
                self.contradicting.clear();
            }
            self.contradicting.push_back(sketch.clone());
            if self.contradicting.len() > CONFIRMING_FRAMES {
                self.contradicting.pop_front();
            }
        } else {
            self.contradicting.clear();
        }
        let before = self.previous.as_ref().map(|previous| previous.sketch.map_from_camera);
        let motion = before.map_or(LocalPose::IDENTITY, |before| before.inverse() * sketch.map_from_camera);
        self.without_pose = None;
        self.starts_session = false;
        self.previous =
            Some(PreviousFrame { sketch, ids: predicted.clone(), motion, is_linked: recall.links_previous });
    }

    /// Records the ids of a frame whose pose is unknown.
    pub fn record_without_pose(&mut self, ids: &SegmentMap) {
        self.without_pose = Some(ids.clone());
        self.starts_session = false;
    }

    /// Says that the next frame was taken at another time: its image does not continue the latest one.
    pub fn start_session(&mut self) {
        self.without_pose = None;
        self.starts_session = true;
    }

    /// The ids of the latest frame, `[height, width]`, if its pose was unknown.
    pub fn ids_without_pose(&self) -> Option<&SegmentMap> {
        self.without_pose.as_ref()
    }

    /// The ids of the latest frame, `[height, width]`, unless the next one was taken at another time.
    pub fn latest_ids(&self) -> Option<&SegmentMap> {
        let previous = || self.previous.as_ref().filter(|_| !self.starts_session);
        self.without_pose.as_ref().or_else(|| Some(&previous()?.ids))
    }

    /// Returns the ids that must not be forgotten even if no Gaussian has them, in increasing order.
    pub fn held_ids(&self) -> BTreeSet<SegmentId> {
        let linked = self.previous.as_ref().filter(|previous| previous.is_linked).map(|previous| &previous.ids);
        linked.into_iter().chain(&self.without_pose).flat_map(|ids| ids.areas().into_keys()).collect()
    }

    /// Moves all frames to other coordinates, together with the map.
    pub fn transform(&mut self, new_from_old: &LocalPose) {
        let previous = self.previous.iter_mut().map(|previous| &mut previous.sketch);
        for sketch in previous.chain(&mut self.contradicting) {
            sketch.map_from_camera = *new_from_old * sketch.map_from_camera;
        }
    }

    /// Replaces ids, `names[old] = new`.
    pub fn remap(&mut self, names: &BTreeMap<SegmentId, SegmentId>) {
        let ids = self.previous.iter_mut().map(|previous| &mut previous.ids).chain(&mut self.without_pose);
        for id in ids.flat_map(|ids| ids.pixels_mut()) {
            *id = names.get(id).copied().unwrap_or(*id);
        }
    }

    /// Counts the frames in a row that were taken far from the map. Returns the count.
    pub fn count_far_frame(&mut self, is_far: bool) -> u8 {
        self.far_frames = if is_far { self.far_frames.saturating_add(1) } else { 0 };
        self.far_frames
    }
}

impl PreviousFrame {
    /// Returns the ids seen by the camera of `frame`, `[height, width]`, at pixels where both frames show the same
    /// surface. The camera is moved by the relative pose or not at all, whichever fits more samples.
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

/// True if two poses differ by at least [`MIN_JUMP`].
fn is_jump(one: &LocalPose, other: &LocalPose) -> bool {
    let step = one.inverse() * *other;
    let turn = Quat::from_mat3(&step.rotation()).to_axis_angle().1;
    step.translation().length() + turn >= MIN_JUMP
}

/// True if the map's depth differs from the frame's at most of the covered pixels.
fn is_other_surface(recall: &Recall<'_>, settings: &MemorySettings) -> bool {
    let (mut covered, mut differs) = (0usize, 0usize);
    let rendered = recall.depth.pixels().iter().zip(recall.silhouette.pixels());
    for ((rendered, silhouette), observed) in rendered.zip(recall.frame.depth().pixels()) {
        if *silhouette >= COVERED && *observed > 0.0 {
            covered += 1;
            differs += usize::from((observed - rendered).abs() > settings.tolerance_at(*rendered));
        }
    }
    differs as f32 > CONTRADICTION * covered as f32
}
