//! Which things of the room move, and how: those that the camera sees well, in an order that the seed decides.

use super::motion::{Motion, Mover};
use super::room::{Lane, Room};
use super::solids::Ray;
use glam::Vec2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use splatseg_geometry::{Intrinsics, LocalPose, SegmentId};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// A stream of random numbers that neither the furnishing (0) nor the noise (rows of the image) draws from.
const RANDOM_STREAM: u64 = u64::MAX;
/// A slide's way from frame to frame, metres: less than any thing's width, so that it overlaps itself.
const STEP_M: f32 = 0.03;
/// A slide takes at most this many steps in one direction (0.6 m).
const MOST_STEPS: usize = 20;
/// Things with room for this many steps (0.3 m) are preferred...
const ENOUGH_STEPS: usize = 10;
/// ...and things with room for fewer than this (0.09 m) do not slide.
const FEWEST_STEPS: usize = 3;
/// Directions in which room for a slide is looked for.
const DIRECTIONS: usize = 16;

/// What the camera sees is judged by images of this width and height, pixels...
const GRID: (usize, usize) = (48, 36);
/// ...of frames this far apart...
const VIEW_STRIDE: usize = 4;
/// ...among the last so many before things come and go, and among the first so many after: one round of the camera.
const VIEW_FRAMES: usize = 48;
/// A thing is seen clearly if it covers at least this share of those images, before as well as after.
const CLEAR_SHARE: f32 = 0.003;

/// When things come and go: from a third to half of the video, but not in frame 0.
#[derive(Clone, Copy, Debug)]
struct ChangeTime {
    earliest: usize,
    latest: usize,
}

impl ChangeTime {
    fn of_video(frames: usize) -> Self {
        Self { earliest: (frames / 3).max(1), latest: (frames / 2).max(1) }
    }

    fn draw(self, random: &mut ChaCha8Rng) -> usize {
        random.random_range(self.earliest..=self.latest)
    }
}

/// A thing that may move.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    id: SegmentId,
    seen_clearly: bool,
}

/// The movers, in the order slide, vanish, appear, slide, ...; if nothing has room to slide, a thing vanishes instead.
/// `None` if there are not `count` things that may move.
pub(super) fn choose(
    room: &Room,
    intrinsics: &Intrinsics,
    frames: usize,
    pose_at: impl Fn(usize) -> LocalPose,
    seed: u64,
    count: usize,
) -> Option<Vec<Mover>> {
    if count == 0 {
        return Some(Vec::new());
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(RANDOM_STREAM);
    let change = ChangeTime::of_video(frames);
    let mut waiting = candidates(room, intrinsics, frames, change, pose_at, &mut random);
    if waiting.len() < count {
        return None;
    }
    let mut lanes: BTreeMap<SegmentId, Lane> = room.lanes();
    let mut movers = Vec::with_capacity(count);
    for turn in 0..count {
        // Drawn for every mover, so that one's fate does not change the next one's.
        let (frame, start_angle) = (change.draw(&mut random), random.random_range(0.0..std::f32::consts::TAU));
        let slide = if turn % 3 == 0 { best_slide(room, &waiting, &lanes, start_angle) } else { None };
        let (place, motion) = match slide {
            Some((place, step, steps)) => {
                lanes.entry(waiting[place].id).and_modify(|lane| lane.end += step * steps as f32);
                (place, Motion::Slide { step: step.extend(0.0), steps })
            }
            None if turn % 3 == 2 => (0, Motion::Appear { frame }),
            None => (0, Motion::Vanish { frame }),
        };
        movers.push(Mover { id: waiting.remove(place).id, motion });
    }
    Some(movers)
}

/// The things that carry nothing: first those seen clearly, in any order, then the others, best seen first.
fn candidates(
    room: &Room,
    intrinsics: &Intrinsics,
    frames: usize,
    change: ChangeTime,
    pose_at: impl Fn(usize) -> LocalPose,
    random: &mut ChaCha8Rng,
) -> Vec<Candidate> {
    let before: Vec<LocalPose> =
        (change.earliest.saturating_sub(VIEW_FRAMES)..change.earliest).step_by(VIEW_STRIDE).map(&pose_at).collect();
    let after: Vec<LocalPose> = (change.latest..frames).take(VIEW_FRAMES).step_by(VIEW_STRIDE).map(&pose_at).collect();
    let (before, after) = (shares_seen(room, intrinsics, &before), shares_seen(room, intrinsics, &after));
    let share = |shares: &BTreeMap<SegmentId, f32>, id: SegmentId| shares.get(&id).copied().unwrap_or(0.0);
    let mut ranked: Vec<(f32, SegmentId)> =
        room.carrying_nothing().map(|id| (share(&before, id).min(share(&after, id)), id)).collect();
    ranked.sort_by(|first, second| second.0.total_cmp(&first.0).then(first.1.cmp(&second.1)));
    let clear_count = ranked.iter().take_while(|(share, _)| *share >= CLEAR_SHARE).count();
    // A shuffle (Fisher and Yates) of the clearly seen.
    for last in (1..clear_count).rev() {
        ranked.swap(last, random.random_range(0..=last));
    }
    ranked.into_iter().map(|(share, id)| Candidate { id, seen_clearly: share >= CLEAR_SHARE }).collect()
}

/// The share of all rays that each solid has, over all `poses`.
fn shares_seen(room: &Room, intrinsics: &Intrinsics, poses: &[LocalPose]) -> BTreeMap<SegmentId, f32> {
    let (width, height) = GRID;
    let coarse = intrinsics.resized(width, height);
    let seen_from = |pose: &LocalPose| {
        let mut counts = BTreeMap::<SegmentId, usize>::new();
        for index in 0..width * height {
            let pixel = Vec2::new((index % width) as f32, (index / width) as f32);
            let ray = Ray { origin: pose.translation(), direction: pose.rotation() * coarse.unproject(pixel, 1.0) };
            if let Some((solid, _)) = room.first_hit(ray) {
                *counts.entry(solid.id).or_default() += 1;
            }
        }
        counts
    };
    let views: Vec<BTreeMap<SegmentId, usize>> = poses.par_iter().map(seen_from).collect();
    let rays = (width * height * poses.len()).max(1) as f32;
    let mut shares = BTreeMap::<SegmentId, f32>::new();
    for (id, count) in views.into_iter().flatten() {
        *shares.entry(id).or_default() += count as f32 / rays;
    }
    shares
}

/// The place in `waiting`, the step (metres, world x and y) and the number of steps of the thing that slides best.
fn best_slide(
    room: &Room,
    waiting: &[Candidate],
    lanes: &BTreeMap<SegmentId, Lane>,
    start_angle: f32,
) -> Option<(usize, Vec2, usize)> {
    let longest = |id: SegmentId| {
        let directions = (0..DIRECTIONS).map(|number| {
            let step =
                STEP_M * Vec2::from_angle(start_angle + number as f32 / DIRECTIONS as f32 * std::f32::consts::TAU);
            (step, room.free_steps(id, step, MOST_STEPS, lanes))
        });
        // The first of the longest ones.
        directions.min_by_key(|(_, steps)| Reverse(*steps))
    };
    waiting
        .iter()
        .enumerate()
        .filter_map(|(place, candidate)| longest(candidate.id).map(|(step, steps)| (place, step, steps)))
        .filter(|(_, _, steps)| *steps >= FEWEST_STEPS)
        .min_by_key(|(place, _, steps)| (Reverse(waiting[*place].seen_clearly), Reverse((*steps).min(ENOUGH_STEPS))))
}
