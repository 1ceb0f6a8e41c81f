//! The state of a run that is resumed, as named arrays.
//!
//! | Array | Type | |
//! |---|---|---|
//! | `state.json` | text | the latest given pose; how long the camera has been lost |
//! | `keyframes.…` | | the keyframes of the map, see `saved_keyframes.rs` |
//! | `odometry.state.json` | text | the camera's motion and what is known about it |
//! | `odometry.keyframe_0.…` to `_5.…` | | earlier frames that later ones are aligned with, as follows |
//! | `….camera.json` | text | number, pose and intrinsics |
//! | `….grey`, `….depth` | `u8`, `u16 [height, width]` | luminance; z-depth in quarters of a millimetre, 0 where missing |
//! | `….segments` | `u32 [n, 2]` | runs of pixels, row-major: id and length; missing if they are not known |
//! | `upright.votes`, `upright.looked` | `f32`, `u8 [1024]` | for each direction of the world, what votes for it as up, and whether the camera has looked there |
//! | `upright.state.json` | text | up, if it is known, and the turn of the images |
//! | `probation.…` | | the same, while a recognised place is to be confirmed: `odometry`, `keyframes`, `state.json` |

use crate::graph::Edge;
use crate::keyframe::Keyframe;
use crate::keyframes::StoredKeyframe;
use crate::lost::{LostCamera, Probation};
use crate::movers::Movers;
use crate::odometry::MAX_KEYFRAMES;
use crate::plausibility::FocalEstimate;
use crate::prior::LastFrame;
use crate::pyramid::GreyFrame;
use crate::saved_keyframes;
use crate::segment_runs::SegmentRuns;
use crate::upright::Upright;
use crate::{Odometry, TrackedPoses};
use serde::{Deserialize, Serialize};
use splatseg_files::StateBlock;
use splatseg_geometry::{Image, Intrinsics, KeyframeId, Pose};
use std::collections::VecDeque;
use std::time::Duration;

/// Saved form of [`TrackedPoses`].
pub(crate) struct SavedPoses(StateBlock);

#[derive(Serialize, Deserialize)]
struct PosesState {
    last_given: Option<Pose>,
    has_given: bool,
    lost_views: u32,
    lost_frames: u32,
    lost_since: Option<Duration>,
}

#[derive(Serialize, Deserialize)]
struct OdometryState {
    active: usize,
    last: Option<LastFrame>,
    movers: Movers,
    focal: FocalEstimate,
    awaits_segments: bool,
    next_keyframe: KeyframeId,
}

#[derive(Serialize, Deserialize)]
struct ProbationState {
    frames: u32,
    /// The relative pose of each keyframe.
    edges: Vec<Option<Edge>>,
}

#[derive(Serialize, Deserialize)]
struct KeyframeCamera {
    id: KeyframeId,
    world_from_key: Pose,
    intrinsics: Intrinsics,
}

impl SavedPoses {
    pub(crate) fn of(poses: &TrackedPoses) -> Self {
        let TrackedPoses { odometry, last_given, has_given, map, lost, upright, .. } = poses;
        let state = PosesState {
            last_given: *last_given,
            has_given: *has_given,
            lost_views: lost.views,
            lost_frames: lost.frames,
            lost_since: lost.since,
        };
        let mut block = StateBlock::default();
        block.put_json("state.json", &state);
        block.put_block("keyframes", saved_keyframes::block(map));
        block.put_block("odometry", odometry_block(odometry));
        block.put_block("upright", upright.block());
        if let Some(probation) = &lost.probation {
            block.put_block("probation", probation_block(probation));
        }
        Self(block)
    }

    /// The state as bytes.
    pub(crate) fn to_bytes(&self) -> Option<Vec<u8>> {
        self.0.to_bytes().ok()
    }

    /// Reads the bytes of [`Self::to_bytes`].
    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Self, String> {
        StateBlock::from_bytes(bytes).map(Self).map_err(|error| error.to_string())
    }

    /// Restores the state.
    pub(crate) fn restore(self, poses: &mut TrackedPoses) -> Result<(), String> {
        let Self(mut block) = self;
        let PosesState { last_given, has_given, lost_views, lost_frames, lost_since } = json(&block, "state.json")?;
        let probation = block.take_block("probation");
        let probation = if probation.is_empty() { None } else { Some(probation_of(probation)?) };
        let map = saved_keyframes::map_of(&block.take_block("keyframes"))?;
        poses.odometry = odometry_of(block.take_block("odometry"))?;
        poses.upright = Upright::of_block(&block.take_block("upright"))?;
        poses.map = map;
        poses.lost = LostCamera { probation, views: lost_views, frames: lost_frames, since: lost_since };
        (poses.last_given, poses.has_given) = (last_given, has_given);
        Ok(())
    }
}

/// A text that is never missing.
fn json<T: serde::de::DeserializeOwned>(block: &StateBlock, name: &str) -> Result<T, String> {
    let found = block.get_json(name).map_err(|error| error.to_string())?;
    found.ok_or_else(|| format!("{name} is missing"))
}

fn probation_block(probation: &Probation) -> StateBlock {
    let keyframes: Vec<&StoredKeyframe> = probation.keyframes.iter().map(|(keyframe, _)| keyframe).collect();
    let edges = probation.keyframes.iter().map(|(_, edge)| edge.clone()).collect();
    let mut block = StateBlock::default();
    block.put_json("state.json", &ProbationState { frames: probation.frames, edges });
    block.put_block("keyframes", saved_keyframes::keyframes_block(&keyframes));
    block.put_block("odometry", odometry_block(&probation.odometry));
    block
}

fn probation_of(mut block: StateBlock) -> Result<Probation, String> {
    let ProbationState { frames, edges } = json(&block, "state.json")?;
    let keyframes = saved_keyframes::keyframes_of(&block.take_block("keyframes"))?;
    if keyframes.len() != edges.len() {
        return Err(format!("probation: {} keyframes with {} relative poses", keyframes.len(), edges.len()));
    }
    let odometry = odometry_of(block.take_block("odometry"))?;
    Ok(Probation { odometry, keyframes: keyframes.into_iter().zip(edges).collect(), frames })
}

fn odometry_block(odometry: &Odometry) -> StateBlock {
    let Odometry { keyframes, active, last, movers, focal, awaits_segments, next_keyframe, .. } = odometry;
    let state = OdometryState {
        active: *active,
        last: *last,
        movers: movers.clone(),
        focal: *focal,
        awaits_segments: *awaits_segments,
        next_keyframe: *next_keyframe,
    };
    let mut block = StateBlock::default();
    block.put_json("state.json", &state);
    for (index, keyframe) in keyframes.iter().enumerate() {
        block.put_block(&keyframe_name(index), keyframe_block(keyframe));
    }
    block
}

fn keyframe_name(index: usize) -> String {
    format!("keyframe_{index}")
}

fn odometry_of(mut block: StateBlock) -> Result<Odometry, String> {
    let state: OdometryState = json(&block, "state.json")?;
    let OdometryState { active, last, movers, focal, awaits_segments, next_keyframe } = state;
    let blocks = (0..MAX_KEYFRAMES).map(|index| block.take_block(&keyframe_name(index)));
    let keyframes: VecDeque<Keyframe> =
        blocks.take_while(|block| !block.is_empty()).map(|block| keyframe_of(&block)).collect::<Result<_, _>>()?;
    if active >= keyframes.len().max(1) {
        return Err(format!("keyframe {active} of {} is in use", keyframes.len()));
    }
    Ok(Odometry { keyframes, active, reference: None, last, movers, focal, awaits_segments, next_keyframe, made: None })
}

fn keyframe_block(keyframe: &Keyframe) -> StateBlock {
    let GreyFrame { grey, depth, intrinsics } = &keyframe.frame;
    let (id, world_from_key, intrinsics) = (keyframe.id, keyframe.world_from_key, *intrinsics);
    let mut block = StateBlock::default();
    block.put_json("camera.json", &KeyframeCamera { id, world_from_key, intrinsics });
    block.put("grey", &[grey.width()], grey.pixels().iter().copied());
    block.put("depth", &[depth.width()], depth.pixels().iter().copied());
    if let Some(segments) = &keyframe.segments {
        block.put("segments", &[2], segments.runs().iter().flat_map(|(id, length)| [*id, *length]));
    }
    block
}

fn keyframe_of(block: &StateBlock) -> Result<Keyframe, String> {
    let text = |error: splatseg_files::StateError| error.to_string();
    let KeyframeCamera { id, world_from_key, intrinsics } = json(block, "camera.json")?;
    let intrinsics = intrinsics.validated().map_err(|error| error.to_string())?;
    let (width, height) = (intrinsics.width, intrinsics.height);
    let grey = Image::from_pixels(width, height, block.get_rows("grey", height, &[width]).map_err(text)?);
    let depth = Image::from_pixels(width, height, block.get_rows("depth", height, &[width]).map_err(text)?);
    let (grey, depth) = (grey.map_err(|error| error.to_string())?, depth.map_err(|error| error.to_string())?);
    let runs: Vec<[u32; 2]> = block.get_tuples("segments").map_err(text)?;
    let runs: Vec<(u32, u32)> = runs.into_iter().map(|[id, length]| (id, length)).collect();
    let segments = (!runs.is_empty()).then(|| SegmentRuns::from_runs(runs));
    if let Some(found) = segments.as_ref().map(SegmentRuns::len).filter(|found| *found != (width * height) as u64) {
        return Err(format!("a keyframe has {found} ids for {width}x{height} pixels"));
    }
    Ok(Keyframe { id, world_from_key, frame: GreyFrame { grey, depth, intrinsics }, segments })
}
