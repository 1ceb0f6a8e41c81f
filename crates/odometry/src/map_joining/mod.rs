//! Joins the keyframes of two maps of one place: another day, or another robot.
//!
//! 1. Keyframes of each map are searched for in the other one. Every recognised one says how the maps lie to each other;
//!    wrong ones are outvoted ([`recognition`]).
//! 2. Keyframes that should show the same surfaces are aligned, with depth and luminance ([`links`]).
//! 3. The poses of both maps' keyframes minimise the errors of all measured relative poses, in both maps and between them
//!    ([`joined`]). The earlier map's first keyframe stays where it is.

mod gone;
mod joined;
mod links;
mod recognition;

use crate::keyframe_map::KeyframeMap;
use crate::saved_keyframes::{bytes, parsed};
pub use gone::erase_surfaces;
use joined::JoinedMap;
use splatseg_geometry::{KeyframeId, MapCorrection, Pose};
use thiserror::Error;

/// Two maps are joined only if at least this many keyframes agree how.
const MIN_AGREEING: usize = 3;

/// Other ways to join them must have at most this share of the keyframes that agree.
const MAX_OTHER: f64 = 0.5;

/// After the correction, the median error of the measured poses between the maps is at most this, metres and degrees.
const MAX_RESIDUAL: (f64, f64) = (0.05, 2.5);

/// The keyframes of two maps in one world: that of the earlier map.
#[derive(Clone, Debug)]
pub struct JoinedKeyframes {
    /// The keyframes of both, bytes as from [`PoseSource::save`](crate::PoseSource::save) for a map.
    pub keyframes: Vec<u8>,
    /// How the earlier map's keyframes move.
    pub earlier: MapCorrection,
    /// How the later map's keyframes move, by the numbers that they have in the later map.
    pub later: MapCorrection,
    /// The joined map numbers the later map's keyframes from here on.
    pub first_later: KeyframeId,
    /// How well the maps fit.
    pub fit: MapFit,
}

/// How well two maps fit together.
#[derive(Clone, Debug, PartialEq)]
pub struct MapFit {
    /// Pose of the later map's world in the earlier one's: of the keyframe whose motion is nearest to all others'.
    pub earlier_from_later: Pose,
    /// Keyframes of the earlier map, and those of them that were recognised in the later one and agree with the others.
    pub earlier: RecognisedCount,
    /// The same for the later map.
    pub later: RecognisedCount,
    /// Keyframes of both that were recognised elsewhere.
    pub elsewhere: usize,
    /// Pairs of keyframes of the two maps that were aligned.
    pub aligned: usize,
    /// Median error of their poses after the correction, metres.
    pub residual_m: f64,
    /// The same for turns, degrees.
    pub residual_deg: f64,
    /// Mean share of their measurements that agree, 0 to 1: the lower one of depth and image. 0 without pairs.
    pub agreement: f64,
    /// Parts of the later map that could not be joined. They are beside the rest.
    pub unjoined_parts: usize,
}

/// How many keyframes of a map were recognised in another one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecognisedCount {
    /// Keyframes that were recognised, at places that agree.
    pub recognised: usize,
    /// All keyframes.
    pub of: usize,
}

/// Two maps that cannot be joined.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum JoinError {
    /// The saved keyframes of a map cannot be used.
    #[error("the keyframes of the {which} map cannot be used: {problem}")]
    Damaged {
        /// `earlier` or `later`.
        which: &'static str,
        /// The problem.
        problem: String,
    },
    /// Too few keyframes of one map were recognised in the other.
    #[error(
        "the maps show no common place: {} of {} and {} of {} keyframes were recognised in the other map and agree, \
         expected {MIN_AGREEING} or more", earlier.recognised, earlier.of, later.recognised, later.of
    )]
    NoOverlap {
        /// Of the earlier map.
        earlier: RecognisedCount,
        /// Of the later map.
        later: RecognisedCount,
    },
    /// Keyframes were recognised in ways that contradict each other.
    #[error("the maps fit in several ways: {agreeing} keyframes agree with one, {other} with another")]
    Ambiguous {
        /// Keyframes that agree with the best way.
        agreeing: usize,
        /// Keyframes that agree with the next one.
        other: usize,
    },
    /// The maps do not fit where keyframes were recognised.
    #[error(
        "the maps do not fit: {pairs} pairs of keyframes were aligned, with errors of {residual_m:.3} m and \
         {residual_deg:.1} degrees, expected {MIN_AGREEING} pairs or more and at most {} m and {} degrees",
        MAX_RESIDUAL.0, MAX_RESIDUAL.1
    )]
    BadFit {
        /// Pairs of keyframes that were aligned.
        pairs: usize,
        /// Median error after the correction, metres.
        residual_m: f64,
        /// The same for turns, degrees.
        residual_deg: f64,
    },
}

/// Joins the keyframes of two saved maps: bytes from [`PoseSource::save`](crate::PoseSource::save) for a
/// [map](crate::StateScope::Map) each. `earlier_from_later` is the pose of the later map's world in the earlier one's, if
/// it is known; then nothing needs to be recognised, and the maps need not overlap.
///
/// # Errors
/// [`JoinError`] if the maps do not overlap, the fit is doubtful, or the bytes are damaged.
pub fn join_keyframes(
    earlier: &[u8],
    later: &[u8],
    earlier_from_later: Option<&Pose>,
) -> Result<JoinedKeyframes, JoinError> {
    let damaged = |which| move |problem| JoinError::Damaged { which, problem };
    let earlier = parsed(earlier).map_err(damaged("earlier"))?;
    let later = parsed(later).map_err(damaged("later"))?;
    let places = match earlier_from_later {
        Some(pose) => recognition::known_places(&earlier, &later, pose),
        None => recognition::places(&earlier, &later)?,
    };
    let mut joined = JoinedMap::new(&earlier, &later, &places)?;
    joined.add_links();
    let fit = joined.fit(&later, &places);
    let is_needed = earlier_from_later.is_none();
    let is_far = fit.residual_m > MAX_RESIDUAL.0 || fit.residual_deg > MAX_RESIDUAL.1;
    if is_far || (is_needed && fit.aligned < MIN_AGREEING) {
        let MapFit { aligned: pairs, residual_m, residual_deg, .. } = fit;
        return Err(JoinError::BadFit { pairs, residual_m, residual_deg });
    }
    let first_later = joined.first_later;
    let [earlier, later] = [joined.motions(&earlier, 0), joined.motions(&later, first_later)];
    joined.drop_redundant();
    let keyframes = bytes(&joined.map).unwrap_or_default();
    Ok(JoinedKeyframes { keyframes, earlier, later, first_later, fit })
}

/// The number of keyframes.
fn count(map: &KeyframeMap) -> usize {
    map.store.len()
}
