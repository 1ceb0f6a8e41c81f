//! Choice of the things that move, and how: clearly visible things first, in an order determined by the seed.

use super::furniture::Lane;
use super::motion::{Motion, Mover};
use super::scenery::Scenery;
use super::visibility::Visibility;
use super::walk::Walk;
use super::{Speed, SyntheticSettings};
use glam::Vec2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use splatseg_geometry::{Intrinsics, LocalPose, SegmentId};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// Random number stream, separate from those of the furnishing (0) and the noise (rows of the image).
const RANDOM_STREAM: u64 = u64::MAX;
/// Displacement per frame of a slide at speed 1, metres. Less than any thing's width, so that it overlaps itself.
const STEP_M: f32 = 0.03;
/// Frames per such step where the camera is that of a video at 30 Hz: 24 cm/s.
const VIDEO_FRAMES_PER_STEP: usize = 4;
/// Maximum number of steps of a slide in one direction (0.6 m).
const MAX_STEPS: usize = 20;
/// Things with room for this many steps (0.3 m) are preferred...
const ENOUGH_STEPS: usize = 10;
/// ...and things with room for fewer than this (0.09 m) do not slide.
const MIN_STEPS: usize = 3;
/// Number of directions tried for a slide.
const DIRECTIONS: usize = 16;

/// Visibility is measured in every Nth frame (at speed 1)...
const VIEW_STRIDE: usize = 4;
/// ...in a round of the camera before things come and go, and in a round after. Where things only slide, in this
/// number of frames of the first round.
const VIDEO_VIEWS: usize = 60;
/// A thing is clearly visible if it covers at least this fraction of those images, both before and after.
const MIN_VISIBLE_FRACTION: f32 = 0.003;

/// Range of frames in which things come and go: from a third to half of the video, but not frame 0.
#[derive(Clone, Copy, Debug)]
struct ChangeTime {
    earliest: usize,
    latest: usize,
}

impl ChangeTime {
    fn for_video(frames: usize) -> Self {
        Self { earliest: (frames / 3).max(1), latest: (frames / 2).max(1) }
    }

    /// Returns the camera's poses in the round before things come and go, and in the round after.
    fn views(
        self,
        frames: usize,
        (walk, speed): (&Walk, Speed),
        pose_at: impl Fn(usize) -> LocalPose,
    ) -> (Vec<LocalPose>, Vec<LocalPose>) {
        let round = speed.frames_for(walk.frames());
        if walk.is_video() {
            let views: Vec<LocalPose> =
                (0..frames.min(round)).step_by((round / VIDEO_VIEWS).max(1)).map(pose_at).collect();
            return (views.clone(), views);
        }
        let stride = speed.frames_for(VIEW_STRIDE);
        let before = (self.earliest.saturating_sub(round)..self.earliest).step_by(stride).map(&pose_at).collect();
        let after = (self.latest..frames).take(round).step_by(stride).map(&pose_at).collect();
        (before, after)
    }

    fn draw(self, random: &mut ChaCha8Rng) -> usize {
        random.random_range(self.earliest..=self.latest)
    }
}

/// A thing that may move.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    id: SegmentId,
    clearly_visible: bool,
}

/// Chooses [`SyntheticSettings::moving`] movers, in the order slide, vanish, appear, slide, ..., or only slides in a
/// tour; if nothing has space to slide, a thing vanishes or appears instead. `pose_at` returns the camera's pose in a frame. Returns `None` if fewer things may
/// move.
pub(super) fn choose(
    scenery: &Scenery,
    intrinsics: &Intrinsics,
    settings: &SyntheticSettings,
    pose_at: impl Fn(usize) -> LocalPose,
) -> Option<Vec<Mover>> {
    let SyntheticSettings { frames, seed, moving: count, speed, .. } = *settings;
    if count == 0 {
        return Some(Vec::new());
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(RANDOM_STREAM);
    let change = ChangeTime::for_video(frames);
    let (before, after) = change.views(frames, (&scenery.walk, speed), pose_at);
    let fractions = |poses: &[LocalPose]| Visibility::new(scenery, intrinsics, poses).fractions();
    let visible = (fractions(&before), fractions(&after));
    let mut waiting = candidates(scenery, visible, &mut random);
    if waiting.len() < count {
        return None;
    }
    let mut lanes: BTreeMap<SegmentId, Lane> = scenery.lanes();
    let mut movers = Vec::with_capacity(count);
    for turn in 0..count {
        // Drawn for every mover, so that the motion of one does not affect the next.
        let (frame, start_angle) = (change.draw(&mut random), random.random_range(0.0..std::f32::consts::TAU));
        let slide = if turn % 3 == 0 || scenery.walk.is_video() {
            best_slide(scenery, &waiting, &lanes, start_angle)
        } else {
            None
        };
        let (place, motion) = match slide {
            Some((place, step, steps)) => {
                lanes.entry(waiting[place].id).and_modify(|lane| lane.end += step * steps as f32);
                // Never farther than at speed 1, where it is clear of everything.
                let per_step = if scenery.walk.is_video() { VIDEO_FRAMES_PER_STEP } else { 1 };
                let step = step.extend(0.0) * speed.factor() as f32 / per_step as f32;
                (place, Motion::Slide { step, steps: speed.frames_for(steps * per_step) })
            }
            None if turn % 3 == 2 => (0, Motion::Appear { frame }),
            None => (0, Motion::Vanish { frame }),
        };
        movers.push(Mover { id: waiting.remove(place).id, motion });
    }
    Some(movers)
}

/// Returns the things on which nothing stands: first those clearly visible, shuffled, then the others, most visible
/// first. `before` and `after` are the fractions of the rays that hit each solid.
fn candidates(
    scenery: &Scenery,
    (before, after): (BTreeMap<SegmentId, f32>, BTreeMap<SegmentId, f32>),
    random: &mut ChaCha8Rng,
) -> Vec<Candidate> {
    let share = |shares: &BTreeMap<SegmentId, f32>, id: SegmentId| shares.get(&id).copied().unwrap_or(0.0);
    let mut ranked: Vec<(f32, SegmentId)> =
        scenery.unloaded_things().map(|id| (share(&before, id).min(share(&after, id)), id)).collect();
    ranked.sort_by(|first, second| second.0.total_cmp(&first.0).then(first.1.cmp(&second.1)));
    let clear_count = ranked.iter().take_while(|(share, _)| *share >= MIN_VISIBLE_FRACTION).count();
    // Fisher-Yates shuffle of the clearly visible things.
    for last in (1..clear_count).rev() {
        ranked.swap(last, random.random_range(0..=last));
    }
    ranked.into_iter().map(|(share, id)| Candidate { id, clearly_visible: share >= MIN_VISIBLE_FRACTION }).collect()
}

/// Returns the index in `waiting`, the step (metres, world x and y) and the number of steps of the best slide.
fn best_slide(
    scenery: &Scenery,
    waiting: &[Candidate],
    lanes: &BTreeMap<SegmentId, Lane>,
    start_angle: f32,
) -> Option<(usize, Vec2, usize)> {
    let longest = |id: SegmentId| {
        let directions = (0..DIRECTIONS).map(|number| {
            let step =
                STEP_M * Vec2::from_angle(start_angle + number as f32 / DIRECTIONS as f32 * std::f32::consts::TAU);
            (step, scenery.free_steps(id, step, MAX_STEPS, lanes))
        });
        // Ties go to the first.
        directions.min_by_key(|(_, steps)| Reverse(*steps))
    };
    waiting
        .iter()
        .enumerate()
        .filter_map(|(place, candidate)| longest(candidate.id).map(|(step, steps)| (place, step, steps)))
        .filter(|(_, _, steps)| *steps >= MIN_STEPS)
        .min_by_key(|(place, _, steps)| (Reverse(waiting[*place].clearly_visible), Reverse((*steps).min(ENOUGH_STEPS))))
}
