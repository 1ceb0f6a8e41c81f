//! The state of a run that is resumed.

use crate::graph::Edge;
use crate::keyframe::Keyframe;
use crate::lost::{Lost, Probation};
use crate::movers::Movers;
use crate::odometry::MAX_KEYFRAMES;
use crate::plausibility::FocalEstimate;
use crate::prior::LastFrame;
use crate::pyramid::GreyFrame;
use crate::saved_keyframes::{SavedKeyframes, SavedStoredKeyframe};
use crate::segment_runs::SegmentRuns;
use crate::{Odometry, TrackedPoses};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Image, Intrinsics, KeyframeId, Pose};
use std::time::Duration;

/// Saved form of [`TrackedPoses`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedPoses {
    odometry: SavedOdometry,
    last_given: Option<Pose>,
    has_given: bool,
    map: SavedKeyframes,
    lost: SavedLost,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedOdometry {
    keyframes: Vec<SavedKeyframe>,
    active: usize,
    last: Option<LastFrame>,
    movers: Movers,
    focal: FocalEstimate,
    awaits_segments: bool,
    next_keyframe: KeyframeId,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedLost {
    probation: Option<SavedProbation>,
    views: u32,
    frames: u32,
    since: Option<Duration>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedProbation {
    odometry: SavedOdometry,
    keyframes: Vec<(SavedStoredKeyframe, Option<Edge>)>,
    frames: u32,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedKeyframe {
    id: KeyframeId,
    world_from_key: Pose,
    intrinsics: Intrinsics,
    /// One byte per pixel, in Base64.
    grey: String,
    /// Two bytes per pixel, the lower one first, in Base64.
    depth: String,
    segments: Option<SegmentRuns>,
}

impl SavedPoses {
    pub(crate) fn of(poses: &TrackedPoses) -> Self {
        let TrackedPoses { odometry, last_given, has_given, map, lost, .. } = poses;
        let probation = lost.probation.as_ref().map(|probation| SavedProbation {
            odometry: SavedOdometry::of(&probation.odometry),
            keyframes: probation
                .keyframes
                .iter()
                .map(|(keyframe, edge)| (SavedStoredKeyframe::of(keyframe), edge.clone()))
                .collect(),
            frames: probation.frames,
        });
        Self {
            odometry: SavedOdometry::of(odometry),
            last_given: *last_given,
            has_given: *has_given,
            map: SavedKeyframes::of(map),
            lost: SavedLost { probation, views: lost.views, frames: lost.frames, since: lost.since },
        }
    }

    /// Restores the state.
    pub(crate) fn restore(self, poses: &mut TrackedPoses) -> Result<(), String> {
        let Self { odometry, last_given, has_given, map, lost } = self;
        let SavedLost { probation, views, frames, since } = lost;
        let probation = probation.map(SavedProbation::restored).transpose()?;
        poses.odometry = odometry.restored()?;
        poses.map = map.restored()?;
        poses.lost = Lost { probation, views, frames, since };
        (poses.last_given, poses.has_given) = (last_given, has_given);
        Ok(())
    }
}

impl SavedProbation {
    fn restored(self) -> Result<Probation, String> {
        let Self { odometry, keyframes, frames } = self;
        let keyframes = keyframes.into_iter().map(|(keyframe, edge)| Ok((keyframe.restored()?, edge)));
        Ok(Probation { odometry: odometry.restored()?, keyframes: keyframes.collect::<Result<_, String>>()?, frames })
    }
}

impl SavedOdometry {
    fn of(odometry: &Odometry) -> Self {
        let Odometry { keyframes, active, last, movers, focal, awaits_segments, next_keyframe, .. } = odometry;
        Self {
            keyframes: keyframes.iter().map(SavedKeyframe::of).collect(),
            active: *active,
            last: *last,
            movers: movers.clone(),
            focal: *focal,
            awaits_segments: *awaits_segments,
            next_keyframe: *next_keyframe,
        }
    }

    fn restored(self) -> Result<Odometry, String> {
        let Self { keyframes, active, last, movers, focal, awaits_segments, next_keyframe } = self;
        if keyframes.len() > MAX_KEYFRAMES || active >= keyframes.len().max(1) {
            let count = keyframes.len();
            return Err(format!("keyframe {active} of {count} is in use, expected at most {MAX_KEYFRAMES} keyframes"));
        }
        let keyframes = keyframes.into_iter().map(SavedKeyframe::restored).collect::<Result<_, _>>()?;
        Ok(Odometry {
            keyframes,
            active,
            reference: None,
            last,
            movers,
            focal,
            awaits_segments,
            next_keyframe,
            made: None,
        })
    }
}

impl SavedKeyframe {
    fn of(keyframe: &Keyframe) -> Self {
        let GreyFrame { grey, depth, intrinsics } = &keyframe.frame;
        let depth: Vec<u8> = depth.pixels().iter().flat_map(|depth| depth.to_le_bytes()).collect();
        Self {
            id: keyframe.id,
            world_from_key: keyframe.world_from_key,
            intrinsics: *intrinsics,
            grey: STANDARD.encode(grey.pixels()),
            depth: STANDARD.encode(depth),
            segments: keyframe.segments.clone(),
        }
    }

    fn restored(self) -> Result<Keyframe, String> {
        let Self { id, world_from_key, intrinsics, grey, depth, segments } = self;
        let intrinsics = intrinsics.validated().map_err(|error| error.to_string())?;
        let (width, height) = (intrinsics.width, intrinsics.height);
        let bytes = |text: String| STANDARD.decode(text).map_err(|error| error.to_string());
        let depth = bytes(depth)?.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
        let grey = Image::from_pixels(width, height, bytes(grey)?).map_err(|error| error.to_string())?;
        let depth = Image::from_pixels(width, height, depth).map_err(|error| error.to_string())?;
        if let Some(found) = segments.as_ref().map(SegmentRuns::len).filter(|found| *found != (width * height) as u64) {
            return Err(format!("a keyframe has {found} ids for {width}x{height} pixels"));
        }
        Ok(Keyframe { id, world_from_key, frame: GreyFrame { grey, depth, intrinsics }, segments })
    }
}
