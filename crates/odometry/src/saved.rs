//! The state of a run that is resumed.

use crate::keyframe::Keyframe;
use crate::movers::Movers;
use crate::odometry::MAX_KEYFRAMES;
use crate::prior::LastFrame;
use crate::pyramid::GreyFrame;
use crate::segment_runs::SegmentRuns;
use crate::{Odometry, TrackedPoses};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde::{Deserialize, Serialize};
use splatseg_geometry::{Image, Intrinsics, Pose};

/// Saved form of [`TrackedPoses`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedPoses {
    keyframes: Vec<SavedKeyframe>,
    active: usize,
    last: Option<LastFrame>,
    movers: Movers,
    awaits_segments: bool,
    last_given: Option<Pose>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct SavedKeyframe {
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
        let Odometry { keyframes, active, last, movers, awaits_segments, .. } = &poses.odometry;
        Self {
            keyframes: keyframes.iter().map(SavedKeyframe::of).collect(),
            active: *active,
            last: *last,
            movers: movers.clone(),
            awaits_segments: *awaits_segments,
            last_given: poses.last_given,
        }
    }

    /// The odometry, and the latest given pose.
    pub(crate) fn restored(self) -> Result<(Odometry, Option<Pose>), String> {
        let Self { keyframes, active, last, movers, awaits_segments, last_given } = self;
        if keyframes.len() > MAX_KEYFRAMES || active >= keyframes.len().max(1) {
            let count = keyframes.len();
            return Err(format!("keyframe {active} of {count} is in use, expected at most {MAX_KEYFRAMES} keyframes"));
        }
        let keyframes = keyframes.into_iter().map(SavedKeyframe::restored).collect::<Result<_, _>>()?;
        let odometry = Odometry { keyframes, active, reference: None, last, movers, awaits_segments };
        Ok((odometry, last_given))
    }
}

impl SavedKeyframe {
    fn of(keyframe: &Keyframe) -> Self {
        let GreyFrame { grey, depth, intrinsics } = &keyframe.frame;
        let depth: Vec<u8> = depth.pixels().iter().flat_map(|depth| depth.to_le_bytes()).collect();
        Self {
            world_from_key: keyframe.world_from_key,
            intrinsics: *intrinsics,
            grey: STANDARD.encode(grey.pixels()),
            depth: STANDARD.encode(depth),
            segments: keyframe.segments.clone(),
        }
    }

    fn restored(self) -> Result<Keyframe, String> {
        let Self { world_from_key, intrinsics, grey, depth, segments } = self;
        let intrinsics = intrinsics.validated().map_err(|error| error.to_string())?;
        let (width, height) = (intrinsics.width, intrinsics.height);
        let bytes = |text: String| STANDARD.decode(text).map_err(|error| error.to_string());
        let depth = bytes(depth)?.chunks_exact(2).map(|pair| u16::from_le_bytes([pair[0], pair[1]])).collect();
        let grey = Image::from_pixels(width, height, bytes(grey)?).map_err(|error| error.to_string())?;
        let depth = Image::from_pixels(width, height, depth).map_err(|error| error.to_string())?;
        if let Some(found) = segments.as_ref().map(SegmentRuns::len).filter(|found| *found != (width * height) as u64) {
            return Err(format!("a keyframe has {found} ids for {width}x{height} pixels"));
        }
        Ok(Keyframe { world_from_key, frame: GreyFrame { grey, depth, intrinsics }, segments })
    }
}
