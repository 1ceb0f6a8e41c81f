//! Errors of merging two maps.

use splatseg_geometry::Pose;
use splatseg_memory::MemoryError;
use splatseg_objects::NameError;
use splatseg_odometry::{JoinError, PoseSourceError};
use thiserror::Error;

/// Two maps that cannot be merged.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum MergeError {
    /// A map was saved without keyframes, so that nothing can be recognised in it.
    #[error("the {which} map has no keyframes: it was saved by an earlier version, or without depth")]
    NoKeyframes {
        /// `earlier` or `later`.
        which: &'static str,
    },
    /// The maps do not overlap, or do not fit.
    #[error(transparent)]
    Join(#[from] JoinError),
    /// The views of the keyframes take more than the memory limit.
    #[error(transparent)]
    Views(#[from] PoseSourceError),
    /// Where the maps were put together, one saw through the surfaces of the other: it is another place that looks alike.
    #[error(
        "the maps contradict each other where they overlap: {percent} % of the surfaces of one were empty space for the \
         other, expected {limit} % at most"
    )]
    Contradiction {
        /// Share of the surfaces that were seen through.
        percent: u32,
        /// The largest that is accepted.
        limit: u32,
        /// Where keyframes were recognised: pose of the later map's world in the earlier one's.
        earlier_from_later: Pose,
    },
    /// The memories cannot be joined.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// The names of both maps together cannot be kept.
    #[error(transparent)]
    Names(#[from] NameError),
}

impl MergeError {
    /// True if the maps can be used, but are not of one place, as far as they show.
    pub fn is_misfit(&self) -> bool {
        match self {
            Self::Join(error) => !matches!(error, JoinError::Damaged { .. }),
            Self::Contradiction { .. } => true,
            _ => false,
        }
    }
}
